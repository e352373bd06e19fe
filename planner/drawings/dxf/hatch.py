"""The boundaries of a HATCH: polylines with bulges, or lines, arcs, splines.

Codes: Autodesk, DXF Reference, "HATCH" and "Boundary path data".
"""

from __future__ import annotations

import math
from itertools import pairwise

from microplan.planner.drawings.dxf.curves import (
    EllipticArc,
    Line,
    Shape,
    bulged,
    spline,
)
from microplan.planner.drawings.dxf.file import DamagedError, Entity, finite
from microplan.planner.drawings.dxf.paths import Path, UnreadableError, knots_fit

_POLYLINE = 2  # bit of a path's flags
_MOST_DEGREE = 15


class _HatchReader:
    """A cursor over the tags of a hatch, in the order that the format has."""

    def __init__(self, entity: Entity) -> None:
        self._tags = entity.tags
        self._at = entity.first
        self._last = entity.last

    def skip_to(self, code: int) -> None:
        """Go to the next tag with this code."""
        while self._at < self._last and not self.has(code):
            self._at += 1

    def skip_one(self, code: int) -> None:
        """Go past the next tag, which has this code."""
        if not self.has(code):
            raise DamagedError(f"its boundary lacks group {code}")
        self._at += 1

    def skip_fit_points(self) -> None:
        """Go past the fit points of a spline, which files before R2010 do not have."""
        before = self._at
        if self.has(97) and self.whole(97) and not self.has(11):
            self._at = before  # it counts the boundary's sources instead
        while any(self.has(code) for code in (11, 12, 13)):
            self.point(self._tags.codes[self._at])

    def has(self, code: int) -> bool:
        """Return whether the next tag has this code."""
        return self._at < self._last and self._tags.codes[self._at] == code

    def number(self, code: int) -> float:
        """Return the next tag's value."""
        if not self.has(code):
            raise DamagedError(f"its boundary lacks group {code}")
        self._at += 1
        return finite(self._tags, self._at - 1)

    def whole(self, code: int) -> int:
        """Return the next tag's value, a count or flags."""
        value = self.number(code)
        if value != int(value) or value < 0:
            raise DamagedError(f"group {code} of its boundary is {value}")
        return int(value)

    def point(self, code: int) -> complex:
        """Return the next two tags' values."""
        return complex(self.number(code), self.number(code + 10))


def hatch_paths(entity: Entity) -> list[Path]:
    """Return the boundaries of a HATCH.

    Raises
    ------
    UnreadableError
        If a boundary is a part of an ellipse, for whose angles programs have two
        conventions.
    DamagedError
        If it holds other numbers of paths, edges or vertices than it declares.
    """
    tags = _HatchReader(entity)
    tags.skip_to(91)
    count = tags.whole(91)
    paths = []
    for _ in range(count):
        flags = tags.whole(92)
        paths.append(_polyline(tags) if flags & _POLYLINE else _edges(tags))
        for _ in range(tags.whole(97) if tags.has(97) else 0):
            tags.skip_one(330)
    return paths


def _polyline(tags: _HatchReader) -> Path:
    bent, closed = tags.whole(72), tags.whole(73)
    knees = []
    for _ in range(tags.whole(93)):
        z = tags.point(10)
        knees.append((z, tags.number(42) if bent and tags.has(42) else 0.0))
    if len(knees) < 2 or not closed:
        raise UnreadableError("a boundary of it is open")
    shapes = tuple(
        bulged(a, b, bulge)
        for (a, bulge), (b, _) in pairwise([*knees, knees[0]])
        if a != b
    )
    return Path(shapes, closed=True)


def _edges(tags: _HatchReader) -> Path:
    shapes = tuple(_EDGES[_kind(tags)](tags) for _ in range(tags.whole(93)))
    full = len(shapes) == 1 and isinstance(shapes[0], EllipticArc) and shapes[0].full
    return Path(shapes, closed=full)


def _kind(tags: _HatchReader) -> int:
    kind = tags.whole(72)
    if kind not in _EDGES:
        raise UnreadableError(f"a boundary of it has edges of kind {kind}")
    return kind


def _line(tags: _HatchReader) -> Shape:
    return Line(tags.point(10), tags.point(11))


def _arc(tags: _HatchReader) -> Shape:
    center, radius = tags.point(10), tags.number(40)
    start, sweep = _angles(tags)
    if not radius > 0:
        raise ValueError(f"a radius of its boundary is {radius}")
    return EllipticArc.circular(center, radius, start, sweep)


def _ellipse(tags: _HatchReader) -> Shape:
    center, major, ratio = tags.point(10), tags.point(11), tags.number(40)
    start, sweep = _angles(tags)
    arc = EllipticArc(center, major, 1j * major * ratio, start, sweep)
    if not arc.full:
        raise UnreadableError("a boundary of it has a part of an ellipse")
    return arc


def _angles(tags: _HatchReader) -> tuple[float, float]:
    """Return start and sweep; angles of clockwise edges are counted clockwise."""
    start, end = tags.number(50), tags.number(51)
    sweep = math.radians((end - start) % 360 or 360.0)
    sign = 1 if tags.whole(73) else -1
    return sign * math.radians(start), sign * sweep


def _spline(tags: _HatchReader) -> Shape:
    degree, _, _ = tags.whole(94), tags.whole(73), tags.whole(74)
    if not 1 <= degree <= _MOST_DEGREE:
        raise UnreadableError(f"a boundary of it has degree {degree}")
    knot_count, point_count = tags.whole(95), tags.whole(96)
    knots = [tags.number(40) for _ in range(knot_count)]
    points, weights = [], []
    for _ in range(point_count):
        points.append(tags.point(10))
        if tags.has(42):
            weights.append(tags.number(42))
    tags.skip_fit_points()
    return spline(degree, knots, knots_fit(degree, knots, points, weights))


_EDGES = {1: _line, 2: _arc, 3: _ellipse, 4: _spline}
