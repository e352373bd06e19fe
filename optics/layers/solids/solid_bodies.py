"""Solid bodies of a scene about a plane, what their faces send, and rays to them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from microplan.arrays import Float32Array, IntArray
from microplan.optics.layers.lattice import Area, Lattice
from microplan.optics.layers.rays import slopes
from microplan.optics.layers.solids.straight_rays import Rays, ThickBody, rays_of
from microplan.optics.outline.distance_field import distance_field
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.microscope import Microscope

# Rays of all points of a lattice, and of one: `benchmarks/truth` measures what they
# leave.
_SAMPLES, _FEWEST, _MOST = 384_000, 512, 768
# Width of a ray, of its share's side. What two bodies leave of one ray is taken for
# the product, whose error rises as its square; narrower ones show that they are few.
_WIDTH = 0.6
MIRRORED = 256  # rays of the lamp that are followed past walls
_FOLLOWED, _SIDES = 2_400_000, (24, 32)  # in all, and roots of how many of a point
_AT_ONCE = 1 << 20  # rays traced at once: a limit to memory
_HASTY = 1.9  # reach of rays that are thinned: images change by .0005 rms at most
_LEAST = 3  # root of how many rays of a point are left at least
THIN = 4  # the power of `finer` that is left of rays, where none is given
# How far outside a body points are taken that lie in it: distances err by .35 um, and
# rays start .5 um wide on each side.
_OUT_UM = 0.7
_CLOSE_UM = 1.0  # more than distances of two points err by together


@dataclass(frozen=True, slots=True, kw_only=True)
class LightTable:
    """The share of the lamp's light at the points of a lattice."""

    lattice: Lattice
    share: Float32Array  # (rows, columns)
    beyond: LightTable | None = None  # outside the lattice; None: as at its border

    def at(self, x: Float32Array, y: Float32Array) -> Float32Array:
        """Return the share at the points nearest to world points, (...) um."""
        (left, top), k = self.lattice.corner_um, np.float32(1 / self.lattice.step_um)
        rows, columns = self.share.shape
        half = np.float32(0.5)
        across, down = x - np.float32(left), np.float32(top) - y
        across *= k
        across += half
        down *= k
        down += half
        column, row = np.maximum(across, 0), np.maximum(down, 0)
        at = np.minimum(row, rows - 1, out=row).astype(np.int32)
        at *= columns
        at += np.minimum(column, columns - 1, out=column).astype(np.int32)
        found: Float32Array = self.share.ravel().take(at)
        if self.beyond is not None:
            out = (across < 0) | (down < 0) | (across >= columns) | (down >= rows)
            found[out] = self.beyond.at(x[out], y[out])
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class SentLight:
    """What a face sends back as a dull one, by the share of the lamp's light on it."""

    reflectance: float
    finish: float
    table: LightTable | None = None  # None: all light arrives

    def __call__(self, x: Float32Array, y: Float32Array, /) -> Float32Array:
        """Return what is sent from world points, um."""
        if self.table is None:
            shape = np.broadcast(x, y).shape
            return np.full(shape, self.reflectance, dtype=np.float32)
        return np.float32(self.dull) * self.table.at(x, y)

    @property
    def dull(self) -> float:
        """Return the reflectance of what scatters."""
        return self.reflectance * (1 - self.finish)

    @property
    def mirrors(self) -> float:
        """Return the reflectance of what mirrors that higher bodies dim."""
        return 0.0 if self.table is None else self.reflectance * self.finish


@dataclass(frozen=True, slots=True, kw_only=True)
class SolidFace:
    """A body with what its face sends back."""

    body: ThickBody
    sends: SentLight


def is_solid(layers: Sequence[Layer]) -> bool:
    """Return whether any body has walls."""
    return any(_under_um(layer) < layer.z_um for layer in layers)


def solid_bodies(
    layers: Sequence[Layer], plane_um: float, area: Area, sharp_um: float
) -> list[tuple[Layer, ThickBody]]:
    """Return bodies that come near an area, about a plane; sharp ones near it."""
    found = []
    for layer in layers:
        distance = distance_field(layer.outline, area)
        if distance is not None:
            body = ThickBody(
                distance=distance,
                top_um=layer.z_um - plane_um,
                under_um=_under_um(layer) - plane_um,
                wall_reflectance=layer.wall_reflectance,
                is_sharp=abs(layer.z_um - plane_um) <= sharp_um,
            )
            found.append((layer, body))
    return found


def rays_from(
    lattice: Lattice,
    microscope: Microscope,
    count: int | None = None,
    *,
    all_over: bool = False,
    finer: float = 1.0,
) -> tuple[Rays, float]:
    """Return rays through a lattice's points, and their width a um of height.

    `all_over`: those of a point lie all over its cell, whose mean they have then.
    `finer`: below 1 they are `thinned`, and mirrored ones followed in longer steps.
    """
    (left, top), step = lattice.corner_um, lattice.step_um
    rows, columns = lattice.shape
    x, y = np.meshgrid(left + step * np.arange(columns), top - step * np.arange(rows))
    if count is None:
        count = straight_rays(lattice, finer)
    reach = 1.0 if finer >= 1 else _HASTY
    tangents = slopes(microscope, count)
    soft = _WIDTH * math.sqrt(math.pi / count) * microscope.blur_diameter_um(1.0) / 2
    rays = rays_of(np.stack([x.ravel(), y.ravel()], axis=1), tangents)
    rays = replace(rays, reach=reach)
    if all_over:
        across, up = np.float32(step) * _scattered(count)
        rays = replace(rays, x_um=rays.x_um + across, y_um=rays.y_um + up)
    return rays, soft


def straight_rays(lattice: Lattice, finer: float = 1.0, power: int = THIN) -> int:
    """Return how many rays of each point of a lattice are traced straight."""
    rows, columns = lattice.shape
    share = _SAMPLES // (rows * columns)
    return thinned(min(max(share, _FEWEST), _MOST), finer, power)


def mirrored_rays(lattice: Lattice, finer: float, power: int) -> int:
    """Return how many rays of each point of a lattice are followed past walls.

    The last two as in `thinned`.
    """
    rows, columns = lattice.shape
    side = math.isqrt(_FOLLOWED // (rows * columns))
    return thinned(min(max(side, _SIDES[0]), _SIDES[1]) ** 2, finer, power)


def thinned(rays: int, finer: float, power: int = THIN) -> int:
    """Return how many rays of a point are left where they are not all traced.

    A square number, as a power of `finer`: images of all rays are judges, and dear.
    """
    if finer >= 1:
        return rays
    side = max(round(math.sqrt(rays * finer**power)), _LEAST)
    return side * side


def bands(lattice: Lattice, rays: int) -> Iterator[Lattice]:
    """Yield the rows of a lattice, as many as memory holds with the rays of a point."""
    w = lattice.window
    most = max(_AT_ONCE // (rays * w.columns), 1)
    for first in range(0, w.rows, most):
        rows = min(most, w.rows - first)
        yield replace(lattice, window=replace(w, row=w.row + first, rows=rows))


@cache
def _scattered(count: int) -> Float32Array:
    """Return places in a cell for a square number of rays, (2, 1, count): -.5..0.5.

    In the middles of smaller cells, whatever the slopes are.
    """
    side = math.isqrt(count)
    at = (np.indices((side, side)).reshape(2, -1) + 0.5) / side - 0.5
    at = at[:, np.random.default_rng(count).permutation(count)]
    found: Float32Array = at[:, None].astype(np.float32)
    return found


def rays_outside(bodies: Sequence[ThickBody], rays: Rays) -> Rays:
    """Return rays through the nearest points outside bodies."""
    some, moved = rays_moved(bodies, rays)
    if not some.size:
        return rays
    return rays.with_some(some, moved)


def rays_moved(bodies: Sequence[ThickBody], rays: Rays) -> tuple[IntArray, Rays]:
    """Return which points' rays may start in bodies, and through the nearest outside.

    (K,) of the points, and the rays of these.
    """
    x, y = rays.x_um[:, :1], rays.y_um[:, :1]
    close_um = rays.apart_um[:, None] + np.float32(_OUT_UM + _CLOSE_UM)
    near = np.zeros(x.shape, dtype=np.bool_)
    for body in bodies:
        near |= body.distance.at(x, y) < close_um
    some = np.flatnonzero(near)
    rays = rays.some(some)
    x, y = rays.x_um, rays.y_um
    for body in bodies:
        inward = np.minimum(body.distance.at(x, y) - np.float32(_OUT_UM), 0)
        nx, ny = body.distance.normal(x, y)
        x, y = x - inward * nx, y - inward * ny
    return some, replace(rays, x_um=x, y_um=y)


def _under_um(layer: Layer) -> float:
    return layer.z_um if layer.underside_um is None else layer.underside_um
