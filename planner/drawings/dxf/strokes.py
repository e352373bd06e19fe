"""The border of a polyline with a width: what its stroke fills, exactly.

Straight edges meet in a mitre, as drawing programs show them; arcs are joined where
they go on in the same direction. Ends are cut square.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from microplan.planner.drawings.dxf.curves import EllipticArc, Line, Shape, bulged
from microplan.planner.drawings.dxf.paths import Path, UnreadableError

_SAME = 1e-9  # relative: widths and directions closer than this are equal
_SMOOTH_RAD = 1e-6  # edges that bend by less have one direction
_MITRE_RAD = math.radians(150)  # sharper bends are drawn differently by programs


@dataclass(frozen=True, slots=True)
class Knee:
    """A vertex, and the bulge and widths of the edge after it."""

    at: complex
    bulge: float
    start_width: float
    end_width: float


def stroke(knees: Sequence[Knee], *, closed: bool) -> list[Path]:
    """Return the border of a polyline's stroke: one ring, two if it is closed.

    Raises
    ------
    UnreadableError
        If the width changes at a vertex or along a bent edge, an arc is tighter than
        half the width, or edges meet at an angle that has no one reading.
    """
    pairs = [(a, b) for a, b in pairwise(knees) if a.at != b.at]
    if closed and knees[-1].at != knees[0].at:
        pairs.append((knees[-1], knees[0]))
    if not pairs:
        raise UnreadableError("its stroke has no length")
    centre = [bulged(a.at, b.at, a.bulge) for a, b in pairs]
    widths = [(a.start_width, a.end_width) for a, _ in pairs]
    if len(pairs) == 1 and isinstance(centre[0], Line):
        return [_taper(centre[0], *widths[0])]
    width = widths[0][0]
    if any(abs(w - width) > _SAME * abs(width) for pair in widths for w in pair):
        raise UnreadableError("its width changes along it")
    if not width > 0:
        raise UnreadableError(f"its width is {width}")
    sides = [_side(centre, sign * width / 2, closed=closed) for sign in (1, -1)]
    if closed:
        return [Path(tuple(s), closed=True, stroke=True) for s in sides if s]
    left, right = sides[0], [_turned(shape) for shape in reversed(sides[1])]
    border = [*left, Line(_end(left[-1]), _start(right[0])), *right]
    border.append(Line(_end(border[-1]), _start(border[0])))
    return [Path(tuple(border), closed=True, stroke=True)]


def _taper(line: Line, start_width: float, end_width: float) -> Path:
    """Return a straight stroke whose width may change along it."""
    along = line.end - line.start
    left = 1j * along / abs(along) / 2
    corners = [
        line.start + start_width * left, line.end + end_width * left,
        line.end - end_width * left, line.start - start_width * left,
    ]  # fmt: skip
    once = [a for a, b in pairwise([*corners, corners[0]]) if a != b]
    sides = tuple(Line(a, b) for a, b in pairwise([*once, once[0]]))
    return Path(sides, closed=True, stroke=True)


def _side(centre: Sequence[Shape], shift: float, *, closed: bool) -> list[Shape]:
    """Return the border `shift` to the left of a centre line, corners mitred."""
    moved = [_moved(shape, shift) for shape in centre]
    if any(shape is None for shape in moved):  # the middle of a ring without a hole
        if closed and all(shape is None for shape in moved):
            return []
        raise UnreadableError("an arc of it is tighter than half its width")
    out = [shape for shape in moved if shape is not None]
    joints = range(len(out)) if closed else range(1, len(out))
    for k in joints:
        turn = cmath.phase(_leaving(centre[k]) / _arriving(centre[k - 1]))
        if abs(turn) <= _SMOOTH_RAD:
            continue
        before, after = out[k - 1], out[k]
        if not (isinstance(before, Line) and isinstance(after, Line)):
            raise UnreadableError("an arc of its stroke meets an edge at an angle")
        if abs(turn) > _MITRE_RAD:
            raise UnreadableError(f"its stroke turns by {math.degrees(turn):.0f} deg")
        corner = before.end + _leaving(before) * math.tan(turn / 2) * -shift
        out[k - 1], out[k] = Line(before.start, corner), Line(corner, after.end)
    _refuse_flipped(centre, out)
    return out


def _moved(shape: Shape, shift: float) -> Shape | None:
    """Return a line or arc moved to its left; None if nothing is left of it."""
    if isinstance(shape, Line):
        side = 1j * _leaving(shape) * shift
        return Line(shape.start + side, shape.end + side)
    if not isinstance(shape, EllipticArc):
        raise TypeError("a polyline is made of lines and arcs")
    radius = abs(shape.u)
    inner = radius - shift * math.copysign(1.0, shape.sweep_rad)
    if abs(inner) <= _SAME * radius:
        return None
    if inner < 0:
        raise UnreadableError("an arc of it is tighter than half its width")
    return EllipticArc.circular(shape.center, inner, shape.start_rad, shape.sweep_rad)


def _refuse_flipped(centre: Sequence[Shape], side: Sequence[Shape]) -> None:
    """Refuse edges that mitres have reversed: they are too short for the width."""
    for shape, border in zip(centre, side, strict=True):
        if isinstance(shape, Line) and isinstance(border, Line):
            along = (border.end - border.start) * _leaving(shape).conjugate()
            if along.real <= 0:
                raise UnreadableError("an edge of it is too short for its width")


def _leaving(shape: Shape) -> complex:
    """Return the unit direction at the start of a line or arc."""
    if isinstance(shape, EllipticArc):
        return cmath.rect(math.copysign(1.0, shape.sweep_rad), shape.start_rad) * 1j
    along = _end(shape) - _start(shape)
    return along / abs(along)


def _arriving(shape: Shape) -> complex:
    """Return the unit direction at the end of a line or arc."""
    if isinstance(shape, EllipticArc):
        end_rad = shape.start_rad + shape.sweep_rad
        return cmath.rect(math.copysign(1.0, shape.sweep_rad), end_rad) * 1j
    return _leaving(shape)


def _turned(shape: Shape) -> Shape:
    """Return a line or arc with its direction reversed."""
    if isinstance(shape, EllipticArc):
        end_rad = shape.start_rad + shape.sweep_rad
        return EllipticArc(shape.center, shape.u, shape.v, end_rad, -shape.sweep_rad)
    return Line(_end(shape), _start(shape))


def _start(shape: Shape) -> complex:
    if isinstance(shape, Line):
        return shape.start
    if isinstance(shape, EllipticArc):
        return shape.at(shape.start_rad)
    return shape.spans[0][0][0]


def _end(shape: Shape) -> complex:
    if isinstance(shape, Line):
        return shape.end
    if isinstance(shape, EllipticArc):
        return shape.at(shape.start_rad + shape.sweep_rad)
    return shape.spans[-1][-1][0]
