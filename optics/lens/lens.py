"""Systematic errors of a lens, each with its uncertainty."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

# A barrel distortion of -1/3 at the corner would fold the image there.
MAX_DISTORTION = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class LensErrors:
    """What is known of a lens' errors, and one standard deviation of what is not.

    Defocus is the height of a point minus that of the plane in focus. All are off by
    default.
    """

    # radial: r -> r (1 + distortion (r / r_corner)**2), r_corner half the diagonal of
    # the field at the setting in use; positive is a pincushion
    distortion: float = 0.0
    distortion_sigma: float = 0.0
    # shift of the image per um of defocus; the sigma is that of each axis
    lateral_x: float = 0.0
    lateral_y: float = 0.0
    lateral_sigma: float = 0.0
    # relative change of the magnification per um of defocus
    scale_per_um: float = 0.0
    scale_sigma_per_um: float = 0.0
    # 1 / R: a point r off the axis is imaged as one higher by r**2 / (2 R)
    field_curvature_per_um: float = 0.0
    field_curvature_sigma_per_um: float = 0.0
    # edges as fabricated minus edges as drawn, positive where there is more material
    edge_offset_um: float = 0.0
    edge_offset_sigma_um: float = 0.0
    # relative change of brightness across the field, as in `Illumination`; the sigma
    # is that of each axis
    gradient_x: float = 0.0
    gradient_y: float = 0.0
    gradient_sigma: float = 0.0
    # (magnification, numerical aperture), magnifications rising; none: no change
    apertures: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if name == "apertures":
                continue
            if not math.isfinite(value):
                raise ValueError(f"{name} must be finite, got {value}")
            if "sigma" in name and value < 0:
                raise ValueError(f"{name} must not be negative, got {value}")
        if abs(self.distortion) > MAX_DISTORTION:
            raise ValueError(
                f"distortion must be at most {MAX_DISTORTION}, got {self.distortion}"
            )
        if not abs(self.gradient_x) + abs(self.gradient_y) < 2:
            raise ValueError("the gradients must not make the light vanish")
        _check_apertures(self.apertures)

    @property
    def moves_points(self) -> bool:
        """Return whether the known part displaces image points."""
        moves = (self.distortion, self.lateral_x, self.lateral_y, self.scale_per_um)
        return any(moves)

    @property
    def changes_scene(self) -> bool:
        """Return whether the known part changes what the renderer is given."""
        return self.moves_points or bool(
            self.field_curvature_per_um or self.edge_offset_um
        )

    def aperture_at(self, magnification: float) -> float:
        """Return the numerical aperture at a magnification.

        Between entries a power of the magnification, which is exact where a fixed stop
        behind the zoom limits the light.

        Raises
        ------
        ValueError
            If there is no table, or the magnification lies outside it.
        """
        table = self.apertures
        if not table or not table[0][0] <= magnification <= table[-1][0]:
            known = f"{table[0][0]}..{table[-1][0]}" if table else "none"
            raise ValueError(
                f"no aperture is known at magnification {magnification}; known: {known}"
            )
        m, A = np.log(np.array(table)).T
        return float(np.exp(np.interp(math.log(magnification), m, A)))


def _check_apertures(table: tuple[tuple[float, float], ...]) -> None:
    """Refuse a table that is no function, or of a single entry."""
    if not table:
        return
    flat = [number for entry in table for number in entry]
    if not all(number > 0 and math.isfinite(number) for number in flat):
        raise ValueError(f"apertures must be positive and finite, got {table}")
    below = [m for m, _ in table]
    if len(table) < 2 or any(b <= a for a, b in itertools.pairwise(below)):
        raise ValueError(
            f"apertures need two entries or more, magnifications rising, got {table}"
        )
