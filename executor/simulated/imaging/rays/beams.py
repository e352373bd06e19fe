"""Beams of the pupil: each covers a cell of it, so that what bodies hide is smooth.

A ray stands for a cell of the pupil's pattern. At a height h from the plane where the
cells meet, its beam is `spread` |h| wide; a body that the ray passes at the signed
distance d hides the share 1/2 - d / width of it, between 0 and 1. Mirrored rays go on
as single rays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from microplan.executor.simulated.imaging.rays.marching import (
    FAINT,
    FaceHits,
    RayFan,
    Reals32,
    Solids,
    joined,
    march,
)
from microplan.executor.simulated.imaging.solids.solid_scene import MappedBody

THIN_UM = 0.3  # a beam's least width: of the order of a map's error
STEP_SHARE = 0.8  # of the free way; a beam's side comes nearer than its middle
LEAST_UM = 0.3  # step, at least
WIDTH_SHARE = 0.3  # of the beam's width, a step at least
MOST_STEPS = 120
AT_ONCE = 1 << 14  # beams that are followed together
KEPT_SHARE = 0.7  # rays that have arrived are put aside when they are many


@dataclass(eq=False)
class Beams:
    """Straight beams at one height, on their way down or up."""

    rays: RayFan  # weight: what is not hidden so far
    width: Reals32  # (N,) um, now
    hidden: dict[int, Reals32] = field(default_factory=dict)  # share by body, (N,)

    def pick(self, which: npt.NDArray[np.intp]) -> Beams:
        """Return some of the beams, by (M,) numbers without unit."""
        hidden = {body: share.take(which) for body, share in self.hidden.items()}
        return Beams(self.rays.pick(which), self.width.take(which), hidden)


@dataclass(frozen=True, eq=False)
class Passage:
    """What became of beams on a way."""

    beams: Beams  # that reach its end, straight
    bent: RayFan  # that reach its end, mirrored
    hits: list[FaceHits]  # that end on faces


def beams_from(rays: RayFan, height_um: float, spread: float) -> Beams:
    """Return beams through their common plane, begun `height_um` before or after it."""
    width = np.full(len(rays), max(abs(height_um) * spread, THIN_UM), np.float32)
    return Beams(rays.moved(height_um), width)


def pass_down(
    solids: Solids,
    beams: Beams,
    span: tuple[float, float],
    meet_um: float,
    spread: float,
    bent: RayFan | None = None,
) -> Passage:
    """Send beams down to just above the faces at the end of a span.

    Parameters
    ----------
    solids : Solids
        Bodies and stage.
    beams : Beams
        At the span's top, past the faces there.
    span : (float, float)
        World heights of its top and its end, um.
    meet_um : float
        Height at which a point's beams meet; not inside the span.
    spread : float
        Width of a beam per um of height.
    bent : RayFan or None
        Mirrored rays that go along.
    """
    from_um, to_um = span
    hits: list[FaceHits] = []
    bent = beams.rays.pick(slice(0)) if bent is None else bent
    levels = {b.top_um for b in solids.bodies} | {b.bottom_um for b in solids.bodies}
    between = sorted((z for z in levels if to_um < z < from_um), reverse=True)
    for high, low in zip([from_um, *between], [*between, to_um], strict=True):
        if high != from_um:
            found = meet_faces(solids, beams, high)
            bent, more = solids.meet_faces(bent, high)
            hits += found + more
            beams = _alive(beams)
        walls = solids.walls(low, high)
        bent = solids.through(bent, (low, high))
        beams, made = _slab(beams, high - low, walls, abs(low - meet_um) * spread)
        if len(made):
            bent = joined([bent, made])
    return Passage(beams, bent, hits)


def pass_up(
    solids: Solids, beams: Beams, from_um: float, spread: float
) -> tuple[Beams, RayFan]:
    """Return beams and mirrored rays that leave to the sky, from where beams meet."""
    levels = {b.top_um for b in solids.bodies} | {b.bottom_um for b in solids.bodies}
    between = sorted(z for z in levels if z > from_um)
    bent = beams.rays.pick(slice(0))
    if not between:
        return beams, bent
    for low, high in zip([from_um, *between[:-1]], between, strict=True):
        if low > from_um:
            for i, body in enumerate(solids.bodies):
                if body.bottom_um == low and body.top_um > low:
                    _hide(beams, i, _ratio(body, beams))
                    off = body.distance(bent.x, bent.y) >= 0
                    bent = bent.pick(off)
            beams = _alive(beams)
        walls = solids.walls(low, high)
        bent = solids.through(bent, (low, high))
        beams, made = _slab(beams, high - low, walls, (high - from_um) * spread)
        if len(made):
            bent = joined([bent, made])
    return beams, bent


def meet_faces(solids: Solids, beams: Beams, at_um: float) -> list[FaceHits]:
    """Take from beams what ends on faces at a height, and return it."""
    hits = []
    for i, body in enumerate(solids.bodies):
        if body.top_um == at_um and len(beams.width):
            before = beams.rays.weight.copy()
            _hide(beams, i, _ratio(body, beams))
            on = np.flatnonzero(before - beams.rays.weight > 0)
            part = beams.rays.pick(on)
            part.weight[:] = before.take(on) - part.weight
            hits.append(FaceHits(i, part))
    return hits


def _ratio(body: MappedBody, beams: Beams) -> Reals32:
    """Return distances over the beams' widths."""
    away = body.distance(beams.rays.x, beams.rays.y)
    ratio: Reals32 = (away / beams.width).astype(np.float32, copy=False)
    return ratio


def _hide(beams: Beams, index: int, ratio: Reals32) -> None:
    """Note what a body hides of beams, of which it may have hidden some before."""
    now = np.clip(np.float32(0.5) - ratio, 0, 1)
    before = beams.hidden.get(index)
    if before is None:
        beams.rays.weight[:] *= 1 - now
    else:
        now = np.maximum(now, before)
        beams.rays.weight[:] *= (1 - now) / np.maximum(1 - before, np.float32(1e-6))
    beams.hidden[index] = now


def _alive(beams: Beams) -> Beams:
    """Return the beams of which anything is left."""
    left = np.flatnonzero(beams.rays.weight > FAINT)
    return beams if len(left) == len(beams.width) else beams.pick(left)


def _slab(
    beams: Beams, height_um: float, walls: Sequence[tuple[int, MappedBody]], end: float
) -> tuple[Beams, RayFan]:
    """Send beams through a slab in which bodies have walls only.

    `end` is a beam's width at the slab's end. Mirrored rays come at the end, too.
    """
    end = max(end, THIN_UM)
    made: list[tuple[RayFan, Reals32]] = []
    ratios, first = {}, np.full(len(beams.width), np.inf, dtype=np.float32)
    by = np.full(len(beams.width), -1, dtype=np.int8)
    for i, wall in walls:
        ratio, entered = _least_ratio(beams, height_um, wall, end)
        ratios[i] = ratio
        sooner = entered < first
        first[sooner], by[sooner] = entered[sooner], i
    for i, wall in walls:
        if wall.body.wall_reflectance > 0:
            which = np.flatnonzero(by == i)
            made += _mirror(beams, height_um, (i, wall), which, first)
    for i, ratio in ratios.items():
        _hide(beams, i, ratio)
    moved = Beams(
        beams.rays.moved(height_um),
        np.full_like(beams.width, end),
        beams.hidden,
    )
    bent = beams.rays.pick(slice(0))
    if made:
        rays, left = joined([each for each, _ in made]), [each for _, each in made]
        bodies = [body for _, body in walls]
        bent = march(rays, np.concatenate(left), height_um, bodies)
    return _alive(moved), bent


def _least_ratio(
    beams: Beams, height_um: float, wall: MappedBody, end: float
) -> tuple[Reals32, Reals32]:
    """Return the least distance over width on the way, and where rays enter, um.

    A ray that begins inside enters nowhere: infinity.
    """
    count = len(beams.width)
    least = np.empty(count, dtype=np.float32)
    entered = np.full(count, np.inf, dtype=np.float32)
    if count:
        wide = float(beams.width[0])
        search = _BeamSearch(wall, height_um, wide, (end - wide) / height_um)
        for first in range(0, count, AT_ONCE):
            search.begin(beams.rays, slice(first, first + AT_ONCE), least)
            search.go_on(least, entered, AT_ONCE)
        search.go_on(least, entered, 0)
    return least, entered


class _BeamSearch:
    """Beams that look for the least distance to a wall, as many as a cache holds."""

    def __init__(
        self, wall: MappedBody, height_um: float, wide: float, grow: float
    ) -> None:
        self._wall, self._high = wall, np.float32(height_um)
        self._wide, self._grow = np.float32(wide), np.float32(grow)
        self._most = np.float32(max(wide, wide + grow * height_um) / 2)
        # one row each, so that beams that have arrived are put aside at once
        self._way = np.empty((9, 0), dtype=np.float32)
        self._which = np.empty(0, dtype=np.intp)

    def begin(self, rays: RayFan, part: slice, least: Reals32) -> None:
        """Take up those of some rays that come near the wall; note all distances."""
        slope_x, slope_y = rays.slope_x[part], rays.slope_y[part]
        i, j = self._wall.cells(rays.x[part], rays.y[part])
        away = self._wall.distances.quick_at(i, j)
        speed = np.sqrt(slope_x * slope_x + slope_y * slope_y)
        np.maximum(speed, np.float32(1e-6), out=speed)
        low = away / self._wide
        least[part] = low
        near = np.flatnonzero((away < speed * self._high + self._most) & (low > -0.5))
        if not len(near):
            return
        along_i, along_j = self._wall.cell_slopes(
            slope_x.take(near), slope_y.take(near)
        )
        away = away.take(near)
        way = np.empty((9, len(near)), dtype=np.float32)
        way[0], way[1] = i.take(near), j.take(near)
        way[2], way[3] = along_i, along_j
        way[4], way[5], way[6] = speed.take(near), away, low.take(near)
        way[7], way[8] = away >= 0, 0.0
        self._way = np.concatenate([self._way, way], axis=1)
        self._which = np.concatenate([self._which, near + part.start])

    def go_on(self, least: Reals32, entered: Reals32, until: int) -> None:
        """Step on until no more than so many beams are on their way."""
        high, wide, grow = self._high, self._wide, self._grow
        slowest = high / np.float32(MOST_STEPS)
        while len(self._which) > until:
            i, j, along_i, along_j, speed, away, low, outside, done = self._way
            step = grow * done
            step += wide
            step *= np.float32(WIDTH_SHARE)
            np.maximum(step, np.float32(LEAST_UM), out=step)
            np.maximum(step, np.float32(STEP_SHARE) * np.abs(away), out=step)
            step /= speed
            np.maximum(step, slowest, out=step)
            done += step
            np.minimum(done, high, out=done)
            away[:] = self._wall.distances.quick_at(
                i + done * along_i, j + done * along_j
            )
            width = grow * done
            width += wide
            np.minimum(low, away / width, out=low)
            new = np.flatnonzero(away < outside * np.float32(1e-30))
            new = new[outside.take(new) > 0]
            if len(new):
                entered[self._which.take(new)] = done.take(new)
                outside[new] = 0
            left = high - done
            going = left * speed
            going += self._most
            on = (away < going) & (left > 1e-4) & (low > -0.5)
            if np.count_nonzero(on) < KEPT_SHARE * len(on):
                off = np.flatnonzero(~on)
                least[self._which.take(off)] = low.take(off)
                keep = np.flatnonzero(on)
                self._way = self._way.take(keep, axis=1)
                self._which = self._which.take(keep)


def _mirror(
    beams: Beams,
    height_um: float,
    numbered: tuple[int, MappedBody],
    which: npt.NDArray[np.intp],
    first: Reals32,
) -> Iterator[tuple[RayFan, Reals32]]:
    """Yield rays that a wall mirrors, and what they have left of a slab, um."""
    if not len(which):
        return
    (index, wall), rays = numbered, beams.rays.pick(which)
    done = first.take(which)
    x, y = rays.x + done * rays.slope_x, rays.y + done * rays.slope_y
    deep, nx, ny = wall.surface(x, y)
    deep = np.minimum(deep, 0)
    inward = rays.slope_x * nx + rays.slope_y * ny
    hidden = beams.hidden.get(index)
    before = 0 if hidden is None else hidden.take(which)
    weight = rays.weight / np.maximum(1 - before, np.float32(0.5))
    weight *= np.float32(wall.body.wall_reflectance)
    bent = RayFan(
        (x - 2 * deep * nx).astype(np.float32),
        (y - 2 * deep * ny).astype(np.float32),
        (rays.slope_x - 2 * inward * nx).astype(np.float32),
        (rays.slope_y - 2 * inward * ny).astype(np.float32),
        weight.astype(np.float32),
        rays.owner,
    )
    good = np.flatnonzero((inward < 0) & (weight > FAINT))
    left = (np.float32(height_um) - done).take(good)
    yield bent.pick(good), left
