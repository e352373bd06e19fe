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
    made: list[RayFan] = []
    ratios, first = {}, np.full(len(beams.width), np.inf, dtype=np.float32)
    by = np.full(len(beams.width), -1, dtype=np.int8)
    for i, wall in walls:
        ratio, entered = _least_ratio(beams, height_um, wall, end)
        ratios[i] = ratio
        sooner = entered < first
        first[sooner], by[sooner] = entered[sooner], i
    for i, wall in walls:
        if wall.body.wall_reflectance > 0:
            made += list(
                _mirror(beams, height_um, walls, i, np.flatnonzero(by == i), first)
            )
    for i, ratio in ratios.items():
        _hide(beams, i, ratio)
    moved = Beams(
        beams.rays.moved(height_um),
        np.full_like(beams.width, end),
        beams.hidden,
    )
    bent = joined(made) if made else beams.rays.pick(slice(0))
    return _alive(moved), bent


def _least_ratio(
    beams: Beams, height_um: float, wall: MappedBody, end: float
) -> tuple[Reals32, Reals32]:
    """Return the least distance over width on the way, and where rays enter, um.

    A ray that begins inside enters nowhere: infinity.
    """
    rays, count = beams.rays, len(beams.width)
    entered = np.full(count, np.inf, dtype=np.float32)
    if not count:
        return entered.copy(), entered
    wide, high = beams.width[0], np.float32(height_um)
    grow, most = np.float32(end - wide) / high, np.float32(max(float(wide), end) / 2)
    speed = np.maximum(np.hypot(rays.slope_x, rays.slope_y), np.float32(1e-6))
    away = wall.distance(rays.x, rays.y)
    least: Reals32 = (away / wide).astype(np.float32)
    near = np.flatnonzero((away < speed * high + most) & (least > -0.5))
    # one row each, so that rays that have arrived are put aside at once
    way = np.array(
        [rays.x, rays.y, rays.slope_x, rays.slope_y, speed, away, least, away >= 0],
        dtype=np.float32,
    ).take(near, axis=1)
    way = np.vstack([way, np.zeros(len(near), dtype=np.float32)])
    for _ in range(MOST_STEPS):
        if not len(near):
            break
        x, y, slope_x, slope_y, speed, away, low, outside, done = way
        shortest = np.maximum(LEAST_UM, WIDTH_SHARE * (wide + grow * done))
        step = np.maximum(np.float32(STEP_SHARE) * np.abs(away), shortest)
        step = np.minimum(step / speed, high - done)
        x += step * slope_x
        y += step * slope_y
        done += step
        away[:] = wall.distance(x, y)
        np.minimum(low, away / (wide + grow * done), out=low)
        new = np.flatnonzero((outside > 0) & (away < 0))
        entered[near[new]] = np.minimum(entered[near[new]], done[new])
        left = high - done
        going = (left > 1e-4) & (low > -0.5) & (away < speed * left + most)
        if np.count_nonzero(going) < KEPT_SHARE * len(going):
            least[near[~going]] = low[~going]
            keep = np.flatnonzero(going)
            near, way = near.take(keep), way.take(keep, axis=1)
    least[near] = way[6]
    return least, entered


def _mirror(
    beams: Beams,
    height_um: float,
    walls: Sequence[tuple[int, MappedBody]],
    index: int,
    which: npt.NDArray[np.intp],
    first: Reals32,
) -> Iterator[RayFan]:
    """Yield rays that a wall mirrors, at the slab's end."""
    if not len(which):
        return
    wall, rays = dict(walls)[index], beams.rays.pick(which)
    done = first.take(which)
    x, y = rays.x + done * rays.slope_x, rays.y + done * rays.slope_y
    nx, ny = wall.normal(x, y)
    inward = rays.slope_x * nx + rays.slope_y * ny
    deep = np.minimum(wall.distance(x, y, exact=True), 0)
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
        np.ones(len(which), dtype=bool),
    )
    good = np.flatnonzero((inward < 0) & (weight > FAINT))
    left = (np.float32(height_um) - done).take(good)
    bodies = [body for _, body in walls]
    yield march(bent.pick(good), left, height_um, bodies)
