"""Outlines under a smooth map of the plane: edges as arcs within a stated error."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Arc, Edge, Outline, Ring, Segment

IndexArray = npt.NDArray[np.intp]
Map = Callable[[FloatArray], FloatArray]  # (..., 2) um to (..., 2) um

# Largest distance between a mapped edge and the arcs that replace it: at an edge in
# focus, 16 A / (3 pi wavelength) per um steep, 1.2e-5 of unit contrast at A = .42.
WARP_UM = 1e-5
_LONGEST_UM = 500.0  # of a piece: keeps its radius, < 1e10 um, clear of rounding
_WIDEST_RAD = math.pi / 2
_MOST = 1 << 17  # pieces of a ring that do not fit yet, before it is given up
# A cubic between 0, 1/2 and 1 is largest at .2113, 1.027 times its value at 1/4.
_PEAK = 1.027


def scaled(
    outline: Outline, factor: float, shift_um: tuple[float, float] = (0.0, 0.0)
) -> Outline:
    """Return `outline` scaled about the origin, then shifted; arcs stay arcs.

    Raises
    ------
    ValueError
        If `factor` is not positive and finite.
    """
    if not (factor > 0 and math.isfinite(factor)):
        raise ValueError(f"factor must be positive and finite, got {factor}")

    def moved(point: tuple[float, float]) -> tuple[float, float]:
        return (point[0] * factor + shift_um[0], point[1] * factor + shift_um[1])

    def edge(old: Edge) -> Edge:
        if isinstance(old, Segment):
            return Segment(start=moved(old.start), end=moved(old.end))
        return Arc(
            center=moved(old.center),
            radius_um=old.radius_um * factor,
            start_rad=old.start_rad,
            sweep_rad=old.sweep_rad,
        )

    return Outline(
        rings=tuple(
            Ring(edges=tuple(edge(e) for e in ring.edges), layer=ring.layer)
            for ring in outline.rings
        )
    )


def warped(outline: Outline, mapping: Map, *, error_um: float = WARP_UM) -> Outline:
    """Return the image of an outline under a smooth one-to-one map.

    Parameters
    ----------
    mapping : callable
        Points (N, 2) um to points (N, 2) um; keeps the plane's orientation.
    error_um : float
        Largest distance between a mapped edge and its replacement, > 0.

    Returns
    -------
    Outline
        Each edge is cut into pieces, and each piece becomes the arc through the images
        of its ends and middle, or a segment where that is flat. The distance is
        measured at a quarter and three quarters of a piece, where the cubic term that
        an arc leaves has nearly its peak; a piece that is farther off is halved.

    Raises
    ------
    ValueError
        If `error_um` is not positive, or the map so rough that a ring's pieces
        that do not fit grow beyond 1e5.
    """
    if not (error_um > 0 and math.isfinite(error_um)):
        raise ValueError(f"error_um must be positive and finite, got {error_um}")
    return Outline(
        rings=tuple(_warped_ring(ring, mapping, error_um) for ring in outline.rings)
    )


def _warped_ring(ring: Ring, mapping: Map, error_um: float) -> Ring:
    """Map one ring."""
    source = _Source.of(ring)
    edge, begin, end = _first_cuts(ring)
    found: list[tuple[IndexArray, FloatArray, _Pieces]] = []
    most = max(_MOST, 2 * edge.size)
    while edge.size <= most:
        pieces = _Pieces.through(_images(source, mapping, edge, begin, end), error_um)
        fits = pieces.error_um * _PEAK <= error_um
        found.append((edge[fits], begin[fits], pieces.pick(fits)))
        if fits.all():
            return Ring(edges=_assemble(found), layer=ring.layer)
        edge, begin, end = edge[~fits], begin[~fits], end[~fits]
        half = (begin + end) / 2
        edge = np.repeat(edge, 2)
        begin, end = (
            np.column_stack([begin, half]).ravel(),
            np.column_stack([half, end]).ravel(),
        )
    raise ValueError(f"the map is too rough for arcs within {error_um} um")


def _first_cuts(ring: Ring) -> tuple[IndexArray, FloatArray, FloatArray]:
    """Return pieces that are neither too long nor too wide: edge, from, to."""
    wide = [abs(e.sweep_rad) if isinstance(e, Arc) else 0.0 for e in ring.edges]
    count = np.array(
        [
            max(1, math.ceil(e.length_um / _LONGEST_UM), math.ceil(w / _WIDEST_RAD))
            for e, w in zip(ring.edges, wide, strict=True)
        ]
    )
    edge = np.repeat(np.arange(count.size), count)
    first = np.arange(edge.size) - np.repeat(np.cumsum(count) - count, count)
    return edge, first / count[edge], (first + 1) / count[edge]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Source:
    """The edges of a ring as functions of 0..1 along each."""

    start: FloatArray  # (E, 2)
    end: FloatArray  # (E, 2), where the next edge starts: gaps stay closed
    arc: FloatArray  # (E, 5) center, radius, start, sweep; zeros for a segment

    @classmethod
    def of(cls, ring: Ring) -> _Source:
        starts = np.array([edge.start for edge in ring.edges])
        rows = [
            (*e.center, e.radius_um, e.start_rad, e.sweep_rad)
            if isinstance(e, Arc)
            else (0.0,) * 5
            for e in ring.edges
        ]
        return cls(start=starts, end=np.roll(starts, -1, axis=0), arc=np.array(rows))

    def at(self, edge: IndexArray, t: FloatArray) -> FloatArray:
        """Return points (N, 2) on edges (N,) at 0..1 (N,)."""
        p, q = self.start[edge], self.end[edge]
        cx, cy, r, a, s = self.arc[edge].T
        line = p + t[:, None] * (q - p)
        angle = a + t * s
        around = np.column_stack([cx + r * np.cos(angle), cy + r * np.sin(angle)])
        points = np.where((r > 0)[:, None], around, line)
        ends = np.where((t == 0)[:, None], p, q)
        found: FloatArray = np.where(((t == 0) | (t == 1))[:, None], ends, points)
        return found


def _images(
    source: _Source, mapping: Map, edge: IndexArray, begin: FloatArray, end: FloatArray
) -> FloatArray:
    """Return mapped points at quarters of pieces, (5, N, 2)."""
    places = [begin, *((begin + (end - begin) * q / 4) for q in (1, 2, 3)), end]
    points = np.concatenate([source.at(edge, t) for t in places])
    return mapping(points).reshape(5, edge.size, 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pieces:
    """Arcs through three points each, or chords where they are flat."""

    start: FloatArray  # (N, 2)
    end: FloatArray  # (N, 2)
    center: FloatArray  # (N, 2)
    sweep: FloatArray  # (N,) rad, 0 for a chord
    error_um: FloatArray  # (N,) at the quarters

    @classmethod
    def through(cls, points: FloatArray, error_um: float) -> _Pieces:
        """Fit pieces to points (5, N, 2); chords where that costs half the error."""
        a, m, b = points[0], points[2], points[4]
        u, v, w = m - a, b - a, b - m
        twice = _cross(u, v)
        length = np.hypot(v[:, 0], v[:, 1])
        flat = np.abs(twice) <= error_um / 2 * length
        safe = np.where(flat, 1.0, 2 * twice)
        uu, vv = (u**2).sum(axis=1), (v**2).sum(axis=1)
        x = (v[:, 1] * uu - u[:, 1] * vv) / safe
        y = (u[:, 0] * vv - v[:, 0] * uu) / safe
        to_center = np.column_stack([x, y])
        sweep = np.where(flat, 0.0, 2 * np.arctan2(_cross(u, w), (u * w).sum(axis=1)))
        errors = [_off(q - a, to_center, v, flat) for q in points[1:4]]
        return cls(
            start=a,
            end=b,
            center=a + to_center,
            sweep=sweep,
            error_um=np.max(errors, axis=0),
        )

    def pick(self, which: npt.NDArray[np.bool_]) -> _Pieces:
        """Return some of the pieces."""
        return _Pieces(
            start=self.start[which],
            end=self.end[which],
            center=self.center[which],
            sweep=self.sweep[which],
            error_um=self.error_um[which],
        )

    def edges(self) -> list[Edge]:
        """Return the pieces as edges."""
        radius = np.hypot(*(self.start - self.center).T)
        angle = np.arctan2(*(self.start - self.center).T[::-1])
        rows = zip(
            self.start.tolist(),
            self.end.tolist(),
            self.center.tolist(),
            radius.tolist(),
            angle.tolist(),
            self.sweep.tolist(),
            strict=True,
        )
        return [
            Arc(center=(c[0], c[1]), radius_um=r, start_rad=t, sweep_rad=s)
            if s
            else Segment(start=(p[0], p[1]), end=(q[0], q[1]))
            for p, q, c, r, t, s in rows
        ]


def _off(
    at: FloatArray, center: FloatArray, chord: FloatArray, flat: npt.NDArray[np.bool_]
) -> FloatArray:
    """Return how far points are from their arc or chord; all (N, 2) from its start."""
    length = np.maximum(np.hypot(*chord.T), 1e-300)
    straight = np.abs(_cross(at, chord)) / length
    radius = np.where(flat, 1.0, np.hypot(*center.T))
    # |at - center| - radius to first order, without the difference of large numbers
    round_ = np.abs((at**2).sum(axis=1) - 2 * (at * center).sum(axis=1)) / (2 * radius)
    found: FloatArray = np.where(flat, straight, round_)
    return found


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    return one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]


def _assemble(
    found: list[tuple[IndexArray, FloatArray, _Pieces]],
) -> tuple[Edge, ...]:
    """Return all pieces in the order of the ring."""
    index = np.concatenate([edge for edge, _, _ in found])
    begin = np.concatenate([start for _, start, _ in found])
    edges = [edge for _, _, pieces in found for edge in pieces.edges()]
    return tuple(edges[i] for i in np.lexsort((begin, index)))
