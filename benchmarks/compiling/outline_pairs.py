"""Random pegs and holes, with draws of whether one goes into the other.

Nothing here comes from the planner but the types of what it is asked: whether a peg is
inside is found point by point, in outlines of exact arcs cut where they turn back.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from benchmarks.compiling.outline_shapes import GAPS, SEVERAL, hollow, outlines
from microplan.arrays import BoolArray, FloatArray
from microplan.optics.outline.offset import offset
from microplan.optics.outline.outline import Arc, Edge, Outline, Segment
from microplan.planner.assembly.fits.peg_in_hole import PegInHole
from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.budget.probability.ellipse_probability import PlaneNormal
from microplan.planner.budget.probability.fit_probability import Residual
from microplan.planner.budget.probability.outline_fit import (
    OutlineFit,
    PoseError,
)
from microplan.planner.budget.probability.polygon_mass import PlaneError
from microplan.schemas.plan.verdicts import TurnRow

ALONG = 24  # points along the longest edge
AROUND = 180  # and around a circle
BATCHES = 400  # sizes as fabricated that are drawn


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """A fit, an error, and which of the poses that go in are the planned one."""

    family: str
    fit: OutlineFit
    error: PoseError
    planned: Callable[[FloatArray], BoolArray]  # (N, 3) um, um, rad -> (N,)


def draw_pair(family: str, rng: np.random.Generator) -> Pair:
    """Return a random pair, its errors about as large as its clearance."""
    size = float(10 ** rng.uniform(0, 1.5))
    gap = float(size * rng.uniform(*GAPS.get(family, (0.02, 0.1))))
    hole, peg = outlines(family, rng, size, gap)
    several = family in SEVERAL and family != "dumbbell"
    turned = float(rng.uniform(-0.3, 0.3)) * gap / size
    fit = OutlineFit(
        shape=PegInHole(hole=hollow(hole), peg=peg, angle_rad=turned),
        hole_tolerance_um=float(gap * rng.choice([0.0, 0.2])),
        shaft_tolerance_um=float(gap * rng.choice([0.0, 0.3])),
        taper_um=float(gap * rng.choice([0.0, 0.1])),
    )
    return Pair(
        family=family,
        fit=fit,
        error=_error(rng, size, gap, wide=several, far=family == "dumbbell"),
        planned=_planned(family, fit, size),
    )


def _error(
    rng: np.random.Generator, size: float, gap: float, *, wide: bool, far: bool
) -> PoseError:
    """Return errors; `wide` in the angle, `far` along x."""
    narrow, broad = gap * rng.uniform(0.2, 0.9, 2)
    if far:
        broad = 1.2 * size
    way = 0.0 if far else rng.uniform(0, math.pi)
    rest = PlaneNormal.along(float(narrow), None).plus(
        PlaneNormal.along(float(broad), float(way))
    )
    cut = gap * rng.uniform(0.4, 1.2)
    left = Residual(sigma_um=float(0.8 * cut), within_um=float(cut))
    sigma = gap / size * rng.uniform(0.2, 0.8)
    if wide:
        sigma = float(rng.uniform(0.5, 1.0))
    stops = not wide and rng.random() < 0.4
    row = TurnRow(term="drawn", sigma_rad=float(sigma), source="drawn")
    lever = rng.normal(0, 0.5 * size, 2) * (not wide)
    return PoseError(
        plane=PlaneError(
            residual=left if rng.random() < 0.5 else Residual(sigma_um=0, within_um=0),
            rest=PlaneNormal(
                middle_um=(float(gap * rng.normal(0, 0.3)), 0.0),
                xx_um2=rest.xx_um2, xy_um2=rest.xy_um2, yy_um2=rest.yy_um2,
            ),
        ),
        angle=AngleError(
            left_rad=float(sigma) if stops else 0.0,
            cut_rad=float(sigma * rng.uniform(0.5, 2)) if stops else math.inf,
            rows=(row,),
        ),
        lever_um=(float(lever[0]), float(lever[1])),
        middle_rad=float(0.2 * sigma * rng.normal()) * (not wide),
    )  # fmt: skip


def _planned(
    family: str, fit: OutlineFit, size: float
) -> Callable[[FloatArray], BoolArray]:
    """Return which poses that go in hang together with the planned one."""
    counts = {"cross": 4, "square": 4, "hexagon": 6}
    counts["spline"] = (
        sum(isinstance(e, Arc) for e in fit.shape.peg.rings[0].edges) // 2
    )
    half = math.pi / counts.get(family, 1)

    def planned(poses: FloatArray) -> BoolArray:
        x, _, turn = poses.T
        near: BoolArray = x < size
        if family != "dumbbell":
            near = np.abs(np.remainder(turn + np.pi, 2 * np.pi) - np.pi) < half
        return near

    return planned


def draw_poses(error: PoseError, count: int, rng: np.random.Generator) -> FloatArray:
    """Return poses of the peg, (count, 3) um, um, rad."""
    rest, angle = error.plane.rest, error.angle
    cov = np.array([[rest.xx_um2, rest.xy_um2], [rest.xy_um2, rest.yy_um2]])
    place = rng.multivariate_normal(rest.middle_um, cov, count)
    place += _cut_off(error.plane.residual, count, rng)
    turn = rng.normal(0, angle.rest_rad, count)
    left = rng.normal(0, angle.left_rad, 20 * count)
    turn += left[np.abs(left) < angle.cut_rad][:count]
    place += turn[:, None] * np.array(error.lever_um)
    return np.column_stack([place, turn + error.middle_rad])


def _cut_off(residual: Residual, count: int, rng: np.random.Generator) -> FloatArray:
    """Return what a servo leaves, (count, 2) um."""
    found = rng.normal(0, residual.sigma_um, (20 * count, 2))
    kept: FloatArray = found[np.hypot(*found.T) <= residual.within_um][:count]
    return kept


@dataclass(frozen=True, slots=True)
class Drawn:
    """Shares of draws, with their standard errors."""

    seated: float
    seated_error: float
    inside: float
    inside_error: float


def draw(
    pair: Pair, count: int, rng: np.random.Generator, batches: int = BATCHES
) -> Drawn:
    """Return the shares of `count` draws that go in, as planned and at all.

    Sizes are drawn anew in each batch; the error is that of the batches' mean.
    """
    shares = []
    for _ in range(batches):
        hole, peg = _as_made(pair.fit, rng)
        poses = draw_poses(pair.error, count // batches, rng)
        inside = goes_in(hole, peg, poses, pair.fit.shape.angle_rad)
        shares.append([(inside & pair.planned(poses)).mean(), inside.mean()])
    (seated, inside), errors = np.mean(shares, axis=0), np.std(shares, axis=0, ddof=1)
    seated_error, inside_error = errors / math.sqrt(batches)
    return Drawn(float(seated), float(seated_error), float(inside), float(inside_error))


def _as_made(fit: OutlineFit, rng: np.random.Generator) -> tuple[Outline, Outline]:
    """Return the hole's ring and the peg with drawn offsets."""
    in_hole = fit.taper_um + fit.hole_tolerance_um * rng.uniform(-1, 1)
    on_peg = fit.shaft_tolerance_um * rng.uniform(-1, 1)
    return offset(fit.shape.hole, in_hole), offset(fit.shape.peg, on_peg)


def goes_in(
    hole: Outline, peg: Outline, poses: FloatArray, turned_rad: float = 0.0
) -> BoolArray:
    """Return whether the peg is inside the hole at each pose, (N,).

    No point of the peg's ring may be outside the hole, none of the hole's inside the
    peg.
    """
    angle = poses[:, 2] + turned_rad
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = poses[:, :1], poses[:, 1:2]
    found = np.ones(len(poses), dtype=bool)
    px, py = boundary(peg).T
    for part in np.array_split(np.arange(len(px)), 4):
        go = np.flatnonzero(found)
        at = (c[go] * px[part] - s[go] * py[part] + x[go],
              s[go] * px[part] + c[go] * py[part] + y[go])  # fmt: skip
        found[go] = encloses(hole, *at).all(axis=1)
    go = np.flatnonzero(found)
    hx, hy = boundary(hole).T[:, None] - poses[go, :2].T[:, :, None]
    at = c[go] * hx + s[go] * hy, c[go] * hy - s[go] * hx
    found[go] = ~encloses(peg, *at).any(axis=1)
    return found


def boundary(outline: Outline) -> FloatArray:
    """Return points of a ring, corners among them, (N, 2) um, well mixed."""
    edges = outline.rings[0].edges
    longest = max(edge.length_um for edge in edges)
    points = []
    for edge in edges:
        if isinstance(edge, Arc):
            count = math.ceil(AROUND * abs(edge.sweep_rad) / math.tau)
            points += [edge.at(k / count) for k in range(count)]
        else:
            count = math.ceil(ALONG * edge.length_um / longest)
            (ax, ay), (bx, by) = edge.start, edge.end
            points += [
                (ax + (bx - ax) * k / count, ay + (by - ay) * k / count)
                for k in range(count)
            ]
    order = np.random.default_rng(0).permutation(len(points))
    return np.array(points)[order]


def encloses(outline: Outline, x: FloatArray, y: FloatArray) -> BoolArray:
    """Return whether points are inside a ring: rays to the right cross it oddly."""
    inside = np.zeros(x.shape, dtype=bool)
    for edge in outline.rings[0].edges:
        for low, high, at in rising_parts(edge):
            hit = (y >= low) & (y < high)
            inside[hit] ^= at(y[hit]) > x[hit]
    return inside


Part = tuple[float, float, Callable[[FloatArray], FloatArray]]


def rising_parts(edge: Edge) -> list[Part]:
    """Return parts of an edge over which y rises or falls: y from, to, and x(y)."""
    if isinstance(edge, Segment):
        (ax, ay), (bx, by) = edge.start, edge.end
        if ay == by:
            return []
        slope = (bx - ax) / (by - ay)
        return [(min(ay, by), max(ay, by), lambda y: ax + slope * (y - ay))]
    (cx, cy), r = edge.center, edge.radius_um
    low, high = sorted((edge.start_rad, edge.start_rad + edge.sweep_rad))
    first = math.ceil((low - math.pi / 2) / math.pi)
    turns = [math.pi / 2 + k * math.pi for k in range(first, first + 4)]
    cuts = [low, *(t for t in turns if low < t < high), high]
    parts: list[Part] = []
    for a, b in pairwise(cuts):
        side = math.copysign(1.0, math.cos((a + b) / 2))
        ya, yb = sorted((cy + r * math.sin(a), cy + r * math.sin(b)))

        def at(y: FloatArray, side: float = side) -> FloatArray:
            half: FloatArray = np.sqrt(np.maximum(r * r - (y - cy) ** 2, 0.0))
            return cx + side * half

        parts.append((ya, yb, at))
    return parts
