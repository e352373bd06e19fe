"""Rays through solid bodies: they meet faces, are lost on walls, or mirrored."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from microplan.arrays import BoolArray, IntArray
from microplan.executor.simulated.imaging.solids.solid_scene import MappedBody

STAGE = -1  # as the index of a body: what lies under all of them
LEAST_STEP_UM = 0.25  # along a wall; of the order of a map's pitch
PATH_SHARE = 0.02  # a step is at least so much of a path: corners are cut so far
MOST_STEPS = 160
MOST_BOUNCES = 40
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
    bounced: BoolArray  # whether a wall mirrored it

    def __len__(self) -> int:
        return len(self.x)

    def pick(self, which: BoolArray | IntArray | slice) -> RayFan:
        """Return some of the rays, by (M,) numbers or (N,) bool."""
        return RayFan(
            self.x[which], self.y[which], self.slope_x[which], self.slope_y[which],
            self.weight[which], self.owner[which], self.bounced[which],
        )  # fmt: skip

    def moved(self, height_um: float) -> RayFan:
        """Return the rays so much height farther on their ways, through anything."""
        step = np.float32(height_um)
        return RayFan(
            self.x + step * self.slope_x, self.y + step * self.slope_y,
            self.slope_x, self.slope_y, self.weight, self.owner, self.bounced,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class FaceHits:
    """Rays that end on one top face, or on the stage."""

    face: int  # index of the body, or STAGE
    rays: RayFan  # where they end


def joined(fans: Sequence[RayFan]) -> RayFan:
    """Return all rays of several fans."""
    names = ("x", "y", "slope_x", "slope_y", "weight", "owner", "bounced")
    return RayFan(*(np.concatenate([getattr(f, n) for f in fans]) for n in names))


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

    def end(self, rays: RayFan, from_um: float) -> list[FaceHits]:
        """Return where rays end that go down from a height; faces there are met."""
        rays, hits = self.meet_faces(rays, from_um)
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
    done = []
    for now, now_left in _chunks(rays, left):
        done += list(_march_chunk(now, now_left, height_um, walls))
    return joined(done) if done else rays.pick(slice(0))


def _chunks(rays: RayFan, left: Reals32) -> Iterator[tuple[RayFan, Reals32]]:
    """Yield rays in numbers that stay in the processor's cache."""
    most = 1 << 16
    for first in range(0, len(rays), most):
        which = np.arange(first, min(first + most, len(rays)))
        yield rays.pick(which), left[which]


def _march_chunk(
    rays: RayFan, left: Reals32, height_um: float, walls: Sequence[MappedBody]
) -> Iterator[RayFan]:
    """Yield rays that came through, step by step as far as no wall can be."""
    mirrors = any(wall.body.wall_reflectance > 0 for wall in walls)
    speed = np.maximum(np.hypot(rays.slope_x, rays.slope_y), np.float32(1e-6))
    least = np.maximum(np.float32(LEAST_STEP_UM), PATH_SHARE * height_um * speed)
    for _ in range(MOST_STEPS):
        free, nearest = _distances(rays, walls)
        through = free >= speed * left
        if through.any():
            part = rays.pick(through)
            ahead = left[through]
            yield _stepped(part, ahead)
        going = ~through
        if mirrors:
            rays, lost = _mirrored(rays, free, nearest, walls)
            going &= ~lost
            ended = going & (left <= 0)
            yield rays.pick(ended)
            going &= ~ended
        else:
            going &= free >= 0
        step = np.minimum(np.maximum(free, least) / speed, left)
        rays = _stepped(rays.pick(going), step[going])
        left = left[going] - step[going]
        speed, least = speed[going], least[going]
        if not len(rays):
            return
    if mirrors:  # between two near walls: light that is mirrored is not lost
        yield _stepped(rays, left)


def _distances(
    rays: RayFan, walls: Sequence[MappedBody]
) -> tuple[Reals32, npt.NDArray[np.int8]]:
    """Return distances to the nearest wall, and whose it is."""
    free = walls[0].distance(rays.x, rays.y)
    nearest = np.zeros(len(rays), dtype=np.int8)
    for i, wall in enumerate(walls[1:], start=1):
        other = wall.distance(rays.x, rays.y)
        nearer = other < free
        free = np.where(nearer, other, free)
        nearest[nearer] = i
    return free.astype(np.float32, copy=False), nearest


def _stepped(rays: RayFan, height: Reals32) -> RayFan:
    """Return rays farther on their ways, each by a height of its own."""
    return RayFan(
        rays.x + height * rays.slope_x, rays.y + height * rays.slope_y,
        rays.slope_x, rays.slope_y, rays.weight, rays.owner, rays.bounced,
    )  # fmt: skip


def _mirrored(
    rays: RayFan,
    free: Reals32,
    nearest: npt.NDArray[np.int8],
    walls: Sequence[MappedBody],
) -> tuple[RayFan, BoolArray]:
    """Mirror what entered a wall; return all rays, and which of them are lost."""
    lost = np.zeros(len(rays), dtype=bool)
    if not (free < 0).any():
        return rays, lost
    slope_x, slope_y = rays.slope_x.copy(), rays.slope_y.copy()
    weight, bounced = rays.weight.copy(), rays.bounced.copy()
    x, y = rays.x.copy(), rays.y.copy()
    for i, wall in enumerate(walls):
        at = np.flatnonzero((free < 0) & (nearest == i))
        nx, ny = wall.normal(x[at], y[at])
        inward = slope_x[at] * nx + slope_y[at] * ny
        hit = inward < 0  # the others are on their way out
        at, nx, ny, inward = at[hit], nx[hit], ny[hit], inward[hit]
        slope_x[at] -= 2 * inward * nx
        slope_y[at] -= 2 * inward * ny
        # out of the wall, as deep as it is in: the mirrored path to that depth
        deep = np.minimum(wall.distance(x[at], y[at], exact=True), 0)
        x[at] -= 2 * deep * nx
        y[at] -= 2 * deep * ny
        weight[at] *= np.float32(wall.body.wall_reflectance)
        bounced[at] = True
        lost[at] = weight[at] < FAINT
    made = RayFan(x, y, slope_x, slope_y, weight, rays.owner, bounced)
    return made, lost
