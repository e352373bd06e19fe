"""Offset outlines: edges as fabricated against edges as drawn."""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import FloatArray, Point
from microplan.optics.outline.outline import (
    JOIN_UM,
    Arc,
    Edge,
    Outline,
    Ring,
    Segment,
    edge_bounds,
)

# Edges that meet at a smaller angle are smooth: a gap of 1e-6 of the offset opens.
_SMOOTH_RAD = 1e-6
_SAMPLES = 9  # points of each new edge, or of each quarter circle, that are checked
# A new edge may come this much closer to an old one than the offset: as much as two
# old edges may miss each other where they meet.
_SLACK_UM = 2 * JOIN_UM


def offset(outline: Outline, distance_um: float) -> Outline:
    """Return the outline of the body grown by a distance, or shrunk if negative.

    Parameters
    ----------
    outline : Outline
        Outer rings counter-clockwise, holes clockwise, um.
    distance_um : float
        How far every edge moves out of the material, um.

    Returns
    -------
    Outline
        The same object for 0. Segments move sideways and arcs keep their centre with
        a radius of R + d or R - d, so arcs stay arcs. Corners on the side the edges
        move to are rounded with the radius |d|, which makes a grown body exactly the
        points within d of the old one; on the other side edges are cut where they
        meet.

    Raises
    ------
    ValueError
        If the distance is not finite, or so large that a ring, an edge, a wall or a
        gap vanishes: the new body would have another shape.
    """
    if not math.isfinite(distance_um):
        raise ValueError(f"distance_um must be finite, got {distance_um}")
    if distance_um == 0 or not outline.rings:
        return outline
    grown = Outline(rings=tuple(_ring(ring, distance_um) for ring in outline.rings))
    _check_clear(outline, grown, abs(distance_um))
    return grown


def _ring(ring: Ring, d: float) -> Ring:
    """Offset one ring."""
    moved = [_moved(edge, d) for edge in ring.edges]
    if len(moved) == 1:
        return Ring(edges=tuple(moved), layer=ring.layer)
    begins: list[Point | None] = [None] * len(moved)
    ends: list[Point | None] = [None] * len(moved)
    joins: list[Arc | None] = [None] * len(moved)
    for i, edge in enumerate(ring.edges):
        j = (i + 1) % len(moved)
        turn = _turn(edge, ring.edges[j])
        if abs(turn) <= _SMOOTH_RAD:
            continue
        corner = edge.end
        if (turn > 0) == (d > 0):  # the new edges part
            joins[i] = _rounding(corner, edge, turn, d)
        else:
            ends[i] = begins[j] = _meeting(moved[i], moved[j], corner)
    edges: list[Edge] = []
    for i, edge in enumerate(moved):
        edges.append(_trimmed(edge, begins[i], ends[i]))
        join = joins[i]
        if join is not None:
            edges.append(join)
    return Ring(edges=_closed(edges), layer=ring.layer)


def _moved(edge: Edge, d: float) -> Edge:
    """Move one edge to its right, out of the material."""
    if isinstance(edge, Segment):
        nx, ny = _normal(_direction(edge, at_end=False))
        (x0, y0), (x1, y1) = edge.start, edge.end
        return Segment(start=(x0 + d * nx, y0 + d * ny), end=(x1 + d * nx, y1 + d * ny))
    radius = edge.radius_um + math.copysign(d, d * edge.sweep_rad)
    if not radius > 0:
        raise _vanished(f"the arc of radius {edge.radius_um} um", d)
    return Arc(
        center=edge.center,
        radius_um=radius,
        start_rad=edge.start_rad,
        sweep_rad=edge.sweep_rad,
    )


def _direction(edge: Edge, *, at_end: bool) -> Point:
    """Return the unit vector along an edge at one of its ends."""
    if isinstance(edge, Segment):
        length = edge.length_um
        if not length > 0:
            raise ValueError(f"an edge of no length at {edge.start} has no side")
        (x0, y0), (x1, y1) = edge.start, edge.end
        return ((x1 - x0) / length, (y1 - y0) / length)
    angle = edge.start_rad + (edge.sweep_rad if at_end else 0.0)
    sign = math.copysign(1.0, edge.sweep_rad)
    return (-sign * math.sin(angle), sign * math.cos(angle))


def _normal(direction: Point) -> Point:
    """Return the unit vector to the right: out of the material."""
    return (direction[1], -direction[0])


def _turn(before: Edge, after: Edge) -> float:
    """Return the angle from one edge to the next, rad, positive to the left."""
    (ax, ay), (bx, by) = (
        _direction(before, at_end=True),
        _direction(after, at_end=False),
    )
    return math.atan2(ax * by - ay * bx, ax * bx + ay * by)


def _rounding(corner: Point, before: Edge, turn: float, d: float) -> Arc:
    """Return the arc around a corner from one new edge to the next."""
    nx, ny = _normal(_direction(before, at_end=True))
    start = math.atan2(d * ny, d * nx)
    return Arc(center=corner, radius_um=abs(d), start_rad=start, sweep_rad=turn)


def _meeting(one: Edge, other: Edge, corner: Point) -> Point:
    """Return where two new edges, run on, meet nearest to the old corner."""
    if isinstance(one, Segment):
        if isinstance(other, Segment):
            found = _lines(one, other)
        else:
            found = _line_circle(one, other)
    elif isinstance(other, Segment):
        found = _line_circle(other, one)
    else:
        found = _circles(one, other)
    if not found:
        raise ValueError(f"the edges at {corner} no longer meet after the offset")
    return min(found, key=lambda point: math.dist(point, corner))


def _lines(one: Segment, other: Segment) -> list[Point]:
    """Return where two lines cross."""
    (ax, ay), (bx, by) = (
        _direction(one, at_end=True),
        _direction(other, at_end=False),
    )
    (x, y), (p, q) = one.end, other.start
    cross = ax * by - ay * bx
    if abs(cross) < _SMOOTH_RAD:  # back on itself
        return []
    t = ((p - x) * by - (q - y) * bx) / cross
    return [(x + t * ax, y + t * ay)]


def _line_circle(line: Segment, arc: Arc) -> list[Point]:
    """Return where a line crosses an arc's circle."""
    dx, dy = _direction(line, at_end=False)
    x, y = line.start[0] - arc.center[0], line.start[1] - arc.center[1]
    along, away = x * dx + y * dy, x * dy - y * dx
    square = (arc.radius_um - away) * (arc.radius_um + away)
    if square < 0:
        return []
    half = math.sqrt(square)
    return [
        (line.start[0] + t * dx, line.start[1] + t * dy)
        for t in (-along - half, -along + half)
    ]


def _circles(one: Arc, other: Arc) -> list[Point]:
    """Return where two circles cross."""
    (x, y), (p, q) = one.center, other.center
    apart = math.dist(one.center, other.center)
    if apart == 0:
        return []
    r, s = one.radius_um, other.radius_um
    along = (apart + (r - s) * (r + s) / apart) / 2
    square = (r - along) * (r + along)
    if square < 0:
        return []
    half, ux, uy = math.sqrt(square), (p - x) / apart, (q - y) / apart
    return [(x + along * ux - h * uy, y + along * uy + h * ux) for h in (-half, half)]


def _trimmed(edge: Edge, begin: Point | None, end: Point | None) -> Edge:
    """Return an edge with new ends; None keeps the old one."""
    if begin is None and end is None:
        return edge
    start, stop = begin or edge.start, end or edge.end
    if isinstance(edge, Segment):
        dx, dy = _direction(edge, at_end=False)
        if not (stop[0] - start[0]) * dx + (stop[1] - start[1]) * dy > 0:
            raise _vanished(f"the edge at {edge.start}")
        return Segment(start=start, end=stop)
    sign = math.copysign(1.0, edge.sweep_rad)
    late = sign * _angle_from(edge, start, 0.0) if begin else 0.0
    early = sign * _angle_from(edge, stop, edge.sweep_rad) if end else 0.0
    sweep = abs(edge.sweep_rad) - late + early
    if not sweep > 0:
        raise _vanished(f"the arc at {edge.start}")
    return Arc(
        center=edge.center,
        radius_um=edge.radius_um,
        start_rad=edge.start_rad + sign * late,
        sweep_rad=sign * sweep,
    )


def _angle_from(arc: Arc, point: Point, sweep_rad: float) -> float:
    """Return the angle of a point from a point on the arc, -pi..pi."""
    angle = math.atan2(point[1] - arc.center[1], point[0] - arc.center[0])
    return math.remainder(angle - arc.start_rad - sweep_rad, 2 * math.pi)


def _closed(edges: list[Edge]) -> tuple[Edge, ...]:
    """Let segments end where the next edge starts: old gaps must not add up."""
    after = edges[1:] + edges[:1]
    return tuple(
        Segment(start=e.start, end=b.start) if isinstance(e, Segment) else e
        for e, b in zip(edges, after, strict=True)
    )


def _vanished(what: str, d: float | None = None) -> ValueError:
    by = "" if d is None else f" of {d} um"
    return ValueError(f"{what} vanishes in the offset{by}")


def _check_clear(old: Outline, new: Outline, distance_um: float) -> None:
    """Refuse a new edge closer to an old one than the offset.

    Where a wall or a gap closes, new edges cross, and beyond the crossing each is too
    close to the old edge of the other.
    """
    points = np.concatenate([_along(edge) for ring in new.rings for edge in ring.edges])
    edges = [edge for ring in old.rings for edge in ring.edges]
    least = distance_um - _SLACK_UM
    points = points[np.argsort(points[:, 0], kind="stable")]
    for edge in edges:
        low, high = np.array(edge_bounds(edge)).reshape(2, 2)
        first, last = np.searchsorted(
            points[:, 0], (low[0] - distance_um, high[0] + distance_um)
        )
        beside = points[first:last]
        beside = beside[np.abs(beside[:, 1] - (low[1] + high[1]) / 2)
                        <= (high[1] - low[1]) / 2 + distance_um]  # fmt: skip
        near = _distance(beside, edge)
        if not (near >= least).all():
            x, y = beside[int(np.argmin(near))]
            raise ValueError(
                f"a wall or gap at ({x:.6g}, {y:.6g}) um is narrower than twice the "
                f"offset of {distance_um} um"
            )


def _along(edge: Edge) -> FloatArray:
    """Return points along an edge, (N, 2)."""
    count = _SAMPLES
    if isinstance(edge, Arc):
        count *= math.ceil(abs(edge.sweep_rad) / (math.pi / 2))
        angle = edge.start_rad + np.linspace(0, 1, count) * edge.sweep_rad
        unit = np.column_stack([np.cos(angle), np.sin(angle)])
        return np.array(edge.center) + edge.radius_um * unit
    t = np.linspace(0, 1, count)[:, None]
    line: FloatArray = np.array(edge.start) * (1 - t) + np.array(edge.end) * t
    return line


def _distance(points: FloatArray, edge: Edge) -> FloatArray:
    """Return the distance of points (N, 2) from an edge, um."""
    start, end = np.array(edge.start), np.array(edge.end)
    to_ends = np.minimum(
        np.hypot(*(points - start).T),
        np.hypot(*(points - end).T),
    )
    if isinstance(edge, Segment):
        step = end - start
        t = (points - start) @ step / (step @ step)
        foot = start + np.clip(t, 0, 1)[:, None] * step
        return np.asarray(np.hypot(*(points - foot).T))
    x, y = (points - np.array(edge.center)).T
    sign = math.copysign(1.0, edge.sweep_rad)
    angle = (sign * (np.arctan2(y, x) - edge.start_rad)) % (2 * np.pi)
    radial = np.abs(np.hypot(x, y) - edge.radius_um)
    near: FloatArray = np.where(angle <= abs(edge.sweep_rad), radial, to_ends)
    return near
