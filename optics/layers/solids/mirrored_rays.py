"""Rays that walls mirror, until they end on a face, in a black wall or on the floor.

A wall is vertical: a mirrored ray keeps its slope, and seen from above it travels like
a ball between cushions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from microplan.arrays import BoolArray, Float32Array, FloatArray, IntArray
from microplan.optics.layers.solids.packed_bodies import packed
from microplan.optics.layers.solids.straight_rays import Paths, Rays, ThickBody
from microplan.optics.layers.solids.unfolded_bodies import unfolded

_ROUNDING_UM = 1e-3  # heights this close are one


class RayEnd(Protocol):
    """What a face sends back, or the lamp."""

    def __call__(self, x: Float32Array, y: Float32Array, /) -> Float32Array:
        """Return what points of it send to any ray, world um."""

    @property
    def mirrors(self) -> float:
        """Return the reflectance of what it mirrors besides."""


@dataclass(frozen=True, slots=True)
class _Lamp:
    """The lamp, from which light comes all over."""

    mirrors: float = 0.0

    def __call__(self, x: Float32Array, _y: Float32Array, /) -> Float32Array:
        """Return all of the light."""
        return np.ones_like(x)


_LAMP = _Lamp()


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstMet:
    """Where rays on their way down meet their first body."""

    z_um: Float32Array  # (points, slopes), -inf where they meet none, inf if left out
    walls: IntArray  # (points, slopes) whose mirroring wall it is; -1: none is

    def reaches(self, z_um: float) -> BoolArray:
        """Return which of (N, M) rays nothing stops above a height, um."""
        reached: BoolArray = self.z_um <= np.float32(z_um + _ROUNDING_UM)
        return reached

    def some(self, points: IntArray) -> FirstMet:
        """Return where the rays of some points do, (K,) indices."""
        return FirstMet(z_um=self.z_um[points], walls=self.walls[points])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Flight:
    """Mirrored rays on their way down."""

    rays: FloatArray  # (N, 7), x, y, z and so on, as `ray_loops.fly` has them, um
    walls: IntArray  # (N,) body at whose wall each starts; -1: at none
    bounces: IntArray  # (N,)
    points: IntArray  # (N,) that each belongs to
    reach: float  # as in `Rays`

    def risen(self, few: IntArray, mirrors: float) -> _Flight:
        """Return some of the rays after a mirror."""
        rays = self.rays[few]
        rays[:, 6] *= mirrors
        return _Flight(
            rays=rays,
            walls=np.full(few.shape, -1),
            bounces=self.bounces[few],
            points=self.points[few],
            reach=self.reach,
        )


def mirrored(
    bodies: Sequence[ThickBody],
    lights: Sequence[RayEnd | None],
    floor: RayEnd | None,
    floor_um: float,
    rays: Rays,
    met: FirstMet,
    *,
    above_um: float = -math.inf,
    below_um: float = math.inf,
) -> FloatArray:
    """Return what rays see after walls have mirrored them, summed over slopes.

    Parameters
    ----------
    bodies : sequence of ThickBody
        All that hides; walls of reflectance 0 are black.
    lights : sequence of RayEnd, optional
        What the top of each sends back to a ray; None: nothing.
    floor, floor_um : RayEnd, optional
        What the plane below everything sends back, and its height.
    rays, met : Rays, FirstMet
        Through the points, and where they meet the bodies.
    above_um, below_um : float
        Between which heights the first wall is met.

    Returns
    -------
    (points,) float64 array
        Sums of each mirrored ray's reflectances times what it meets at last, shares of
        full scale.
    """
    total = np.zeros(rays.x_um.shape[0])
    flight = _started(met, rays, between_um=(above_um, below_um))
    _fly(flight, bodies, lights, floor, floor_um, total)
    return total


def raised(
    bodies: Sequence[ThickBody],
    face: ThickBody,
    mirrors: float,
    rays: Rays,
    met: FirstMet,
) -> FloatArray:
    """Return what a mirror face gives back past walls that mirror, too.

    Of rays that come down to it straight and meet a wall on their way up.

    Parameters
    ----------
    bodies : sequence of ThickBody
        All that hides.
    face : ThickBody
        One of them; if it is sharp, all rays meet it that reach its height.
    mirrors : float
        Reflectance of what its top mirrors.
    rays, met : Rays, FirstMet
        Through the points, and where they meet the bodies, as far down as the face.

    Returns
    -------
    (points,) float64 array
        Sums over slopes, shares of full scale.
    """
    total = np.zeros(rays.x_um.shape[0])
    z_um = face.top_um
    images = unfolded(bodies, z_um)
    if mirrors == 0 or all(body.wall_reflectance == 0 for body in images):
        return total
    seen = met.reaches(z_um)
    if not face.is_sharp:
        seen &= Paths.of(face, rays).at(z_um) < 0
    ceiling_um = _ceiling_um(images)
    again = first_met(images, ceiling_um, rays, seen)
    flight = _started(again, rays, mirrors)
    _fly(flight, images, [None] * len(images), _LAMP, ceiling_um, total)
    return total


def _ceiling_um(images: Sequence[ThickBody]) -> float:
    """Return a height that unfolded rays reach past all images."""
    return min(body.under_um for body in images) - 1.0  # a mirror has some above it


def first_met(
    bodies: Sequence[ThickBody],
    floor_um: float,
    rays: Rays,
    some: BoolArray | None = None,
) -> FirstMet:
    """Return where rays meet their first body above a height, um.

    Rays of N points and M slopes that are none of `some`, (N, M), meet no wall.
    """
    from microplan.optics.layers.solids import ray_loops  # loads a compiler

    (across,), (up,), (x, y) = rays.across, rays.up, (rays.x_um, rays.y_um)
    first = np.full((x.shape[0], across.size), -np.inf, dtype=np.float32)
    if some is not None:
        first[~some] = np.inf
    whose = np.full(first.shape, -1, dtype=np.intp)
    slopes = np.hypot(across.astype(np.float64), up.astype(np.float64))
    ray_loops.first_met(
        *packed(bodies), floor_um, x, y, across, up, slopes, rays.apart_um,
        first, whose,
    )  # fmt: skip
    return FirstMet(z_um=first, walls=whose)


def _started(
    met: FirstMet,
    rays: Rays,
    weight: float = 1.0,
    between_um: tuple[float, float] = (-math.inf, math.inf),
) -> _Flight:
    """Return the rays that a wall mirrors first, between two heights, from there."""
    whose, first = met.walls.ravel(), met.z_um.ravel()
    at = np.flatnonzero(whose >= 0)
    z = first[at]
    within = (z >= between_um[0]) & (z <= between_um[1])
    at, z = at[within], z[within].astype(np.float64)
    point, ray = np.divmod(at, met.walls.shape[1])
    across, up = rays.across[0, ray], rays.up[0, ray]
    slope, start = np.hypot(across, up), (point, ray % rays.x_um.shape[1])
    places = rays.x_um[start] + z * across, rays.y_um[start] + z * up
    down = -across / slope, -up / slope  # heights fall
    return _Flight(
        rays=np.stack([*places, z, *down, slope, np.full(z.shape, weight)], axis=1),
        walls=whose[at],
        bounces=np.zeros(z.shape, dtype=np.intp),
        points=point,
        reach=rays.reach,
    )


def _fly(
    flight: _Flight,
    bodies: Sequence[ThickBody],
    lights: Sequence[RayEnd | None],
    floor: RayEnd | None,
    floor_um: float,
    total: FloatArray,
) -> None:
    """Follow rays to their ends and add what they see, in place."""
    from microplan.optics.layers.solids import ray_loops  # as above

    ends = np.empty(flight.points.shape, dtype=np.intp)
    ray_loops.fly(
        *packed(bodies), floor_um, flight.rays, flight.walls,
        flight.bounces, ends, flight.reach,
    )  # fmt: skip
    for end, light in enumerate([*lights, floor]):
        few = np.flatnonzero(ends == end)
        if light is None or not few.size:
            continue
        x, y, weight = flight.rays[few].T[[0, 1, 6]]
        seen = weight * light(x.astype(np.float32), y.astype(np.float32))
        total += np.bincount(flight.points[few], seen, total.size)
        if end < len(bodies) and light.mirrors > 0:
            images = unfolded(bodies, bodies[end].top_um)
            nothing: list[RayEnd | None] = [None] * len(images)
            risen = flight.risen(few, light.mirrors)
            _fly(risen, images, nothing, _LAMP, _ceiling_um(images), total)
