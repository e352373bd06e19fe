"""Rigid poses in the plane."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """A turn by `theta_rad` (counter-clockwise), then a shift by (x, y)."""

    x_um: float  # shift along x
    y_um: float  # shift along y
    theta_rad: float = 0.0  # turn, counter-clockwise

    def __post_init__(self) -> None:
        if not all(math.isfinite(v) for v in (self.x_um, self.y_um, self.theta_rad)):
            raise ValueError(f"a pose must be finite, got {self}")

    def apply(self, x_um: float, y_um: float) -> tuple[float, float]:
        """Return the point (x, y) of this pose's frame in the outer frame."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return (self.x_um + c * x_um - s * y_um, self.y_um + s * x_um + c * y_um)

    def compose(self, inner: Pose) -> Pose:
        """Return the outer-frame pose of `inner`, given in this pose's frame."""
        x_um, y_um = self.apply(inner.x_um, inner.y_um)
        return Pose(x_um=x_um, y_um=y_um, theta_rad=self.theta_rad + inner.theta_rad)

    def inverse(self) -> Pose:
        """Return the pose that undoes this one."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return Pose(
            x_um=-c * self.x_um - s * self.y_um,
            y_um=s * self.x_um - c * self.y_um,
            theta_rad=-self.theta_rad,
        )
