"""Solid bodies over a stage: prisms with faces and walls."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.arrays import Box
from microplan.executor.simulated.imaging.solids.distance_map import (
    DistanceMap,
    Reals,
    Reals32,
    distance_map,
)
from microplan.executor.simulated.imaging.solids.plane_outline import PlaneOutline
from microplan.schemas.pose import Pose

CROP_UM = 720.0  # a longer body is mapped only near the image
HEIGHT_DIGITS = 4  # of um: heights that sums left a rounding apart are the same
CROP_STEP_UM = 100.0  # the crop moves in steps, so that maps are used again


@dataclass(frozen=True, slots=True, kw_only=True)
class SolidBody:
    """A prism: its outline from `bottom_um` to `top_um`, at a pose in the world."""

    name: str  # in messages
    outline: PlaneOutline  # in the body's frame
    pose: Pose  # of the body's frame in the world
    bottom_um: float  # world height of the underside
    top_um: float  # world height of the top face
    reflectance: float  # of the top face
    finish: float = 0.0  # share of it that a mirror gives back
    wall_reflectance: float = 0.0  # 0: black walls

    def __post_init__(self) -> None:
        if not self.bottom_um <= self.top_um:  # also refuses nan
            raise ValueError(f"{self.name}: {self.bottom_um} is above {self.top_um}")
        for name in ("reflectance", "finish", "wall_reflectance"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{self.name}: {name} must be 0 to 1")

    def away_um(self, x_um: float, y_um: float) -> float:
        """Return how far a point of the world is from the outline's box, at least."""
        x0, y0, x1, y1 = self.outline.box
        u, v = self.pose.inverse().apply(x_um, y_um)
        return math.hypot(max(x0 - u, u - x1, 0.0), max(y0 - v, v - y1, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class SolidScene:
    """Bodies over a stage, which is a plane without end."""

    bodies: tuple[SolidBody, ...]
    stage_um: float  # world height of the stage's surface
    stage_reflectance: float  # of its surface, which scatters

    def __post_init__(self) -> None:
        for body in self.bodies:
            if body.top_um < self.stage_um:
                raise ValueError(f"{body.name} is below the stage")


@dataclass(frozen=True, eq=False)
class MappedBody:
    """A body as rays meet it: in the image's own frame, with a distance map."""

    body: SolidBody
    top_um: float  # as used: faces near to the sharp plane are taken to be in it
    bottom_um: float
    distances: DistanceMap
    cosine: float
    sine: float
    x_um: float  # of the body's origin, from the image's middle
    y_um: float

    def distance(self, x: Reals, y: Reals, *, exact: bool = False) -> Reals:
        """Return signed distances of points from the image's middle, um."""
        u, v = self._inward(x, y)
        return self.distances.exact(u, v) if exact else self.distances.quick(u, v)

    def normal(self, x: Reals, y: Reals) -> tuple[Reals, Reals]:
        """Return unit vectors out of the body, in the image's frame."""
        gx, gy = self.distances.normal(*self._inward(x, y))
        return self.cosine * gx - self.sine * gy, self.sine * gx + self.cosine * gy

    def surface(self, x: Reals, y: Reals) -> tuple[Reals, Reals, Reals]:
        """Return signed distances, um, and unit vectors out of the body, (...) each."""
        away, gx, gy = self.distances.surface(*self._inward(x, y))
        c, s = x.dtype.type(self.cosine), x.dtype.type(self.sine)
        return away, c * gx - s * gy, s * gx + c * gy

    def cells(self, x: Reals32, y: Reals32) -> tuple[Reals32, Reals32]:
        """Return where (...) um points are on the body's raster, in cells."""
        i, j = self.distances.cells(*self._inward(x, y))
        return i.astype(np.float32, copy=False), j.astype(np.float32, copy=False)

    def cell_slopes(self, x: Reals32, y: Reals32) -> tuple[Reals32, Reals32]:
        """Return (...) slopes on the body's raster, cells per um of height."""
        scale = 1 / self.distances.pitch_um
        c, s = np.float32(self.cosine * scale), np.float32(self.sine * scale)
        return c * x + s * y, c * y - s * x

    def _inward(self, x: Reals, y: Reals) -> tuple[Reals, Reals]:
        """Return points in the body's frame."""
        dx, dy = x - x.dtype.type(self.x_um), y - y.dtype.type(self.y_um)
        c, s = x.dtype.type(self.cosine), x.dtype.type(self.sine)
        return c * dx + s * dy, c * dy - s * dx


def mapped(body: SolidBody, middle_um: tuple[float, float]) -> MappedBody:
    """Return a body with its map, seen from the image's middle in the world."""
    near = _crop(body, middle_um)
    return MappedBody(
        body=body,
        top_um=round(body.top_um, HEIGHT_DIGITS),
        bottom_um=round(body.bottom_um, HEIGHT_DIGITS),
        distances=distance_map(body.outline, near),
        cosine=math.cos(body.pose.theta_rad),
        sine=math.sin(body.pose.theta_rad),
        x_um=body.pose.x_um - middle_um[0],
        y_um=body.pose.y_um - middle_um[1],
    )


def _crop(body: SolidBody, middle_um: tuple[float, float]) -> Box | None:
    """Return what of a long body's frame is near the image; None: all of it."""
    x0, y0, x1, y1 = body.outline.box
    if max(x1 - x0, y1 - y0) <= CROP_UM:
        return None
    x, y = body.pose.inverse().apply(*middle_um)
    x, y = (CROP_STEP_UM * round(v / CROP_STEP_UM) for v in (x, y))
    # what is cut off goes on as at the border: a body beside the crop is kept whole
    x, y = float(np.clip(x, x0, x1)), float(np.clip(y, y0, y1))
    half = CROP_UM / 2
    return (x - half, y - half, x + half, y + half)
