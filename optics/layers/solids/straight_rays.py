"""Straight rays past solid bodies: what tops cover, and what walls hide.

Distances to outlines say how near a ray passes. A ray stands for a cell of the pupil:
it is as wide as that, and hidden in part where an edge runs through it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import Float32Array, FloatArray, IntArray
from microplan.optics.outline.distance_field import DistanceField

_APART_UM = 6.0  # of points along a ray where its distance from a wall is looked up
_MOST = 40  # such points
_LEAST_UM = 1.0  # width of a ray where it starts
_SURE_UM = 1.0  # more than distances err by
_FIRST, _LAST = np.float32(0.0), np.float32(1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ThickBody:
    """Bodies of one outline and one height, where rays may meet them."""

    distance: DistanceField
    top_um: float  # above the plane that rays start from
    under_um: float  # its underside; the top's for a flat face
    wall_reflectance: float
    is_sharp: bool = False  # near the plane that rays start from


@dataclass(frozen=True, slots=True, kw_only=True)
class Rays:
    """Rays through points of a plane, each with all slopes."""

    x_um: Float32Array  # (points, 1), or (points, slopes)
    y_um: Float32Array
    across: Float32Array  # (1, slopes): sideways a um of height
    up: Float32Array
    # how far mirrored ones go on as they leave a wall, as in `ray_loops.fly`
    reach: float = 1.0

    def some(self, points: IntArray) -> Rays:
        """Return the rays of some points, (K,) indices."""
        return replace(self, x_um=self.x_um[points], y_um=self.y_um[points])

    def with_some(self, points: IntArray, others: Rays) -> Rays:
        """Return the rays with those of some points, (K,) indices, replaced."""
        x, y = self.x_um.copy(), self.y_um.copy()
        x[points], y[points] = others.x_um, others.y_um
        return replace(self, x_um=x, y_um=y)

    @property
    def shape(self) -> tuple[int, int]:
        """Return (points, slopes)."""
        return self.x_um.shape[0], self.across.shape[1]

    @property
    def first(self) -> tuple[Float32Array, Float32Array]:
        """Return where the first ray of each point starts, (N,) um each."""
        return self.x_um[:, 0], self.y_um[:, 0]

    @property
    def apart_um(self) -> Float32Array:
        """Return how far from a point's first ray others start at most, (N,) um."""
        if self.x_um.shape[1] == 1:  # all start there
            return np.zeros(self.x_um.shape[0], dtype=np.float32)
        x, y = self.x_um - self.x_um[:, :1], self.y_um - self.y_um[:, :1]
        found: Float32Array = np.sqrt((x * x + y * y).max(axis=1))
        return found

    def at(self, z_um: float) -> tuple[Float32Array, Float32Array]:
        """Return where rays pass a height above the plane, (points, slopes) um."""
        return (
            self.x_um + np.float32(z_um) * self.across,
            self.y_um + np.float32(z_um) * self.up,
        )


@dataclass(frozen=True, slots=True)
class Paths:
    """Rays in the grid of a body's distances: where they start, and a um higher."""

    field: DistanceField
    u: Float32Array
    v: Float32Array
    du: Float32Array
    dv: Float32Array

    @classmethod
    def of(cls, body: ThickBody, rays: Rays) -> Paths:
        """Return all rays."""
        field = body.distance
        start, slope = (rays.x_um, rays.y_um), (rays.across, rays.up)
        return cls(field, *field.places(*start), *field.directions(*slope))

    def at(self, z_um: float) -> Float32Array:
        """Return how far rays pass from the outline, (points, slopes) um."""
        z = np.float32(z_um)
        return self.field.read(self.u + z * self.du, self.v + z * self.dv)


def rays_of(points_um: FloatArray, tangents: FloatArray) -> Rays:
    """Return rays through points (N, 2) um with slopes (M, 2)."""
    x, y = points_um.astype(np.float32).T[:, :, None]
    across, up = tangents.astype(np.float32).T[:, None, :]
    return Rays(x_um=x, y_um=y, across=across, up=up)


def covers(body: ThickBody, rays: Rays, soft: float) -> Float32Array:
    """Return what a body's top covers of N rays of M slopes, (N, M) 0..1.

    A ray stands for its share of the pupil: it is `soft` um wide for each um of
    height, and one um more.
    """
    distance = Paths.of(body, rays).at(body.top_um)
    return _share(distance / _width(np.array(body.top_um), soft))


def hides(
    body: ThickBody, rays: Rays, soft: float, *, from_um: float, to_um: float
) -> Float32Array:
    """Return what a body hides of N rays of M slopes between two heights, (N, M) 0..1.

    Of a sharp body, which is met at `from_um`, only what rays approach: those that
    leave through its edge do not meet the wall there.
    """
    from microplan.optics.layers.solids import hiding_loop  # loads a compiler

    paths = Paths.of(body, rays)
    heights = heights_between(rays, from_um, to_um).astype(np.float32)
    widths = _width(heights.astype(np.float64), soft)
    slopes = np.hypot(rays.across, rays.up)
    least = np.empty((rays.x_um.shape[0], rays.across.shape[1]), dtype=np.float32)
    away = paths.field.read(paths.u[:, 0], paths.v[:, 0]) - rays.apart_um
    hiding_loop.least_distances(
        paths.field.values, (paths.u, paths.v), (paths.du, paths.dv), slopes,
        heights, widths, body.is_sharp, away - np.float32(_SURE_UM), least,
    )  # fmt: skip
    return _share(least)


def heights_between(rays: Rays, from_um: float, to_um: float) -> FloatArray:
    """Return heights, (K + 1,) um, between which the steepest ray travels a little."""
    slope = float(np.hypot(rays.across, rays.up).max())
    count = min(max(math.ceil(abs(to_um - from_um) * slope / _APART_UM), 1), _MOST)
    return np.linspace(from_um, to_um, count + 1)


def _width(z_um: FloatArray, soft: float) -> Float32Array:
    return np.asarray(_LEAST_UM + soft * np.abs(z_um), dtype=np.float32)


def _share(distance: Float32Array) -> Float32Array:
    """Return what is covered of a ray at a distance over its width."""
    found: Float32Array = np.clip(np.float32(0.5) - distance, _FIRST, _LAST)
    return found
