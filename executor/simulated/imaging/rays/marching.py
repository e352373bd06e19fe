"""Rays through solid bodies: they meet faces, are lost on walls, or mirrored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from microplan.arrays import BoolArray, FloatArray, IntArray
from microplan.executor.simulated.imaging.solids.solid_scene import MappedBody

STAGE = -1  # as the index of a body: what lies under all of them
LEAST_STEP_UM = 0.5  # along a wall; what is deeper in is mirrored out as deep
PATH_SHARE = 0.04  # a step is at least so much of a path: corners are cut so far
AT_ONCE = 1 << 15  # rays that are followed together
FAINT = 1e-3  # a ray that carries less is dropped

Reals32 = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class RayFan:
    """Rays at one height, (N,) each; positions from the image's middle.

    Slopes are um sideways per um of height on the way that the rays go.
    """

    x: Reals32
    y: Reals32
    slope_x: Reals32
    slope_y: Reals32
    weight: Reals32  # what mirrors left of the light
    owner: npt.NDArray[np.int32]  # the ray of the camera that it comes from

    def __len__(self) -> int:
        return len(self.x)

    def pick(self, which: BoolArray | IntArray | slice) -> RayFan:
        """Return some of the rays, by (M,) numbers or (N,) bool."""
        return RayFan(
            self.x[which], self.y[which], self.slope_x[which], self.slope_y[which],
            self.weight[which], self.owner[which],
        )  # fmt: skip

    def moved(self, height_um: float) -> RayFan:
        """Return the rays so much height farther on their ways, through anything."""
        step = np.float32(height_um)
        return RayFan(
            self.x + step * self.slope_x, self.y + step * self.slope_y,
            self.slope_x, self.slope_y, self.weight, self.owner,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class FaceHits:
    """Rays that end on one top face, or on the stage."""

    face: int  # index of the body, or STAGE
    rays: RayFan  # where they end


def joined(fans: Sequence[RayFan]) -> RayFan:
    """Return all rays of several fans."""
    names = ("x", "y", "slope_x", "slope_y", "weight", "owner")
    return RayFan(*(np.concatenate([getattr(f, n) for f in fans]) for n in names))


def fan_through(x: FloatArray, y: FloatArray, slopes: FloatArray) -> RayFan:
    """Return rays of all slopes, (count, 2), through each point, (N,) um.

    Ray i * count + k goes through point i along slope k, and is its own owner.
    """
    many, count = len(x), len(slopes)
    total = many * count
    return RayFan(
        np.repeat(x.astype(np.float32), count),
        np.repeat(y.astype(np.float32), count),
        np.tile(slopes[:, 0].astype(np.float32), many),
        np.tile(slopes[:, 1].astype(np.float32), many),
        np.ones(total, dtype=np.float32),
        np.arange(total, dtype=np.int32),
    )


@dataclass(frozen=True, eq=False)
class Solids:
    """The bodies that rays go through, and the stage under them."""

    bodies: tuple[MappedBody, ...]
    stage_um: float

    @property
    def sky_um(self) -> float:
        """Return a height above everything."""
        return max([self.stage_um, *(b.top_um for b in self.bodies)]) + 1.0

    def descend(
        self, rays: RayFan, from_um: float, to_um: float
    ) -> tuple[RayFan, list[FaceHits]]:
        """Send rays down, to just above the faces at `to_um`.

        Faces at `from_um` are not met either.

        Returns
        -------
        rays : RayFan
            Those that reach `to_um`.
        hits : list of FaceHits
            Those that end on a face between.
        """
        hits: list[FaceHits] = []
        levels = [b.top_um for b in self.bodies] + [b.bottom_um for b in self.bodies]
        between = sorted({z for z in levels if to_um < z < from_um}, reverse=True)
        for high, low in zip([from_um, *between], [*between, to_um], strict=True):
            if high != from_um:
                rays, found = self.meet_faces(rays, high)
                hits += found
            rays = self.through(rays, (low, high))
        return rays, hits

    def meet_faces(self, rays: RayFan, at_um: float) -> tuple[RayFan, list[FaceHits]]:
        """Return which rays go on below faces at a height, and which end there."""
        hits: list[FaceHits] = []
        for i, body in enumerate(self.bodies):
            if body.top_um == at_um and len(rays):
                on = body.distance(rays.x, rays.y) < 0
                hits.append(FaceHits(i, rays.pick(on)))
                rays = rays.pick(~on)
        return rays, hits

    def meet_softly(
        self, rays: RayFan, at_um: float, edge_um: float
    ) -> tuple[RayFan, list[FaceHits]]:
        """Do as `meet_faces` does, with faces' edges drawn as ramps so wide."""
        hits: list[FaceHits] = []
        for i, body in enumerate(self.bodies):
            if body.top_um == at_um and len(rays):
                away = body.distance(rays.x, rays.y, exact=True).astype(np.float32)
                share = np.clip(np.float32(0.5) - away / np.float32(edge_um), 0, 1)
                on, off = share > 0, share < 1
                hits.append(
                    FaceHits(i, replace(rays, weight=rays.weight * share).pick(on))
                )
                rays = replace(rays, weight=rays.weight * (1 - share)).pick(off)
        return rays, hits

    def end(self, rays: RayFan, from_um: float, edge_um: float) -> list[FaceHits]:
        """Return where rays end that go down from a height; faces there are met."""
        rays, hits = self.meet_softly(rays, from_um, edge_um)
        if from_um > self.stage_um:
            rays, found = self.descend(rays, from_um, self.stage_um)
            rays, last = self.meet_faces(rays, self.stage_um)
            hits = [*hits, *found, *last]
        return [*hits, FaceHits(STAGE, rays)]

    def ascend(self, rays: RayFan, from_um: float) -> RayFan:
        """Return the rays that leave to the sky, going up from a height."""
        levels = [b.top_um for b in self.bodies] + [b.bottom_um for b in self.bodies]
        between = sorted({z for z in levels if z > from_um})
        if not between:
            return rays
        for body in self.crossing(from_um):
            rays = rays.pick(body.distance(rays.x, rays.y) >= 0)
        for low, high in zip([from_um, *between[:-1]], between, strict=True):
            for body in self.bodies:
                if body.bottom_um == low > from_um and body.top_um > low:
                    rays = rays.pick(body.distance(rays.x, rays.y) >= 0)
            rays = self.through(rays, (low, high))
        return rays

    def crossing(self, at_um: float) -> list[MappedBody]:
        """Return the bodies that are in the plane just above a height."""
        return [b for b in self.bodies if b.bottom_um <= at_um < b.top_um]

    def through(self, rays: RayFan, span: tuple[float, float]) -> RayFan:
        """Return what comes through a slab in which bodies have walls only."""
        low, high = span
        walls = [body for _, body in self.walls(low, high)]
        if not walls or not len(rays):
            return rays.moved(high - low)
        left = np.full(len(rays), high - low, dtype=np.float32)
        return march(rays, left, high - low, walls)

    def walls(self, low: float, high: float) -> list[tuple[int, MappedBody]]:
        """Return the bodies, and their numbers, that have walls all through a slab."""
        return [
            (i, body)
            for i, body in enumerate(self.bodies)
            if body.bottom_um <= low < high <= body.top_um
        ]


def march(
    rays: RayFan, left: Reals32, height_um: float, walls: Sequence[MappedBody]
) -> RayFan:
    """Send rays through what is left of a slab of walls, of `height_um` in all.

    Those that end on a wall are left out.
    """
    way = _March(walls, height_um)
    for first in range(0, len(rays), AT_ONCE):
        way.begin(rays, left, slice(first, first + AT_ONCE))
        way.go_on(AT_ONCE)
    way.go_on(0)
    if not way.arrived:
        return rays.pick(slice(0))
    x, y, slope_x, slope_y, weight = np.concatenate(way.arrived, axis=1)
    owner = rays.owner.take(np.concatenate(way.numbers))
    return RayFan(x, y, slope_x, slope_y, weight, owner)


class _March:
    """Rays on their way past walls, as many together as a cache holds."""

    def __init__(self, walls: Sequence[MappedBody], height_um: float) -> None:
        self._walls, self._height_um = walls, height_um
        self._mirrors = any(wall.body.wall_reflectance > 0 for wall in walls)
        # x, y, slopes, weight, what is left of the height, speed, least step
        self._rows = np.empty((8, 0), dtype=np.float32)
        self._which = np.empty(0, dtype=np.intp)
        self.arrived: list[Reals32] = []  # the first five rows
        self.numbers: list[npt.NDArray[np.intp]] = []

    def begin(self, rays: RayFan, left: Reals32, part: slice) -> None:
        """Take up some rays."""
        x, slope_x, slope_y = rays.x[part], rays.slope_x[part], rays.slope_y[part]
        speed = np.maximum(np.hypot(slope_x, slope_y), np.float32(1e-6))
        least = np.maximum(
            np.float32(LEAST_STEP_UM), np.float32(PATH_SHARE * self._height_um) * speed
        )
        rows = np.array(
            [
                x, rays.y[part], slope_x, slope_y, rays.weight[part], left[part],
                speed, least,
            ],
            dtype=np.float32,
        )  # fmt: skip
        self._rows = np.concatenate([self._rows, rows], axis=1)
        self._which = np.concatenate([self._which, part.start + np.arange(len(x))])

    def go_on(self, until: int) -> None:
        """Step as far as no wall can be, until no more than so many are on the way."""
        while len(self._which) > until:
            x, y, slope_x, slope_y, weight, left, speed, least = self._rows
            free, nearest = _distances(x, y, self._walls)
            ended = free >= speed * left
            lost = free < 0
            if self._mirrors and lost.any():
                self._mirror(np.flatnonzero(lost), nearest)
                lost = weight < FAINT
                ended |= left <= 0
            ended |= lost
            if ended.any():
                self._put_aside(ended, lost)
                free = free[~ended]
                x, y, slope_x, slope_y, weight, left, speed, least = self._rows
            step = np.maximum(free, least)
            step /= speed
            np.minimum(step, left, out=step)
            x += step * slope_x
            y += step * slope_y
            left -= step

    def _put_aside(self, ended: BoolArray, lost: BoolArray) -> None:
        """Note rays that came through, and forget them and those that are lost."""
        out = np.flatnonzero(ended & ~lost)
        if len(out):
            rows = self._rows.take(out, axis=1)
            rows[0] += rows[5] * rows[2]
            rows[1] += rows[5] * rows[3]
            self.arrived.append(rows[:5])
            self.numbers.append(self._which.take(out))
        keep = np.flatnonzero(~ended)
        self._rows = self._rows.take(keep, axis=1)
        self._which = self._which.take(keep)

    def _mirror(self, entered: IntArray, nearest: npt.NDArray[np.int8]) -> None:
        """Mirror what entered a wall."""
        rows = self._rows
        of = nearest.take(entered)
        for i, wall in enumerate(self._walls):
            at = entered if len(self._walls) == 1 else entered[of == i]
            x, y, slope_x, slope_y, weight = rows[:5].take(at, axis=1)
            deep, nx, ny = wall.surface(x, y)
            inward = slope_x * nx + slope_y * ny
            hit = (inward < 0).astype(np.float32)  # the others are on their way out
            twice = 2 * hit * inward
            # out of the wall, as deep as it is in: the mirrored path to that depth
            deep = 2 * hit * np.minimum(deep, 0)
            share = np.float32(wall.body.wall_reflectance)
            rows[0, at] = x - deep * nx
            rows[1, at] = y - deep * ny
            rows[2, at] = slope_x - twice * nx
            rows[3, at] = slope_y - twice * ny
            rows[4, at] = weight * (1 - hit * (1 - share))


def _distances(
    x: Reals32, y: Reals32, walls: Sequence[MappedBody]
) -> tuple[Reals32, npt.NDArray[np.int8]]:
    """Return distances to the nearest wall at (N,) um points, and whose it is."""
    free = walls[0].distance(x, y).astype(np.float32, copy=False)
    nearest = np.zeros(len(x), dtype=np.int8)
    for i, wall in enumerate(walls[1:], start=1):
        other = wall.distance(x, y).astype(np.float32, copy=False)
        nearest[other < free] = i
        np.minimum(free, other, out=free)
    return free, nearest
