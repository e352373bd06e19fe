"""Toothed rings: how often the radius about their centre rises and falls.

Of arcs or of straight edges, whatever their number: the centre is that of the tips and
roots, the teeth are counted where the ring crosses the radius midway between the two.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from microplan.arrays import FloatArray, Point
from microplan.optics.outline.outline import Arc, Edge, Ring
from microplan.planner.drawings.rings import SAME_UM
from microplan.planner.task.regions.symmetry import centroid

DEPTH = 0.02  # of the outer radius: shallower teeth of a polygon are its corners
LEAST_TEETH = 3  # of a polygon
_LEVEL = 0.1  # of a tooth's depth: corners so near its tip or root are on it
_EVEN = 0.9  # of the length of a sum of as many equal arrows: teeth evenly apart
_STEPS = 50  # towards the centre of a polygon; each halves the error, or better
_NEAR_UM = 1e-9  # a step so short is the last
_PIECES = 64  # chords of an arc, they err by 3e-4 of its radius


@dataclass(frozen=True, slots=True, kw_only=True)
class Teeth:
    """A toothed ring, tips and roots being about one centre."""

    center_um: Point
    outer_um: float
    root_um: float
    count: int
    phase_rad: float  # of a tooth's middle, in [0, 2 pi / count)


def teeth_of(ring: Ring) -> Teeth | None:
    """Return the ring's teeth, None if it is no toothed ring."""
    return _of_arcs(ring) or _of_corners(ring)


def samples(edge: Edge) -> list[Point]:
    """Return points along an edge; 64 chords of an arc err by 3e-4 of its radius."""
    if isinstance(edge, Arc):
        return [edge.at(k / _PIECES) for k in range(_PIECES + 1)]
    return [edge.start, edge.end]


def _of_arcs(ring: Ring) -> Teeth | None:
    """Return the teeth of a ring whose tips and roots are arcs about one centre."""
    arcs = [edge for edge in ring.edges if isinstance(edge, Arc)]
    best: list[Arc] = []
    for first in arcs[:64]:  # the wanted centre is that of every tip and root
        about = [a for a in arcs if math.dist(a.center, first.center) <= SAME_UM]
        if _length(about) > _length(best) + SAME_UM:
            best = about
    if not best:
        return None
    outer, root = max(a.radius_um for a in best), min(a.radius_um for a in best)
    if outer - root <= 2 * SAME_UM:
        return None
    middles = _tooth_middles(ring, best[0].center, (outer + root) / 2)
    return _teeth(middles, best[0].center, outer, root) if middles else None


def _of_corners(ring: Ring) -> Teeth | None:
    """Return the teeth of a ring whose tips and roots are corners about one centre."""
    points = np.array([point for edge in ring.edges for point in samples(edge)[:-1]])
    if len(points) < 2 * LEAST_TEETH or _is_convex(points):
        return None
    center = np.array(centroid([ring]))
    for _ in range(_STEPS):
        levels = _levels(points - center)
        if levels is None:
            return None
        before, center = center, _concentric(points, center, levels)
        if math.dist(before, center) < _NEAR_UM:
            break
    levels = _levels(points - center)
    if levels is None:
        return None
    outer, root = levels
    middle: Point = (_rounded(center[0]), _rounded(center[1]))
    middles = _tooth_middles(ring, middle, (outer + root) / 2)
    turns = sum(cmath.rect(1.0, len(middles) * angle) for angle in middles)
    even = len(middles) >= LEAST_TEETH and abs(turns) >= _EVEN * len(middles)
    if not even or outer - root < DEPTH * outer:
        return None
    return _teeth(middles, middle, _rounded(outer), _rounded(root))


def _teeth(middles: Sequence[float], center: Point, outer: float, root: float) -> Teeth:
    """Return teeth by the angles of their middles; the phase is a circular mean."""
    count = len(middles)
    turn = sum(cmath.rect(1.0, count * middle) for middle in middles)
    phase = cmath.phase(turn) / count
    return Teeth(
        center_um=center, outer_um=outer, root_um=root, count=count,
        phase_rad=0.0 if abs(phase) < 1e-12 else phase % (math.tau / count),
    )  # fmt: skip


def _levels(rays: FloatArray) -> tuple[float, float] | None:
    """Return the radii of tips and roots among corners, (N, 2) um about the centre.

    The median over all teeth, so that a bent one does not matter; None if there are
    too few.
    """
    radii = np.hypot(*rays.T)
    over = radii > (radii.max() + radii.min()) / 2
    first = int(np.argmax(over & ~np.roll(over, 1)))
    radii, over = np.roll(radii, -first), np.roll(over, -first)
    ends = [0, *(np.flatnonzero(np.diff(over)) + 1).tolist(), len(over)]
    runs = [radii[i:j] for i, j in pairwise(ends)]
    tips, roots = [r.max() for r in runs[::2]], [r.min() for r in runs[1::2]]
    if len(roots) < LEAST_TEETH:
        return None
    return float(np.median(tips)), float(np.median(roots))


def _concentric(
    points: FloatArray, center: FloatArray, levels: tuple[float, float]
) -> FloatArray:
    """Return the common centre, (2,), of the circles through tips and through roots.

    Least squares of the differences of squared radii: linear in the centre and in one
    number a circle (Kasa 1976, for two circles).
    """
    away = np.hypot(*(points - center).T)
    near = _LEVEL * (levels[0] - levels[1])
    on = [np.abs(away - level) <= near for level in levels]
    x, y = (points - center)[on[0] | on[1]].T
    tip = on[0][on[0] | on[1]].astype(float)
    rows = np.column_stack([2 * x, 2 * y, tip, 1 - tip])
    (dx, dy, *_), *_ = np.linalg.lstsq(rows, x * x + y * y, rcond=None)
    moved: FloatArray = center + np.array([dx, dy])
    return moved


def _is_convex(points: FloatArray) -> bool:
    """Return whether corners, (N, 2) um, turn to one side all along."""
    x, y = (np.roll(points, -1, axis=0) - points).T
    cross = x * np.roll(y, -1) - y * np.roll(x, -1)
    least = 1e-9 * float(np.ptp(points, axis=0).max()) ** 2  # rounding
    return not ((cross > least).any() and (cross < -least).any())


def _tooth_middles(ring: Ring, center: Point, radius_um: float) -> list[float]:
    """Return the angle of each tooth's middle where it crosses a radius.

    A tooth that is bent or moved still counts as one.
    """
    points = [point for edge in ring.edges for point in samples(edge)]
    over = [math.dist(point, center) - radius_um for point in points]
    angles = [math.atan2(y - center[1], x - center[0]) for x, y in points]
    crossings = []  # (angle, whether the ring goes outward there)
    for k in range(len(points)):
        before, after = over[k - 1], over[k]
        if (before > 0) != (after > 0):
            share = before / (before - after)
            turn = math.remainder(angles[k] - angles[k - 1], math.tau)
            crossings.append((angles[k - 1] + share * turn, after > 0))
    middles = []
    for k, (angle, outward) in enumerate(crossings):
        if outward:
            back = crossings[(k + 1) % len(crossings)][0]
            middles.append(angle + math.remainder(back - angle, math.tau) / 2)
    return middles


def _length(arcs: Sequence[Arc]) -> float:
    return sum(arc.length_um for arc in arcs)


def _rounded(value: float) -> float:
    """Return a length to 1e-9 um, so that a centre at 0 is at 0."""
    return round(float(value), 9) + 0.0
