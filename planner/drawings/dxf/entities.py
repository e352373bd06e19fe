"""Curves of a DXF entity in its own coordinates: lines, elliptic arcs, splines.

Codes and flags: Autodesk, DXF Reference, "ENTITIES". Every curve keeps its own form:
an arc as a cubic, as drawing libraries have it, is 2.7e-4 of its radius off.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

from microplan.planner.drawings.dxf.curves import (
    EllipticArc,
    Line,
    Shape,
    bulged,
    spline,
)
from microplan.planner.drawings.dxf.file import DamagedError, Entity, finite
from microplan.planner.drawings.dxf.hatch import hatch_paths
from microplan.planner.drawings.dxf.paths import Path, UnreadableError, knots_fit
from microplan.planner.drawings.dxf.strokes import Knee, stroke

# drawn in coordinates of their own, which are mirrored if seen from behind
_OWN_PLANE = frozenset(
    ("ARC", "CIRCLE", "LWPOLYLINE", "POLYLINE", "SOLID", "TRACE", "HATCH", "INSERT")
)
_CLOSED, _IN_SPACE, _MESHES = 1, 8, 16 | 64  # of polylines
_FRAME = 16  # of vertices: a control point of the curve, not on it
_MOST_DEGREE = 15


def read_entity(entity: Entity) -> list[Path]:
    """Return what an entity draws.

    Raises
    ------
    KeyError
        If entities of this kind are not read.
    UnreadableError
        If this one has no exact reading; the message says why.
    DamagedError
        If it has another number of vertices than it declares.
    ValueError
        If a number is missing, none, or not possible.
    """
    return READERS[entity.kind](entity)


def from_behind(entity: Entity) -> bool:
    """Return whether an entity is drawn in a plane that is seen from behind.

    Raises
    ------
    ValueError
        If it is tilted.
    """
    if entity.kind not in _OWN_PLANE or (
        entity.kind == "POLYLINE" and entity.integer(70, 0) & _IN_SPACE
    ):
        return False
    return _behind(entity)


def _behind(entity: Entity) -> bool:
    """Return whether the direction away from an entity's plane points down."""
    x, y = entity.number(210, 0.0), entity.number(220, 0.0)
    z = entity.number(230, 1.0)
    if abs(x) > 1e-9 or abs(y) > 1e-9 or not z:
        raise ValueError("it is tilted out of the drawing plane")
    return z < 0


def _line(entity: Entity) -> list[Path]:
    rise = abs(entity.number(31, 0.0) - entity.number(30, 0.0))
    return [Path((Line(entity.point(10), entity.point(11)),), rise=rise)]


def _arc(entity: Entity) -> list[Path]:
    start, end = entity.number(50), entity.number(51)
    sweep = math.radians((end - start) % 360 or 360.0)
    arc = EllipticArc.circular(
        entity.point(10), _radius(entity), math.radians(start), sweep
    )
    return [Path((arc,), closed=arc.full)]


def _circle(entity: Entity) -> list[Path]:
    arc = EllipticArc.circular(entity.point(10), _radius(entity), 0.0, math.tau)
    return [Path((arc,), closed=True)]


def _radius(entity: Entity) -> float:
    radius = entity.number(40)
    if not radius > 0:
        raise ValueError(f"its radius is {radius}")
    return radius


def _ellipse(entity: Entity) -> list[Path]:
    """Return an ELLIPSE, whose parameters run counter-clockwise about its normal."""
    major, ratio = entity.point(11), entity.number(40)
    minor = major * ratio * (-1j if _behind(entity) else 1j)
    start, end = entity.number(41, 0.0), entity.number(42, math.tau)
    sweep = math.tau
    if abs(abs(end - start) - math.tau) > 1e-9:
        sweep = (end - start) % math.tau or math.tau
    arc = EllipticArc(entity.point(10), major, minor, start, sweep)
    return [Path((arc,), closed=arc.full, rise=abs(entity.number(31, 0.0)))]


def _lwpolyline(entity: Entity) -> list[Path]:
    """Return an LWPOLYLINE; width and bulge belong to the edge after a vertex."""
    declared = entity.integer(90, -1)
    width = entity.number(43, 0.0)
    rows: list[dict[int, float]] = []
    for at in range(entity.first, entity.last):
        code = entity.tags.codes[at]
        if code == 10:
            rows.append({})
        if code in (10, 20, 40, 41, 42) and rows:
            rows[-1][code] = finite(entity.tags, at)
    if declared not in (-1, len(rows)):
        raise DamagedError(f"it declares {declared} vertices and has {len(rows)}")
    knees = []
    for row in rows:
        if 20 not in row:
            raise DamagedError("a vertex has no y")
        wide = (row.get(40, width), row.get(41, width))
        knees.append(Knee(complex(row[10], row[20]), row.get(42, 0.0), *wide))
    return _polyline(knees, closed=bool(entity.integer(70, 0) & _CLOSED))


def _old_polyline(entity: Entity) -> list[Path]:
    """Return a POLYLINE; control points of fitted curves are left out."""
    flags = entity.integer(70, 0)
    if flags & _MESHES:
        raise UnreadableError("it is a mesh")
    widths = entity.number(40, 0.0), entity.number(41, 0.0)
    knees, heights = [], []
    for vertex in entity.parts:
        if vertex.integer(70, 0) & _FRAME:
            continue
        wide = vertex.number(40, widths[0]), vertex.number(41, widths[1])
        knees.append(Knee(vertex.point(10), vertex.number(42, 0.0), *wide))
        heights.append(vertex.number(30, 0.0))
    closed = bool(flags & _CLOSED)
    if not flags & _IN_SPACE:
        return _polyline(knees, closed=closed)
    straight = [Knee(knee.at, 0.0, 0.0, 0.0) for knee in knees]
    rise = max(heights, default=0.0) - min(heights, default=0.0)
    return [Path(p.shapes, p.closed, rise) for p in _polyline(straight, closed=closed)]


def _polyline(knees: list[Knee], *, closed: bool) -> list[Path]:
    """Return a polyline's edges, or the border of its stroke if it has a width."""
    if len(knees) < 2:
        raise ValueError("it has fewer than two points")
    drawn = knees if closed else knees[:-1]
    if any(knee.start_width or knee.end_width for knee in drawn):
        return stroke(knees, closed=closed)
    pairs = list(pairwise(knees))
    if closed:
        pairs.append((knees[-1], knees[0]))
    shapes = tuple(bulged(a.at, b.at, a.bulge) for a, b in pairs if a.at != b.at)
    return [Path(shapes, closed=closed)]


def _spline(entity: Entity) -> list[Path]:
    """Return a SPLINE from its control points, weights and knots."""
    degree = entity.integer(71)
    knots, weights = entity.numbers(40), entity.numbers(41)
    points = entity.points(10)
    if not points:
        raise UnreadableError("it has fit points alone, no control points")
    declared = entity.integer(72, len(knots)), entity.integer(73, len(points))
    if declared != (len(knots), len(points)):
        raise DamagedError(
            f"it declares {declared[0]} knots and {declared[1]} control points, "
            f"it has {len(knots)} and {len(points)}"
        )
    if not 1 <= degree <= _MOST_DEGREE:
        raise UnreadableError(f"its degree is {degree}, at most {_MOST_DEGREE}")
    controls = knots_fit(degree, knots, points, weights)
    heights = entity.numbers(30) or [0.0]
    curve = spline(degree, knots, controls)
    return [Path((curve,), rise=max(heights) - min(heights))]


def _quad(entity: Entity) -> list[Path]:
    """Return a SOLID or TRACE; its third and fourth corner are exchanged."""
    corners = [entity.point(10), entity.point(11), entity.point(12)]
    last = entity.point(13, corners[2])
    corners.insert(2, last)
    once = [z for z, after in pairwise([*corners, corners[0]]) if z != after]
    if len(once) < 3:
        raise ValueError("it has fewer than three corners")
    shapes: list[Shape] = [Line(a, b) for a, b in pairwise([*once, once[0]])]
    return [Path(tuple(shapes), closed=True)]


READERS: dict[str, Callable[[Entity], list[Path]]] = {
    "LINE": _line,
    "ARC": _arc,
    "CIRCLE": _circle,
    "ELLIPSE": _ellipse,
    "LWPOLYLINE": _lwpolyline,
    "POLYLINE": _old_polyline,
    "SPLINE": _spline,
    "SOLID": _quad,
    "TRACE": _quad,
    "HATCH": hatch_paths,
}
