"""Lamps around the objective, and the line that rounded edges mirror from them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.render.scene import EdgeLine

_GOLDEN_RAD = math.pi * (3 - math.sqrt(5))


@dataclass(frozen=True, slots=True, kw_only=True)
class RingLamp:
    """Even light from all azimuths between two elevations above the horizontal."""

    low_rad: float
    high_rad: float

    def __post_init__(self) -> None:
        if not 0 <= self.low_rad < self.high_rad <= math.pi / 2:
            raise ValueError(
                "elevations must be 0 <= low < high <= pi / 2, got "
                f"{self.low_rad}, {self.high_rad}"
            )

    @property
    def spread(self) -> float:
        """Return the difference of the squared sines from the axis, inner to outer.

        pi times it is the irradiance of a horizontal face for a radiance of 1.
        """
        return math.cos(self.low_rad) ** 2 - math.cos(self.high_rad) ** 2


Lamp = RingLamp | None  # None: light through the objective or from below


def directions(lamp: RingLamp, count: int) -> FloatArray:
    """Return directions to a ring of light that irradiate a horizontal face alike.

    Parameters
    ----------
    count : int
        How many, at least 1.

    Returns
    -------
    (count, 2) float64 array
        um sideways along x and y for each um up, on a golden spiral over the annulus of
        sines (Vogel 1979).
    """
    if count < 1:
        raise ValueError(f"count must be at least 1, got {count}")
    i = np.arange(count) + 0.5
    sine2 = math.cos(lamp.high_rad) ** 2 + lamp.spread * i / count
    tangent = np.sqrt(sine2 / (1 - sine2))
    angle = _GOLDEN_RAD * i
    return np.stack([tangent * np.cos(angle), tangent * np.sin(angle)], axis=1)


def edge_line(
    lamp: RingLamp, *, mirrored: float, radius_um: float, rings: int
) -> EdgeLine | None:
    """Return the line that a rounded edge mirrors up, None where there is none.

    A surface tilted by half the light's angle from the axis mirrors it along the axis.
    Of a quarter of a circle of radius r such tilts take up r (sin(b / 2) - sin(a / 2)),
    for angles a to b. It is as bright as the lamp times what is mirrored; lenses spread
    it (`microplan.optics.light.mirrored_strip`). Where it lies on a rounding that is no
    circle is not known.

    Parameters
    ----------
    mirrored : float
        Reflectance times finish of the face.
    radius_um : float
        Of the rounding.
    rings : int
        How many of the outline's rings are rounded.
    """
    if mirrored <= 0 or radius_um <= 0:
        return None
    outer, inner = (
        math.sin((math.pi / 2 - end) / 2) for end in (lamp.low_rad, lamp.high_rad)
    )
    return EdgeLine(
        level=mirrored / lamp.spread,
        width_um=radius_um * (outer - inner),
        radius_um=radius_um,
        rings=rings,
    )
