"""Circles of an outline: full ones, and those that most of is drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray, Point
from microplan.featuresel.features.feature import Feature
from microplan.featuresel.features.ring_cleanup import SAME, Clean, same_circle
from microplan.optics.outline.outline import Arc, Edge
from microplan.optics.outline.tolerant_order import least

SHARE = 0.5  # of the full turn that has to be drawn: less leaves one direction weak
_SIDES = 12  # a polygon with fewer sides is taken for what it is
_SIDE = math.tau / (_SIDES - 1)  # of the radius: the longest side of one with more
# of the radius: corners of a polygon for a circle are this near it; a drawing program
# that rounds to 1 nm errs by 4e-5 of a 25 um bore
_ON = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class RingCircle:
    """A circle, or the part of it that is drawn."""

    center_um: Point
    radius_um: float
    hole: bool
    sweep_rad: float  # drawn, at most a full turn
    polygon: bool = False  # drawn as chords


def circles(rings: Sequence[Clean]) -> tuple[RingCircle, ...]:
    """Return the circles of which at least `SHARE` is drawn, in order of the rings.

    Arcs of one circle count together, whatever rings they are in. A ring of many
    straight sides whose corners lie on a circle is one too: its radius is that of the
    circle of the same area as the polygon.
    """
    reach = max((float(np.ptp(ring.points, axis=0).max()) for ring in rings), default=0)
    arcs = [edge for ring in rings for edge in ring.edges if isinstance(edge, Arc)]
    found = _of_arcs(arcs, SAME * reach)
    found += [c for ring in rings if (c := _of_corners(ring)) is not None]
    return tuple(found)


def to_feature(circle: RingCircle) -> Feature:
    """Return the circle as a feature without a name."""
    return Feature(
        kind="circle",
        center_um=circle.center_um,
        parameters={"radius_um": circle.radius_um},
        symmetry=0,
        finest_um=2 * circle.radius_um,
        bright=not circle.hole,
        edge_um=circle.radius_um * circle.sweep_rad,
    )


def rounded(ring: Clean, circle: RingCircle) -> bool:
    """Return whether most of a ring's length lies on a circle."""
    on = sum(e.length_um for e in ring.edges if is_on(e, circle))
    return on > ring.length_um / 2


def is_on(edge: Edge, circle: RingCircle) -> bool:
    """Return whether an edge is part of a circle, as it is drawn."""
    within = 2 * _ON * circle.radius_um
    if isinstance(edge, Arc):
        apart = math.dist(edge.center, circle.center_um)
        return apart <= within and abs(edge.radius_um - circle.radius_um) <= within
    if not circle.polygon or edge.length_um > _SIDE * circle.radius_um:
        return False
    # corners of a polygon lie outside the circle of its area
    within += edge.length_um**2 / (8 * circle.radius_um)
    away = [math.dist(p, circle.center_um) for p in (edge.start, edge.end)]
    return all(abs(d - circle.radius_um) <= within for d in away)


def _of_arcs(arcs: Sequence[Arc], within_um: float) -> list[RingCircle]:
    """Return the circles that arcs of one centre and radius make up."""
    groups: list[list[Arc]] = []
    for arc in arcs:
        for group in groups:
            alike = (arc.sweep_rad > 0) == (group[0].sweep_rad > 0)
            if alike and same_circle(arc, group[0], within_um):
                group.append(arc)
                break
        else:
            groups.append([arc])
    found = []
    for group in groups:
        sweep = min(sum(abs(arc.sweep_rad) for arc in group), math.tau)
        if sweep >= SHARE * math.tau:
            longest = least(group, lambda arc: -abs(arc.sweep_rad))
            found.append(
                RingCircle(
                    center_um=longest.center,
                    radius_um=longest.radius_um,
                    hole=longest.sweep_rad < 0,
                    sweep_rad=sweep,
                )
            )
    return found


def _of_corners(ring: Clean) -> RingCircle | None:
    """Return the circle that a polygon of many sides stands for."""
    if len(ring.edges) < _SIDES or any(isinstance(e, Arc) for e in ring.edges):
        return None
    corners = np.array([edge.start for edge in ring.edges])
    center, radius = _fit(corners)
    on = np.abs(np.hypot(*(corners - center).T) - radius) <= _ON * radius
    for _ in range(3):  # a notch's corners pull the first fit
        if np.count_nonzero(on) < _SIDES:
            return None
        center, radius = _fit(corners[on])
        off = np.abs(np.hypot(*(corners - center).T) - radius)
        on = off <= max(_ON * radius, float(np.median(off)))
    on = off <= _ON * radius
    both = on & np.roll(on, -1)
    lengths = np.array([edge.length_um for edge in ring.edges])
    turns = 2 * np.arcsin(np.minimum(lengths[both] / (2 * radius), 1.0))
    sweep = float(turns.sum())
    if sweep < SHARE * math.tau or turns.max() > _SIDE:
        return None
    # chords cut off what lies between them and the arc: keep the enclosed area
    shrink = math.sqrt(float(np.sin(turns).sum()) / sweep)
    return RingCircle(
        center_um=(float(center[0]), float(center[1])),
        radius_um=float(radius * shrink),
        hole=ring.hole,
        sweep_rad=min(sweep, math.tau),
        polygon=True,
    )


def _fit(points: FloatArray) -> tuple[FloatArray, float]:
    """Return centre and radius of the circle through (N, 2) points.

    Algebraic least squares, which is exact for points on a circle (Kasa 1976).
    """
    middle = points.mean(axis=0)
    rays = points - middle
    design = np.column_stack([2 * rays, np.ones(len(rays))])
    solution, *_ = np.linalg.lstsq(design, (rays**2).sum(axis=1), rcond=None)
    square = max(float(solution[2] + solution[0] ** 2 + solution[1] ** 2), 0.0)
    center: FloatArray = middle + solution[:2]
    return center, max(math.sqrt(square), np.finfo(float).tiny)
