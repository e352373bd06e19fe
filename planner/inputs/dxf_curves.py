"""Curves of a drawing under affine maps, and as the segments and arcs of an outline.

Points are complex, x + i y. Lines and circles under similarities stay what they are;
ellipses and splines become chains of tangent arcs (biarcs) within a stated tolerance.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

from optics.outline import Arc, Edge, Segment

# How far a chain of arcs may be from its curve: 20 pm, and less for curves smaller than
# 100 um. That keeps areas to 1e-6 down to ellipses of 5 : 1, with some 400 arcs each.
CURVE_UM = 1e-4
CURVE_PART = 1e-6
ROUND_UM = 1e-6  # half axes closer than this make a circle: rounding of 1e4 um
_DEEPEST = 24  # halvings of one span: a smooth curve needs fewer than 10
_PROBES = tuple(k / 8 for k in (4, 2, 6, 1, 3, 5, 7))  # of a span, the likely first


class TooManyError(ValueError):
    """Curves need more edges than allowed."""


@dataclass(frozen=True, slots=True)
class Affine:
    """A map of the plane, z -> a z + b conj(z) + t; a similarity if a or b is 0."""

    a: complex = 1 + 0j
    b: complex = 0j
    t: complex = 0j

    @classmethod
    def scale(cls, x: float, y: float) -> Affine:
        """Return the map that scales along the axes."""
        return cls(complex((x + y) / 2), complex((x - y) / 2))

    def point(self, z: complex) -> complex:
        """Return the image of a point."""
        return self.vector(z) + self.t

    def vector(self, z: complex) -> complex:
        """Return the image of a difference of points."""
        return self.a * z + self.b * z.conjugate()

    def of(self, inner: Affine) -> Affine:
        """Return the map that applies `inner` first."""
        a = self.a * inner.a + self.b * inner.b.conjugate()
        b = self.a * inner.b + self.b * inner.a.conjugate()
        return Affine(a, b, self.point(inner.t))

    @property
    def stretch(self) -> float:
        """Return the largest factor by which lengths grow."""
        return abs(self.a) + abs(self.b)


@dataclass(frozen=True, slots=True)
class Line:
    """A straight line."""

    start: complex
    end: complex

    def under(self, map_: Affine) -> Line:
        """Return its image."""
        return Line(map_.point(self.start), map_.point(self.end))

    def edges(self, most: int) -> list[Edge]:  # noqa: ARG002 - one of three
        """Return it as an edge."""
        return [_segment(self.start, self.end)]


@dataclass(frozen=True, slots=True)
class EllipticArc:
    """The points center + cos(t) u + sin(t) v for t from `start_rad` on."""

    center: complex
    u: complex
    v: complex
    start_rad: float
    sweep_rad: float

    @classmethod
    def circular(
        cls, center: complex, radius: float, start_rad: float, sweep_rad: float
    ) -> EllipticArc:
        """Return an arc of a circle."""
        return cls(center, complex(radius), 1j * radius, start_rad, sweep_rad)

    @property
    def full(self) -> bool:
        """Return whether it closes on itself."""
        return abs(abs(self.sweep_rad) - math.tau) < 1e-9

    def under(self, map_: Affine) -> EllipticArc:
        """Return its image."""
        return EllipticArc(
            map_.point(self.center),
            map_.vector(self.u),
            map_.vector(self.v),
            self.start_rad,
            self.sweep_rad,
        )

    def edges(self, most: int) -> list[Edge]:
        """Return an arc if it is one of a circle, else biarcs."""
        # cos(t) u + sin(t) v = p exp(it) + q exp(-it), with half axes |p| +- |q|
        p, q = (self.u - 1j * self.v) / 2, (self.u + 1j * self.v) / 2
        if 2 * abs(q) <= ROUND_UM < abs(p):
            return [_circular(self.center, p, self.start_rad, self.sweep_rad)]
        if 2 * abs(p) <= ROUND_UM < abs(q):
            return [_circular(self.center, q, -self.start_rad, -self.sweep_rad)]
        if abs(abs(p) - abs(q)) <= ROUND_UM:
            raise ValueError("its ellipse has no width")
        size = 2 * (abs(p) + abs(q))
        count = math.ceil(abs(self.sweep_rad) / (math.pi / 4))
        step = self.sweep_rad / count
        out: list[Edge] = []
        for k in range(count):
            low = self.start_rad + k * step
            out += _biarcs(_EllipseSpan(self, low, low + step), size, most - len(out))
        return out

    def at(self, angle: float) -> complex:
        """Return the point at a parameter."""
        return self.center + math.cos(angle) * self.u + math.sin(angle) * self.v

    def along(self, angle: float) -> complex:
        """Return the derivative by the parameter, in the direction of the sweep."""
        slope = math.cos(angle) * self.v - math.sin(angle) * self.u
        return math.copysign(1.0, self.sweep_rad) * slope


@dataclass(frozen=True, slots=True)
class Spline:
    """Rational Bezier spans, each joined to the one before."""

    spans: tuple[tuple[tuple[complex, float], ...], ...]  # control points and weights

    def under(self, map_: Affine) -> Spline:
        """Return its image: control points go with the map, weights stay."""
        return Spline(
            tuple(tuple((map_.point(z), w) for z, w in span) for span in self.spans)
        )

    def edges(self, most: int) -> list[Edge]:
        """Return segments where it is straight, else biarcs."""
        xs = [z.real for span in self.spans for z, _ in span]
        ys = [z.imag for span in self.spans for z, _ in span]
        size = math.hypot(max(xs) - min(xs), max(ys) - min(ys))
        out: list[Edge] = []
        for span in self.spans:
            if _is_straight([z for z, _ in span]):
                out.append(_segment(span[0][0], span[-1][0]))
            else:
                raised = tuple((z * w, w) for z, w in span)
                out += _biarcs(_BezierSpan(raised), size, most - len(out))
        return out


Shape = Line | EllipticArc | Spline


class _Span(Protocol):
    """A smooth stretch of a curve."""

    def ends(self) -> tuple[complex, complex]: ...
    def tangents(self) -> tuple[complex, complex]: ...
    def at(self, fraction: float) -> complex: ...
    def halves(self) -> tuple[_Span, _Span]: ...


@dataclass(frozen=True, slots=True)
class _EllipseSpan:
    curve: EllipticArc
    low: float
    high: float

    def ends(self) -> tuple[complex, complex]:
        return self.curve.at(self.low), self.curve.at(self.high)

    def tangents(self) -> tuple[complex, complex]:
        return self.curve.along(self.low), self.curve.along(self.high)

    def at(self, fraction: float) -> complex:
        return self.curve.at(self.low + fraction * (self.high - self.low))

    def halves(self) -> tuple[_Span, _Span]:
        middle = (self.low + self.high) / 2
        return (
            _EllipseSpan(self.curve, self.low, middle),
            _EllipseSpan(self.curve, middle, self.high),
        )


@dataclass(frozen=True, slots=True)
class _BezierSpan:
    points: tuple[tuple[complex, float], ...]  # weight times point, weight

    def ends(self) -> tuple[complex, complex]:
        (z0, w0), (z1, w1) = self.points[0], self.points[-1]
        return z0 / w0, z1 / w1

    def tangents(self) -> tuple[complex, complex]:
        plain = [z / w for z, w in self.points]
        return _first_step(plain), -_first_step(plain[::-1])

    def at(self, fraction: float) -> complex:
        rest = 1 - fraction
        row = self.points
        while len(row) > 1:
            row = tuple(
                (rest * z0 + fraction * z1, rest * w0 + fraction * w1)
                for (z0, w0), (z1, w1) in pairwise(row)
            )
        return row[0][0] / row[0][1]

    def halves(self) -> tuple[_Span, _Span]:
        left, right = self._split(0.5)
        return _BezierSpan(left), _BezierSpan(right)

    def _split(self, t: float) -> tuple[tuple[tuple[complex, float], ...], ...]:
        """Return both parts of the span, by de Casteljau's scheme."""
        row = list(self.points)
        left, right = [row[0]], [row[-1]]
        while len(row) > 1:
            row = [
                ((1 - t) * z0 + t * z1, (1 - t) * w0 + t * w1)
                for (z0, w0), (z1, w1) in pairwise(row)
            ]
            left.append(row[0])
            right.append(row[-1])
        return tuple(left), tuple(right[::-1])


def spline(
    degree: int, knots: Sequence[float], controls: Sequence[tuple[complex, float]]
) -> Spline:
    """Return a B-spline as Bezier spans.

    Parameters
    ----------
    degree : int
        At least 1.
    knots : sequence of float
        Never falling, `len(controls) + degree + 1` of them.
    controls : sequence of (complex, float)
        Control points with their weights, > 0.

    References
    ----------
    Control points of a span are the polar form at its two knots: Ramshaw (1989),
    "Blossoms are polar forms".
    """
    raised = [(z * w, w) for z, w in controls]
    spans = []
    for j in range(degree, len(controls)):
        low, high = knots[j], knots[j + 1]
        if not low < high:
            continue
        local = raised[j - degree : j + 1]
        near = knots[j - degree + 1 : j + degree + 1]
        polar = [
            _polar([low] * (degree - k) + [high] * k, near, local)
            for k in range(degree + 1)
        ]
        spans.append(tuple((z / w, w) for z, w in polar))
    if not spans:
        raise ValueError("it has no knot interval")
    return Spline(tuple(spans))


def bulged(start: complex, end: complex, bulge: float) -> Shape:
    """Return the arc from `start` to `end`; bulge = tan(sweep / 4)."""
    chord = end - start
    if abs(bulge) < 1e-8 or not chord:  # a sagitta of 5e-9 chords
        return Line(start, end)
    center = (start + end) / 2 + 1j * chord * (1 - bulge**2) / (4 * bulge)
    radius = abs(chord) * (1 + bulge**2) / (4 * abs(bulge))
    from_rad = cmath.phase(start - center)
    return EllipticArc.circular(center, radius, from_rad, 4 * math.atan(bulge))


def _polar(
    at: Sequence[float],
    knots: Sequence[float],
    controls: Sequence[tuple[complex, float]],
) -> tuple[complex, float]:
    """Return the polar form of one span at `at`, from its 2 n knots."""
    degree = len(at)
    row = list(controls)
    for r, x in enumerate(at):
        for i in range(degree - r):
            low, high = knots[i + r], knots[i + degree]
            f = (x - low) / (high - low)
            (z0, w0), (z1, w1) = row[i], row[i + 1]
            row[i] = (1 - f) * z0 + f * z1, (1 - f) * w0 + f * w1
    return row[0]


def _biarcs(whole: _Span, size_um: float, most: int) -> Iterator[Edge]:
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
        yield from pair if pair is not None else [_segment(*span.ends())]


def _pair(span: _Span, within: float) -> list[Edge] | None:
    """Return the biarc of a span, None if it is not near enough.

    Both tangents are as long as each other: Bolton (1975), "Biarc curves".
    """
    start, end = span.ends()
    if abs(end - start) <= within and all(
        abs(span.at(f) - start) <= within for f in _PROBES
    ):
        return [_segment(start, end)]
    one, two = (_unit(t) for t in span.tangents())
    chord = end - start
    along = (chord * (one + two).conjugate()).real
    turn = 1 - (one * two.conjugate()).real
    if along <= 0 or turn > 0.5:  # bends by more than 60 degrees
        return None
    # the root of turn d^2 + along d = |chord|^2 / 2 that is right for turn = 0 too
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
        return _segment(end, start) if turned else _segment(start, end)
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
    return abs(((z - start) * _unit(end - start).conjugate()).imag)


def _is_straight(points: Sequence[complex]) -> bool:
    """Return whether control points lie on one line in order."""
    way = _unit(points[-1] - points[0])
    if not way:
        return False
    local = [(z - points[0]) * way.conjugate() for z in points]
    if any(abs(z.imag) > ROUND_UM for z in local):
        return False
    return all(b.real >= a.real for a, b in pairwise(local))


def _first_step(points: Sequence[complex]) -> complex:
    """Return the way from the first point to the next one that differs."""
    for z in points[1:]:
        if abs(z - points[0]) > 1e-9 * abs(points[-1] - points[0]):
            return z - points[0]
    return points[-1] - points[0]


def _unit(z: complex) -> complex:
    return z / abs(z) if z else 0j


def _circular(center: complex, p: complex, start_rad: float, sweep_rad: float) -> Arc:
    """Return the points center + p exp(it) as an arc."""
    return Arc(
        center=(center.real, center.imag),
        radius_um=abs(p),
        start_rad=cmath.phase(p) + start_rad,
        sweep_rad=sweep_rad,
    )


def _segment(start: complex, end: complex) -> Segment:
    return Segment(start=(start.real, start.imag), end=(end.real, end.imag))
