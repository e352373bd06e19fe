"""Rings run along by their length: points, normals, and stretches cut out."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from optics.outline import Arc, Edge, Ring, Segment

FloatArray = npt.NDArray[np.float64]

LEAST_UM = 1e-6  # of an edge that is left of a cut: below it is rounding


def ends_um(ring: Ring) -> FloatArray:
    """Return how far along the ring each edge ends, (edges,) um."""
    found: FloatArray = np.cumsum([edge.length_um for edge in ring.edges])
    return found


def along(ring: Ring, way_um: FloatArray) -> FloatArray:
    """Return points of a ring and their normals out of the material.

    Parameters
    ----------
    ring : Ring
        With the material on the left of every edge.
    way_um : (N,) float array
        How far along the ring, um; taken modulo its length.

    Returns
    -------
    (N, 4) float64 array
        x, y in um, and the unit normal.
    """
    ends = ends_um(ring)
    way = np.mod(way_um, ends[-1])
    which = np.minimum(np.searchsorted(ends, way, side="right"), len(ends) - 1)
    found = np.empty((len(way), 4))
    for index in np.unique(which):
        here, edge = which == index, ring.edges[index]
        begin = ends[index] - edge.length_um
        found[here] = _on(edge, (way[here] - begin) / edge.length_um)
    return found


def stretch(ring: Ring, first_um: float, last_um: float) -> tuple[Edge, ...]:
    """Return the edges from one place along a ring to another, at most once round.

    Parameters
    ----------
    ring : Ring
        The ring.
    first_um, last_um : float
        From 0 on; `last_um` is the larger, and may lie beyond the ring's end.
    """
    return tuple(_stretch(ring, first_um, last_um))


def _stretch(ring: Ring, first_um: float, last_um: float) -> Iterator[Edge]:
    length = float(ends_um(ring)[-1])
    begin = 0.0
    for turn in (0, 1):
        for edge in ring.edges:
            low = max(first_um, begin) - begin
            high = min(last_um, begin + edge.length_um) - begin
            if high - low > LEAST_UM:
                yield cut(edge, low / edge.length_um, high / edge.length_um)
            begin += edge.length_um
        begin = (turn + 1) * length  # no rounding from one turn to the next


def cut(edge: Edge, first: float, last: float) -> Edge:
    """Return the part of an edge between two shares (0..1) of its length."""
    if (first, last) == (0.0, 1.0):
        return edge
    if isinstance(edge, Arc):
        return Arc(
            center=edge.center,
            radius_um=edge.radius_um,
            start_rad=edge.start_rad + first * edge.sweep_rad,
            sweep_rad=(last - first) * edge.sweep_rad,
        )
    (x0, y0), (x1, y1) = edge.start, edge.end
    ends = [(x0 + t * (x1 - x0), y0 + t * (y1 - y0)) for t in (first, last)]
    return Segment(start=ends[0], end=ends[1])


def _on(edge: Edge, share: FloatArray) -> FloatArray:
    """Return points and outward normals after shares of one edge, (N, 4)."""
    if isinstance(edge, Segment):
        start, way = np.array(edge.start), np.subtract(edge.end, edge.start)
        normal = np.array([way[1], -way[0]]) / math.hypot(*way)
        points = start + share[:, None] * way
        return np.column_stack((points, np.broadcast_to(normal, points.shape)))
    angle = edge.start_rad + share * edge.sweep_rad
    unit = np.column_stack((np.cos(angle), np.sin(angle)))
    # counter-clockwise the material is inside the circle
    return np.column_stack(
        (
            np.array(edge.center) + edge.radius_um * unit,
            math.copysign(1.0, edge.sweep_rad) * unit,
        )
    )
