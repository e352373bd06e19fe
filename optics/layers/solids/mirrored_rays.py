"""Rays that walls mirror, until they end on a face, in a black wall or on the floor.

A wall is vertical: a mirrored ray keeps its slope, and seen from above it travels like
a ball between cushions.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from microplan.arrays import BoolArray, Float32Array, FloatArray
from microplan.optics.layers.solids.straight_rays import (
    IndexArray,
    Paths,
    Rays,
    ThickBody,
    heights_between,
)
from microplan.optics.layers.solids.unfolded_bodies import unfolded
from microplan.optics.outline.distance_field import BEYOND_UM

_TOUCH_UM = 0.1  # a ray this close to a wall meets it
_LEAST_UM = 0.25  # step along it
_STEPS = 300  # of a mirrored ray
_BOUNCES = 30  # on walls; what is left then is lost, as is less than
_FAINT = 0.005  # of the light


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


@dataclass(slots=True)
class _Flight:
    """Mirrored rays on their way down, one an entry."""

    x: Float32Array
    y: Float32Array
    z: Float32Array
    dx: Float32Array  # sideways, a unit vector
    dy: Float32Array
    slope: Float32Array  # sideways a um of height
    weight: Float32Array
    bounces: IndexArray
    index: IndexArray  # of the point it belongs to
    off: Float32Array  # (N, bodies): from their outlines, um

    def keep(self, which: BoolArray) -> _Flight:
        """Return some of the rays; itself if these are all."""
        if which.all():
            return self
        few = np.flatnonzero(which)  # picked ten times: numbers are faster than a mask
        return _Flight(*(getattr(self, n).take(few, axis=0) for n in self.__slots__))


def mirrored(
    bodies: Sequence[ThickBody],
    lights: Sequence[RayEnd | None],
    floor: RayEnd | None,
    floor_um: float,
    rays: Rays,
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
    rays : Rays
        Through the points.
    above_um, below_um : float
        Between which heights the first wall is met.

    Returns
    -------
    (points,) float64 array
        Sums of each mirrored ray's reflectances times what it meets at last, shares of
        full scale.
    """
    total = np.zeros(rays.x_um.shape[0])
    first, whose = _first_met(bodies, floor_um, rays)
    flight = _started(bodies, first, whose, rays)
    flight = flight.keep((flight.z > above_um) & (flight.z <= below_um))
    _fly(flight, bodies, lights, floor, floor_um, total)
    return total


def raised(
    bodies: Sequence[ThickBody], face: ThickBody, mirrors: float, rays: Rays
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
    rays : Rays
        Through the points.

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
    met, _ = _first_met([b for b in bodies if b.top_um > z_um], z_um, rays)
    seen = np.isneginf(met)
    if not face.is_sharp:
        seen &= Paths.of(face, rays).at(z_um) < 0
    ceiling_um = _ceiling_um(images)
    first, whose = _first_met(images, ceiling_um, rays)
    flight = _started(images, first, np.where(seen, whose, -1), rays)
    flight.weight *= np.float32(mirrors)
    _fly(flight, images, [None] * len(images), _LAMP, ceiling_um, total)
    return total


def _ceiling_um(images: Sequence[ThickBody]) -> float:
    """Return a height that unfolded rays reach past all images."""
    return min(body.under_um for body in images) - 1.0  # a mirror has some above it


def _first_met(
    bodies: Sequence[ThickBody], floor_um: float, rays: Rays
) -> tuple[Float32Array, IndexArray]:
    """Return where rays meet their first body, and whose wall it is if that mirrors.

    (points, slopes): -inf where they meet none; -1 where it is no mirroring wall.
    """
    shape = (rays.x_um.shape[0], rays.across.shape[1])
    first = np.full(shape, -np.inf, dtype=np.float32)
    whose: IndexArray = np.full(shape, -1)
    for k, body in enumerate(bodies):
        top = Paths.of(body, rays).at(body.top_um) < 0
        nearer = top & (body.top_um > first)
        np.copyto(first, np.float32(body.top_um), where=nearer)
        np.copyto(whose, -1, where=nearer)
        if body.under_um < body.top_um:
            at, met = _first_wall(body, rays, floor_um)
            nearer = met & (at > first)
            np.copyto(first, at, where=nearer)
            np.copyto(whose, k if body.wall_reflectance > 0 else -1, where=nearer)
    return first, whose


def _started(
    bodies: Sequence[ThickBody],
    first: Float32Array,
    whose: IndexArray,
    rays: Rays,
) -> _Flight:
    """Return the rays that a wall has mirrored first, from there."""
    point, ray = np.nonzero(whose >= 0)
    z, body_of = first[point, ray], whose[point, ray]
    across, up = rays.across[0, ray], rays.up[0, ray]
    slope, start = np.hypot(across, up), (point, ray % rays.x_um.shape[1])
    flight = _Flight(
        x=rays.x_um[start] + z * across,
        y=rays.y_um[start] + z * up,
        z=z,
        # down the ray: heights fall
        dx=-across / slope,
        dy=-up / slope,
        slope=slope,
        weight=np.ones_like(z),
        bounces=np.zeros(z.size, dtype=np.int32),
        index=point,
        off=np.empty((point.size, len(bodies)), dtype=np.float32),
    )
    for k, body in enumerate(bodies):
        _mirror(flight, body, body_of == k)
    return flight


def _fly(
    flight: _Flight,
    bodies: Sequence[ThickBody],
    lights: Sequence[RayEnd | None],
    floor: RayEnd | None,
    floor_um: float,
    total: FloatArray,
) -> None:
    """Follow rays to their ends and add what they see, in place."""
    ended: list[list[_Flight]] = [[] for _ in bodies]
    places = flight.x, flight.y
    flight.off = np.stack([b.distance.between(*places) for b in bodies], axis=1)
    for _ in range(_STEPS):
        if not flight.x.size:
            break
        flight = _advance(flight, bodies, lights, floor, floor_um, total, ended)
    for body, light, parts in zip(bodies, lights, ended, strict=True):
        images = unfolded(bodies, body.top_um)
        if light is not None and light.mirrors > 0 and parts:
            risen = _joined(parts)
            risen.weight *= np.float32(light.mirrors)
            nothing: list[RayEnd | None] = [None] * len(images)
            _fly(risen, images, nothing, _LAMP, _ceiling_um(images), total)


def _joined(parts: Sequence[_Flight]) -> _Flight:
    """Return the rays of several flights."""
    names = _Flight.__slots__
    return _Flight(*(np.concatenate([getattr(p, name) for p in parts])
                     for name in names))  # fmt: skip


def _first_wall(
    body: ThickBody, rays: Rays, low_um: float
) -> tuple[Float32Array, BoolArray]:
    """Return the height at which rays meet a body's wall, and whether they do.

    (points, slopes); rays that meet its top do not.
    """
    low_um = max(body.under_um, low_um)
    paths = Paths.of(body, rays)
    ends = [paths.at(z_um) for z_um in (body.top_um, low_um)]
    length = (body.top_um - low_um) * np.hypot(rays.across, rays.up)
    at = np.full(ends[0].shape, -np.inf, dtype=np.float32)
    point, ray = np.nonzero((ends[0] >= 0) & (ends[0] + ends[1] < length))
    few, before = paths.some(point, ray), ends[0][point, ray]
    found = np.full(point.shape, -np.inf, dtype=np.float32)
    heights = heights_between(rays, body.top_um, low_um)
    for above, z_um in itertools.pairwise(heights):
        now = few.at(z_um)
        here = np.flatnonzero((now < 0) & (found < low_um))
        share = before[here] / (before[here] - now[here])
        found[here] = above + share * (z_um - above)
        before = now
    at[point, ray] = found
    return at, at >= low_um


def _mirror(flight: _Flight, body: ThickBody, which: BoolArray) -> None:
    """Mirror some rays at a body's wall, in place."""
    few = np.flatnonzero(which)
    if not few.size:
        return
    x, y = flight.x.take(few), flight.y.take(few)
    nx, ny = body.distance.normal(x, y)
    dx, dy = flight.dx.take(few), flight.dy.take(few)
    into = np.minimum(dx * nx + dy * ny, 0)
    flight.dx[few], flight.dy[few] = dx - 2 * into * nx, dy - 2 * into * ny
    back = _TOUCH_UM - body.distance.between(x, y)  # onto the wall's outside
    flight.x[few], flight.y[few] = x + back * nx, y + back * ny
    hit = into < 0
    flight.weight[few] *= np.where(hit, body.wall_reflectance, 1.0)
    flight.bounces[few] += hit


def _advance(
    flight: _Flight,
    bodies: Sequence[ThickBody],
    lights: Sequence[RayEnd | None],
    floor: RayEnd | None,
    floor_um: float,
    total: FloatArray,
    ended: Sequence[list[_Flight]],
) -> _Flight:
    """Return rays a safe step on; those that end are added to the sums, in place.

    Those that end on tops are added to `ended`, by body.
    """
    away = (flight.z - np.float32(floor_um)) * flight.slope
    for body, d in zip(bodies, flight.off.T, strict=True):
        above = (flight.z - np.float32(body.top_um)) * flight.slope
        clear = np.where(above > 0, np.maximum(above, np.minimum(d, BEYOND_UM)), d)
        clear = np.where(flight.z < body.under_um, np.inf, clear)
        away = np.minimum(away, np.maximum(clear, _LEAST_UM))
    before = flight.z
    flight.x += away * flight.dx
    flight.y += away * flight.dy
    flight.z = before - away / flight.slope
    alive = (flight.bounces <= _BOUNCES) & (flight.weight > _FAINT)
    for k, (body, light, on_top) in enumerate(zip(bodies, lights, ended, strict=True)):
        d = flight.off[:, k] = body.distance.between(flight.x, flight.y)
        passed = (before > body.top_um) & (flight.z <= body.top_um + 1e-3)
        top = passed & (d < 0) & alive
        _end(flight, top, light, total)
        if light is not None and light.mirrors > 0 and top.any():
            on_top.append(flight.keep(top))
        alive &= ~top
        low = (flight.z < body.top_um) & (flight.z > body.under_um)
        wall = low & (d < _TOUCH_UM) & alive & ~passed
        near = np.flatnonzero(wall)
        nx, ny = body.distance.normal(flight.x.take(near), flight.y.take(near))
        into = flight.dx.take(near) * nx + flight.dy.take(near) * ny
        wall[near] = (into < 0) | (d.take(near) < -_TOUCH_UM)
        if body.wall_reflectance > 0:
            _mirror(flight, body, wall)
            flight.off[wall, k] = _TOUCH_UM
        else:
            alive &= ~wall
    down = alive & (flight.z <= floor_um + 1e-3)
    _end(flight, down, floor, total)
    return flight.keep(alive & ~down)


def _end(
    flight: _Flight, which: BoolArray, light: RayEnd | None, total: FloatArray
) -> None:
    """Add what rays see at their end to the sums of their points, in place."""
    if light is None or not which.any():
        return
    few = np.flatnonzero(which)
    seen = flight.weight.take(few) * light(flight.x.take(few), flight.y.take(few))
    total += np.bincount(flight.index.take(few), seen, total.size)
