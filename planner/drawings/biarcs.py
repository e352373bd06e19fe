"""Smooth curves as chains of tangent arcs, within a stated tolerance."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from typing import Protocol

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Arc, Edge, Segment


def fit_circle(corners: FloatArray) -> tuple[tuple[float, float], float]:
    """Return centre and radius, um, of the circle nearest to points, (N, 2) um.

    Minimises the sum of ((r_k^2 - R^2) / 2)^2, which is linear in the centre and in
    R^2 (Kasa, IEEE Trans. Instrum. Meas. 25, 8, 1976).
    """
    mean = corners.mean(axis=0)
    x, y = (corners - mean).T
    rows = np.column_stack([2 * x, 2 * y, np.ones_like(x)])
    (cx, cy, rest), *_ = np.linalg.lstsq(rows, x * x + y * y, rcond=None)
    radius = math.sqrt(max(rest + cx * cx + cy * cy, 0.0))
    center = (_rounded(mean[0] + cx), _rounded(mean[1] + cy))
    return center, _rounded(radius)


def _rounded(value: float) -> float:
    """Return a length to 1e-9 um, so that a centre at 0 is at 0."""
    return round(float(value), 9) + 0.0


# How far a chain of arcs may be from its curve: 0.1 nm, and less for curves smaller
# than 100 um. Areas are right to 1e-6 down to ellipses of 5 : 1, of some 230 arcs each.
CURVE_UM = 1e-4
CURVE_PART = 1e-6
_DEEPEST = 24  # halvings of one span: a smooth curve needs fewer than 10
_PROBES = tuple(k / 8 for k in (4, 2, 6, 1, 3, 5, 7))  # of a span, the likely first


class TooManyError(ValueError):
    """Curves need more edges than allowed."""


class CurveSpan(Protocol):
    """A smooth stretch of a curve."""

    def ends(self) -> tuple[complex, complex]:
        """Return where it begins and ends."""

    def tangents(self) -> tuple[complex, complex]:
        """Return its directions there, of any length."""

    def at(self, fraction: float) -> complex:
        """Return a point of it, 0 being its start and 1 its end."""

    def halves(self) -> tuple[CurveSpan, CurveSpan]:
        """Return both halves of it."""


def biarcs(whole: CurveSpan, size_um: float, most: int) -> Iterator[Edge]:
    """Yield tangent arcs within the tolerance of a curve of that size."""
    within = min(CURVE_UM, CURVE_PART * size_um)
    waiting = [(whole, 0)]
    made = 0
    while waiting:
        span, depth = waiting.pop()
        pair = _pair(span, within)
        if pair is None and depth < _DEEPEST:
            left, right = span.halves()
            waiting += [(right, depth + 1), (left, depth + 1)]
            continue
        made += 2
        if made > most:
            raise TooManyError("its curves need too many arcs")
        yield from pair if pair is not None else [segment(*span.ends())]


def _pair(span: CurveSpan, within: float) -> list[Edge] | None:
    """Return the biarc of a span, None if it is not near enough.

    Both tangents are as long as each other: Bolton (1975), "Biarc curves".
    """
    start, end = span.ends()
    if abs(end - start) <= within and all(
        abs(span.at(f) - start) <= within for f in _PROBES
    ):
        return [segment(start, end)]
    one, two = (unit(t) for t in span.tangents())
    chord = end - start
    along = (chord * (one + two).conjugate()).real
    turn = 1 - (one * two.conjugate()).real
    if along <= 0 or turn > 0.5:  # bends by more than 60 degrees
        return None
    # the root of turn d^2 + along d = |chord|^2 / 2 that also holds for turn = 0
    square = abs(chord) ** 2
    d = square / (along + math.sqrt(along**2 + 2 * turn * square))
    joint = (start + end + d * (one - two)) / 2
    edges = [_tangent(start, one, joint), _tangent(end, -two, joint, turned=True)]
    middle = joint - start - d * one  # direction at the joint
    for f in _PROBES:
        z = span.at(f)
        edge = edges[((z - joint) * middle.conjugate()).real > 0]
        if _off(edge, z) > within:
            return None
    return edges


def _tangent(
    start: complex, along: complex, end: complex, *, turned: bool = False
) -> Edge:
    """Return the arc that leaves `start` along a unit vector and ends at `end`."""
    chord = end - start
    half = cmath.phase(chord / along)
    if abs(half * chord) < 1e-9:  # a sagitta of a femtometre
        return segment(end, start) if turned else segment(start, end)
    radius = abs(chord) / (2 * math.sin(half))  # negative to the right
    center = start + 1j * along * radius
    from_rad = cmath.phase(start - center)
    if turned:
        from_rad, half = from_rad + 2 * half, -half
    return Arc(
        center=(center.real, center.imag),
        radius_um=abs(radius),
        start_rad=from_rad,
        sweep_rad=2 * half,
    )


def _off(edge: Edge, z: complex) -> float:
    """Return the distance of a point from the line or circle of an edge."""
    if isinstance(edge, Arc):
        return abs(abs(z - complex(*edge.center)) - edge.radius_um)
    start, end = complex(*edge.start), complex(*edge.end)
    return abs(((z - start) * unit(end - start).conjugate()).imag)


def unit(z: complex) -> complex:
    return z / abs(z) if z else 0j


def segment(start: complex, end: complex) -> Segment:
    return Segment(start=(start.real, start.imag), end=(end.real, end.imag))
