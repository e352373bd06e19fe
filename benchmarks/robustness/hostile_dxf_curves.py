"""DXF curves that are hard to judge: wild splines, flat ellipses, hatches, strokes."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.robustness.hostile_dxf_tangles import on_circle
from benchmarks.robustness.hostile_task import FINE, Case, drawing
from tests.planner.drawings.dxf_text import (
    Tags,
    circle,
    dxf,
    ellipse,
    hatch,
    insert,
    polyline,
    spline,
    xy,
)


def curves() -> Iterator[Case]:
    """Yield curves that bend wildly, or of which there are many."""
    yield from _splines()
    yield from _flat_ellipses()
    yield from _hatches()
    yield from _strokes()
    yield from _scaled_circles()


def _splines() -> Iterator[Case]:
    """Yield splines that bend wildly, or have odd knots and weights."""
    for count in (1000, 9000):
        yield drawing(f"a spline of {count} wild control points", _wild(count, 3))
        yield drawing(f"a round spline of {count} control points", _round(count),
                      statuses=FINE)  # fmt: skip
    yield drawing("a spline of degree 15 and 3000 points", lambda: _wild(3000, 15))
    yield drawing("a spline of equal points", lambda: dxf(
        spline(3, [0, 0, 0, 0, 1, 1, 1, 1], [(1, 1)] * 4)
    ))  # fmt: skip
    yield drawing("a spline with weights of 1e-300 and 1e300", lambda: dxf(
        spline(3, [0, 0, 0, 0, 1, 1, 1, 1], [(0, 0), (10, 0), (10, 10), (0, 0)],
               [1, 1e-300, 1e300, 1])
    ))  # fmt: skip
    yield drawing("300 splines", lambda: dxf(*(
        spline(3, [0, 0, 0, 0, 1, 1, 1, 1],
               [(k, 0), (k + 300, 900), (k - 300, 900), (k, 0)])
        for k in range(300)
    )))  # fmt: skip


def _flat_ellipses() -> Iterator[Case]:
    """Yield ellipses that are nearly lines."""
    for ratio in (0.01, 1e-6, 1e-12):
        yield drawing(f"2000 ellipses of 1 : {ratio:g}", _ellipses(2000, ratio))
    yield drawing("an ellipse of 1 : 1e-5", _ellipses(1, 1e-5), statuses=FINE)


def _hatches() -> Iterator[Case]:
    """Yield filled areas of many edges."""
    yield drawing("a hatch of 9000 edges", lambda: dxf(hatch(_edges(9000))),
                  statuses=FINE)  # fmt: skip
    yield drawing("a hatch of 19000 crossing edges", lambda: dxf(
        hatch(_edges(19_000, turns=7919))
    ))  # fmt: skip
    yield drawing("3000 hatches over each other", lambda: dxf(*(
        hatch([(92, 3), (72, 0), (73, 1), (93, 4),
               *xy(10, (k * 0.1, 0)), *xy(10, (900, 0)), *xy(10, (900, 900)),
               *xy(10, (0, k * 0.1))])
        for k in range(3000)
    )))  # fmt: skip


def _strokes() -> Iterator[Case]:
    """Yield wide lines of many corners."""
    yield drawing("a stroke of 10000 corners", lambda: dxf(polyline(
        [(*on_circle(k / 10_000, 500), 0, 0) for k in range(10_000)], (40, 1), (41, 1)
    )), statuses=FINE)  # fmt: skip
    yield drawing("a stroke of 6000 crossing corners", lambda: dxf(polyline(
        [(*on_circle(k * 0.381966, 500), 0, 0) for k in range(6000)], (40, 1), (41, 1)
    )))  # fmt: skip


def _scaled_circles() -> Iterator[Case]:
    """Yield circles that a block makes ellipses of."""
    yield drawing("circles scaled to ellipses, 500", lambda: dxf(
        *(insert("B", (k, 0), (41, 1 + k * 1e-3)) for k in range(500)),
        blocks=[("B", (0, 0), [circle((0, 0), 400)])],
    ))  # fmt: skip


def _wild(count: int, degree: int) -> str:
    """Return a closed spline whose control points jump about."""
    points = [on_circle(k * 0.381966, 500) for k in range(count)]
    points.append(points[0])
    inner = count + 1 - degree
    knots = (
        [0.0] * degree + [float(k) for k in range(inner + 1)] + [float(inner)] * degree
    )
    return dxf(spline(degree, knots, points))


def _round(count: int) -> str:
    """Return a closed spline near a circle."""
    points = [on_circle(k / count, 500) for k in range(count)]
    points.append(points[0])
    inner = count + 1 - 3
    knots = [0.0] * 3 + [float(k) for k in range(inner + 1)] + [float(inner)] * 3
    return dxf(spline(3, knots, points))


def _ellipses(count: int, ratio: float) -> str:
    return dxf(*(ellipse((k * 0.1, k * 0.1), (400, k), ratio) for k in range(count)))


def _edges(count: int, turns: int = 1) -> Tags:
    """Return a hatch's boundary of lines round a circle."""
    corners = [on_circle(k * turns / count, 500) for k in range(count)]
    tags: Tags = [(92, 1), (93, count)]
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        tags += [(72, 1), *xy(10, a), *xy(11, b)]
    return tags
