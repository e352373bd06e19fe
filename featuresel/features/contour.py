"""The drawn edges of a target as points with normals, for `Target.contour`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines.contract import Target, TargetKind
from microplan.optics.outline.outline import Arc, Edge, Outline, Segment

SPACING_PX = 0.5  # of neighbouring points: an image holds no finer detail
MOST = 4000  # points: more would say the same again
_ROUND = 0.02  # of the radius: chords of a drawn circle and rims lie this near
_STRAIGHT = 0.01  # of the length: what is drawn as one edge in pieces bends less
_SQUARE = 0.1  # rad: normals of an edge's pieces are this near its own


def with_contour(target: Target, outlines: Sequence[Outline]) -> Target:
    """Return the target with the points on its drawn edges.

    Parameters
    ----------
    target : Target
        The target; kind and parameters say which edges are its own.
    outlines : sequence of Outline
        What carries the target, in the target's frame at theta 0, um.

    Returns
    -------
    Target
        Its `contour` holds at most `MOST` points, of circles those on the circle, of
        fingers those no farther from the grip than the tips' outer corners.
    """
    found = edge_points(
        outlines,
        spacing_um=SPACING_PX / target.px_per_um,
        within_um=_reach_um(target.kind, target.parameters),
    )
    own = found[_belongs(target.kind, target.parameters, found)]
    if len(own) > MOST:
        own = own[np.linspace(0, len(own) - 1, MOST).round().astype(np.intp)]
    return replace(target, contour=tuple(map(_four, own.tolist())))


def edge_points(
    outlines: Sequence[Outline], *, spacing_um: float, within_um: float = math.inf
) -> FloatArray:
    """Return points along all edges and their normals out of the material.

    Parameters
    ----------
    outlines : sequence of Outline
        Outer rings counter-clockwise, holes clockwise, so that the material lies on
        the left of every edge.
    spacing_um : float
        Between neighbouring points, at most; > 0. Each edge has one at least, and none
        at its ends, where the normal jumps.
    within_um : float
        Points farther from the origin are left out.

    Returns
    -------
    (N, 4) float64 array
        x, y, um, and the unit normal's x and y.

    Raises
    ------
    ValueError
        If `spacing_um` is not positive.
    """
    if not spacing_um > 0:
        raise ValueError(f"spacing_um must be positive, got {spacing_um}")
    edges = [e for o in outlines for ring in o.rings for e in ring.edges]
    parts = [_along(edge, spacing_um, within_um) for edge in edges]
    found = np.concatenate([np.empty((0, 4)), *parts])
    kept: FloatArray = found[np.hypot(found[:, 0], found[:, 1]) <= within_um]
    return kept


def _four(values: Sequence[float]) -> tuple[float, float, float, float]:
    x, y, nx, ny = values
    return (x, y, nx, ny)


def _along(edge: Edge, spacing_um: float, within_um: float) -> FloatArray:
    """Return the points of one edge, (N, 4); the circle cuts segments only."""
    if isinstance(edge, Arc):
        return _along_arc(edge, spacing_um)
    start, end = _shortened(edge, within_um)
    length = math.dist(edge.start, edge.end)
    if length == 0 or start >= end:
        return np.empty((0, 4))
    t = start + (end - start) * _middles((end - start) * length, spacing_um)
    dx, dy = edge.end[0] - edge.start[0], edge.end[1] - edge.start[1]
    out = np.ones_like(t)
    return np.column_stack(
        (
            edge.start[0] + t * dx,
            edge.start[1] + t * dy,
            out * dy / length,
            -out * dx / length,
        )
    )


def _along_arc(arc: Arc, spacing_um: float) -> FloatArray:
    """Return the points of an arc; a clockwise one has its centre outside."""
    angle = arc.start_rad + arc.sweep_rad * _middles(arc.length_um, spacing_um)
    unit = np.column_stack((np.cos(angle), np.sin(angle)))
    normals = unit * math.copysign(1.0, arc.sweep_rad)
    return np.hstack((np.array(arc.center) + arc.radius_um * unit, normals))


def _middles(length_um: float, spacing_um: float) -> FloatArray:
    """Return the middles of equal pieces of 0..1."""
    count = max(1, math.ceil(length_um / spacing_um - 1e-9))
    return (np.arange(count) + 0.5) / count


def _shortened(edge: Segment, within_um: float) -> tuple[float, float]:
    """Return the part (from, to) of 0..1 inside the circle about the origin."""
    if math.isinf(within_um):
        return (0.0, 1.0)
    (x, y), (ex, ey) = edge.start, edge.end
    dx, dy = ex - x, ey - y
    square = dx * dx + dy * dy
    if square == 0:
        return (0.0, 0.0)
    nearest = -(x * dx + y * dy) / square
    half = within_um**2 / square - (x * dy - y * dx) ** 2 / square**2
    if half <= 0:
        return (0.0, 0.0)
    return (max(0.0, nearest - math.sqrt(half)), min(1.0, nearest + math.sqrt(half)))


def _reach_um(kind: TargetKind, p: Mapping[str, float]) -> float:
    """Return the radius about the reference point that holds the target's edges."""
    if kind == "jaws":
        wide = p["opening_um"] / 2 + p["finger_width_um"]
        return math.hypot(wide, p["grip_from_tip_um"])
    if kind == "pair":
        return math.hypot(p["length_um"], p["width_um"]) / 2 * (1 + _ROUND)
    names = {"circle": "radius_um", "teeth": "outer_um", "outline": "extent_um"}
    if kind in names:
        return p[names[kind]] * (1 + _ROUND)
    return p["length_um"] / 2 if kind == "edge" else p["reach_um"]


def _belongs(kind: TargetKind, p: Mapping[str, float], points: FloatArray) -> BoolArray:
    """Return which of (N, 4) points are on the target's own edges."""
    x, y, nx, ny = points[:, 0], points[:, 1], points[:, 2], points[:, 3]
    own: BoolArray = np.ones(len(points), dtype=np.bool_)
    if kind == "circle":
        away: FloatArray = np.hypot(x, y)
        radial = np.abs(x * nx + y * ny) >= math.cos(_SQUARE) * away
        own = (np.abs(away - p["radius_um"]) <= _ROUND * p["radius_um"]) & radial
    elif kind == "edge":
        near = np.abs(x) <= _STRAIGHT * p["length_um"]
        own = near & (nx >= math.cos(_SQUARE))
    elif kind == "pair":
        off = np.abs(np.abs(x) - p["width_um"] / 2)
        near = off <= _STRAIGHT * p["length_um"]
        own = near & (np.abs(nx) >= math.cos(_SQUARE))
    elif kind == "corner":
        own = _on_legs(p, points)
    return own


def _on_legs(p: Mapping[str, float], points: FloatArray) -> BoolArray:
    """Return which points are on a corner's legs; the bisector out of it is +x."""
    x, y, nx, ny = points.T
    found = np.zeros(len(points), dtype=np.bool_)
    for side in (-1.0, 1.0):
        along = math.pi - side * p["angle_rad"] / 2
        ax, ay = math.cos(along), math.sin(along)
        # the material lies on the inner side of either leg
        out = (ay * side, -ax * side)
        found |= (
            (np.abs(x * out[0] + y * out[1]) <= _STRAIGHT * p["reach_um"])
            & (x * ax + y * ay >= 0)
            & (nx * out[0] + ny * out[1] >= math.cos(_SQUARE))
        )
    return found
