"""Curves of a drawing under affine maps, as edges of an outline.

Points are complex, x + i y. Lines and circles under similarities stay what they are;
ellipses and splines become chains of tangent arcs (biarcs) within a stated tolerance.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from microplan.optics.outline.outline import Arc, Edge
from microplan.planner.drawings.affine import Affine
from microplan.planner.drawings.biarcs import CurveSpan, biarcs, segment, unit

ROUND_UM = 1e-6  # half axes closer than this make a circle: rounding of 1e4 um


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
        return [segment(self.start, self.end)]


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
            out += biarcs(_EllipseSpan(self, low, low + step), size, most - len(out))
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
                out.append(segment(span[0][0], span[-1][0]))
            else:
                raised = tuple((z * w, w) for z, w in span)
                out += biarcs(_BezierSpan(raised), size, most - len(out))
        return out


Shape = Line | EllipticArc | Spline


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

    def halves(self) -> tuple[CurveSpan, CurveSpan]:
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
        point, weight = self._split(fraction)[1][0]
        return point / weight

    def halves(self) -> tuple[CurveSpan, CurveSpan]:
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


def _is_straight(points: Sequence[complex]) -> bool:
    """Return whether control points lie on one line in order."""
    along = unit(points[-1] - points[0])
    if not along:
        return False
    local = [(z - points[0]) * along.conjugate() for z in points]
    if any(abs(z.imag) > ROUND_UM for z in local):
        return False
    return all(b.real >= a.real for a, b in pairwise(local))


def _first_step(points: Sequence[complex]) -> complex:
    """Return the difference from the first point to the next other one."""
    for z in points[1:]:
        if abs(z - points[0]) > 1e-9 * abs(points[-1] - points[0]):
            return z - points[0]
    return points[-1] - points[0]


def _circular(center: complex, p: complex, start_rad: float, sweep_rad: float) -> Arc:
    """Return the points center + p exp(it) as an arc."""
    return Arc(
        center=(center.real, center.imag),
        radius_um=abs(p),
        start_rad=cmath.phase(p) + start_rad,
        sweep_rad=sweep_rad,
    )
