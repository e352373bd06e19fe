"""Toothed rings, and the notch that interrupts a ring of teeth or a circle."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from microplan.arrays import BoolArray, FloatArray, Point
from microplan.featuresel.features.circles import RingCircle, is_on
from microplan.featuresel.features.feature import Feature
from microplan.featuresel.features.ring_cleanup import Clean
from microplan.featuresel.features.symmetry import (
    NEAR,
    TRIED,
    WHOLE,
    RingSamples,
    along,
    centroid,
    curve,
    pattern_of,
)
from microplan.optics.outline.outline import Arc, Edge
from microplan.optics.outline.tolerant_order import ordered

DEPTH = 0.02  # of the outer radius: shallower teeth are no teeth
_LEAST_TEETH = 3
_SHIFTED = 0.1  # of the size


@dataclass(frozen=True, slots=True, kw_only=True)
class Notch:
    """The one place where a pattern or circle is interrupted."""

    angle_rad: float  # of its middle about the pattern's centre, in [0, 2 pi)
    radius_um: float  # of its middle
    width_um: float
    edge_um: float  # length of its own edges


def teeth(
    ring: Clean, centers: Sequence[Point] = ()
) -> tuple[Feature, Notch | None] | None:
    """Return a toothed ring as a feature without a name, and what interrupts it.

    The ring goes in and out about a centre, at least three times, and meets itself over
    `PATTERN` of its length when turned by a tooth. The centre is that of most of its
    arcs, or of its area, or one of those given, as of a bore.
    """
    best: tuple[float, int, RingSamples] | None = None
    for center in _centers(ring, centers):
        inner, outer = _radii(ring, center)
        if outer - inner < DEPTH * outer or _is_convex(ring):
            continue
        shape = curve([ring], center)
        found, share = pattern_of(shape)
        if found >= _LEAST_TEETH and (best is None or share > best[0] + 1e-3):
            best = (share, found, shape)
    return None if best is None else _toothed(ring, best[1], best[2])


def notch_of(ring: Clean, circle: RingCircle) -> Notch | None:
    """Return the only interruption of a round ring, None if there is not just one."""
    off = np.array([not is_on(edge, circle) for edge in ring.edges])
    first, count = _only_run(off)
    if count == 0:
        return None
    run = [ring.edges[(first + k) % len(off)] for k in range(count)]
    points = [point for edge in run for point in _samples(edge)]
    return _notch(np.array([*points, run[-1].end]), circle.center_um)


def _centers(ring: Clean, others: Sequence[Point]) -> list[Point]:
    """Return points the ring may be symmetrical about, the likeliest first."""
    arcs = [edge for edge in ring.edges if isinstance(edge, Arc)]
    size = float(np.ptp(ring.points, axis=0).max())
    groups: list[tuple[float, Point]] = []
    for arc in arcs:
        if not any(math.dist(arc.center, p) <= NEAR * size for _, p in groups):
            near = [a for a in arcs if math.dist(a.center, arc.center) <= NEAR * size]
            groups.append((sum(a.length_um for a in near), arc.center))
    groups.sort(key=lambda group: group[1])
    groups = ordered(groups, lambda group: -group[0])
    middle = centroid([ring])
    # a lone tooth that is longer or missing shifts the centroid, not as much as this
    nearest = ordered(sorted(others), lambda p: math.dist(p, middle), scale=size)
    bores = [p for p in nearest if math.dist(p, middle) <= _SHIFTED * size][:2]
    return [*(point for _, point in groups[:2]), *bores, middle]


def _radii(ring: Clean, center: Point) -> tuple[float, float]:
    """Return the radii between which most of the ring lies: roots and tips."""
    reach = np.hypot(*(ring.points - np.array(center)).T)
    return float(reach.min()), float(reach.max())


def _is_convex(ring: Clean) -> bool:
    """Return whether the ring is its own hull: a polygon, no teeth."""
    x, y = ring.points.T
    area = abs(float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())) / 2
    try:
        hull = float(ConvexHull(ring.points).volume)  # of two dimensions: the area
    except QhullError:  # all points on a line
        return True
    return area > (1 - DEPTH / 10) * hull


def _toothed(
    ring: Clean, count: int, shape: RingSamples
) -> tuple[Feature, Notch | None]:
    """Return the feature of a ring of `count` teeth, and its own notch."""
    pitch, center = math.tau / count, np.array(shape.center_um)
    fine = replace(shape, tried=along([ring], ring.length_um / (10 * TRIED)))
    # what meets few of its copies is what breaks the pattern, not what it faces
    off = np.mean([fine.meets(k * pitch) for k in range(1, count)], axis=0) < 0.5
    first, run = _only_run(off)
    around = fine.tried[np.arange(first - 1, first + run + 1) % len(off)]
    notch = _notch(around, shape.center_um) if run else None
    reach = np.hypot(*(fine.tried - center).T)[~off]
    corners = np.hypot(*(ring.points - center).T)
    near = NEAR * shape.radius_um
    outer = float(corners[corners <= reach.max() + near].max())
    root = float(corners[corners >= reach.min() - near].min())
    share = shape.share(pitch)
    feature = Feature(
        kind="teeth",
        center_um=shape.center_um,
        parameters={
            "count": float(count),
            "outer_um": outer,
            "root_um": root,
            "phase_rad": _phase(fine.tried - center, (outer + root) / 2, count),
        },
        symmetry=count,
        finest_um=outer - root,
        bright=not ring.hole,
        edge_um=ring.length_um,
        alike=0.0 if share >= WHOLE else share,
        alike_rad=pitch,
    )
    return feature, notch


def _phase(rays: FloatArray, radius_um: float, count: int) -> float:
    """Return the angle of a tooth's middle, in [0, 2 pi / count).

    The mean over the positions where the ring goes out through a radius and comes back.
    """
    over, before = np.hypot(*rays.T) - radius_um, np.roll(np.hypot(*rays.T), 1)
    before = before - radius_um
    crossings = []
    for k in np.flatnonzero((over > 0) != (before > 0)).tolist():
        share = before[k] / (before[k] - over[k])
        x, y = rays[k - 1] + share * (rays[k] - rays[k - 1])
        crossings.append((math.atan2(y, x), bool(over[k] > 0)))
    turn = 0j
    for k, (angle, outward) in enumerate(crossings):
        if outward:
            back = crossings[(k + 1) % len(crossings)][0]
            middle = angle + math.remainder(back - angle, math.tau) / 2
            turn += cmath.rect(1.0, count * middle)
    phase = (cmath.phase(turn) / count) % (math.tau / count)
    return 0.0 if math.tau / count - phase < 1e-9 else phase


def _only_run(off: BoolArray) -> tuple[int, int]:
    """Return start and length of the only run around a ring; (0, 0) if not just one."""
    starts = np.flatnonzero(off & ~np.roll(off, 1))
    if len(starts) != 1:
        return 0, 0
    return int(starts[0]), int(np.count_nonzero(off))


def _notch(run: FloatArray, center: Point) -> Notch:
    """Return the notch along a path, (N, 2) um, from rim to rim."""
    rays = run - np.array(center)
    middle = (rays[0] + rays[-1]) / 2
    rim = float(np.hypot(*rays[[0, -1]].T).mean())
    sides = middle[0] * rays[:, 1] - middle[1] * rays[:, 0]
    reach = rim
    for k in range(len(rays) - 1):
        if sides[k] * sides[k + 1] <= 0 and sides[k] != sides[k + 1]:
            share = sides[k] / (sides[k] - sides[k + 1])
            reach = float(np.hypot(*(rays[k] + share * (rays[k + 1] - rays[k]))))
    return Notch(
        angle_rad=math.atan2(middle[1], middle[0]) % math.tau,
        radius_um=(rim + reach) / 2,
        width_um=math.dist(rays[0], rays[-1]),
        edge_um=float(np.hypot(*np.diff(run, axis=0).T).sum()),
    )


def _samples(edge: Edge) -> list[Point]:
    """Return points along an edge without its end."""
    if isinstance(edge, Arc):
        return [edge.at(k / 64) for k in range(64)]
    return [edge.start]
