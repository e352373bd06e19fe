"""The bias of a chain through focus, and a position with it taken off."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.templates import Located


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasCurve:
    """Mean error without noise at some focus heights, in the target's frame."""

    dz_um: tuple[float, ...]  # of the focus from nominal, rising
    x_um: tuple[float, ...]
    y_um: tuple[float, ...]
    theta_rad: tuple[float, ...] | None  # None: no angle is given
    scatter_um: tuple[float, ...]  # rms over poses about that mean, both axes together

    def __post_init__(self) -> None:
        if not self.dz_um or any(b <= a for a, b in itertools.pairwise(self.dz_um)):
            raise ValueError(f"dz_um must be there and rise, got {self.dz_um}")
        others = (self.x_um, self.y_um, self.scatter_um, self.theta_rad or self.x_um)
        if any(len(values) != len(self.dz_um) for values in others):
            raise ValueError("there must be one value at each height")

    def at(self, dz_um: float) -> tuple[float, float, float]:
        """Return the bias (x um, y um, theta rad), linear between the heights.

        Beyond the outermost it is theirs; the angle's is 0 where none is given.
        """
        turn = self.theta_rad or (0.0,) * len(self.dz_um)
        x, y, theta = (
            float(np.interp(dz_um, self.dz_um, values))
            for values in (self.x_um, self.y_um, turn)
        )
        return (x, y, theta)

    def at_depth(self, depth_um: float) -> tuple[float, float, float]:
        """Return the mean of the biases on both sides of the focus.

        For a chain that measures how far out of focus it is, but not to which side.
        """
        near, far = self.at(-depth_um), self.at(depth_um)
        x, y, theta = ((a + b) / 2 for a, b in zip(near, far, strict=True))
        return (x, y, theta)


def unbiased(
    case: LookCase, place: Located, curve: BiasCurve, depth_um: float | None = None
) -> Located:
    """Return a measured place with the predicted bias taken off in the target's frame.

    Parameters
    ----------
    case : LookCase
        The look.
    place : Located
        What was measured.
    curve : BiasCurve
        Of the chain that measured it.
    depth_um : float, optional
        How far out of focus the chain says it is; without it the bias is that of the
        nominal focus.

    Returns
    -------
    Located
        The same where neither the angle nor a nominal one is known.
    """
    turn = case.theta_rad if place.theta_rad is None else place.theta_rad
    if place.theta_rad is None and case.theta_any:
        return place
    x, y, theta = curve.at(0.0) if depth_um is None else curve.at_depth(depth_um)
    c, s = math.cos(turn), math.sin(turn)
    return replace(
        place,
        x_um=place.x_um - (c * x - s * y),
        y_um=place.y_um - (s * x + c * y),
        theta_rad=None if place.theta_rad is None else place.theta_rad - theta,
    )
