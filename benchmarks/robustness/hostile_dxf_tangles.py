"""DXF drawings that make no part: lines and outlines without number, tangled."""

from __future__ import annotations

import math
from collections.abc import Iterator

from benchmarks.robustness.hostile_task import FINE, Case, drawing
from tests.planner.drawings.dxf_text import (
    box,
    circle,
    dxf,
    entity,
    line,
    lwpolyline,
    xy,
)

MANY = 20_000  # entities, about as many as are read


def tangles() -> Iterator[Case]:
    """Yield what is drawn on one layer in sensible numbers, and makes no part."""
    yield from _lines()
    yield from _circles()
    yield from _outlines()
    yield from _near_misses()


def _lines() -> Iterator[Case]:
    """Yield lines and arcs that cross, meet or lie along each other."""
    chords = [
        line(on_circle(k / MANY, 500), on_circle(k * 0.381966 % 1 + 0.25, 500))
        for k in range(MANY // 2)
    ]
    yield drawing("10000 crossing lines", lambda: dxf(*chords))
    yield drawing("20000 lines through one point", lambda: dxf(
        *(line(on_circle(k / MANY, 100), on_circle(k / MANY + 0.5, 100))
          for k in range(MANY))
    ))  # fmt: skip
    yield drawing("20000 lines from one point", lambda: dxf(
        *(line((0, 0), on_circle(k / MANY, 100)) for k in range(MANY))
    ))  # fmt: skip
    yield drawing("100 x 100 crossing lines, all ends loose", lambda: dxf(
        *(line((k, -1), (k, 100)) for k in range(100)),
        *(line((-1, k), (100, k)) for k in range(100)),
    ))  # fmt: skip
    yield drawing("20000 lines along each other", lambda: dxf(
        *(line((0, 0), (k + 1, 0)) for k in range(MANY))
    ))  # fmt: skip
    for count in (700, 2000):
        yield drawing(f"{count} lines along each other", _along(count))
    yield drawing("20000 arcs along each other", lambda: dxf(*(
        entity("ARC", *xy(10, (0, 0)), (40, 50), (50, 0), (51, 1 + k * 0.01))
        for k in range(MANY)
    )))  # fmt: skip


def _circles() -> Iterator[Case]:
    """Yield circles over, in and beside each other."""
    yield drawing("20000 circles that overlap", lambda: dxf(
        *(circle((k * 0.01, 0), 500) for k in range(MANY))
    ))  # fmt: skip
    yield drawing("1000 circles that overlap", lambda: dxf(
        *(circle((k * 0.5, 0), 500) for k in range(1000))
    ))  # fmt: skip
    yield drawing("20000 equal circles", lambda: dxf(
        *(circle((0, 0), 500) for k in range(MANY))
    ), statuses=FINE)  # fmt: skip
    for count in (1000, 5000, 20_000):
        yield drawing(f"{count} rings in each other", _rings(count))
    yield drawing("20000 circles side by side", lambda: dxf(
        *(circle((k % 150 * 3, k // 150 * 3), 1) for k in range(MANY))
    ))  # fmt: skip
    yield drawing("a plate with 19000 holes", lambda: dxf(
        box(450, 450, (-2, -2)),
        *(circle((k % 140 * 3, k // 140 * 3), 1) for k in range(19_000)),
    ), statuses=FINE)  # fmt: skip


def _outlines() -> Iterator[Case]:
    """Yield outlines of very many corners."""
    for count in (5000, 19_999):
        yield drawing(f"a star of {count} corners, crossing itself", _star(count))
        yield drawing(f"a spiral ring of {count} corners", _spiral(count),
                      statuses=FINE)  # fmt: skip
        yield drawing(f"a comb of {count} corners", _comb(count), statuses=FINE)
        round_ = dxf(
            lwpolyline([(*on_circle(k / count, 500), 0) for k in range(count)])
        )
        yield drawing(f"a round ring of {count} corners", round_, statuses=FINE)
        yield drawing(f"a gear of {count} corners", _toothed(count), statuses=FINE)
        yield drawing(f"a star of {count} corners of lines", _loose_star(count))
    yield drawing("two combs of 5000 corners that overlap", lambda: dxf(
        lwpolyline(_comb_rows(5000)),
        lwpolyline([(y, x, 0) for x, y, _ in _comb_rows(5000)]),
    ))  # fmt: skip


def _near_misses() -> Iterator[Case]:
    """Yield ends that nearly meet."""
    yield drawing("10000 gaps of 5 nm", lambda: dxf(*(
        line(on_circle(k / 10_000, 500), on_circle((k + 1) / 10_000 - 2e-6, 500))
        for k in range(10_000)
    )), statuses=FINE)  # fmt: skip
    yield drawing("10000 points of 16 lines each within 10 nm", lambda: dxf(*(
        line((k % 1000, j * 1e-4), (k % 1000 + 0.5, j * 1e-4))
        for k in range(1000)
        for j in range(16)
    )))  # fmt: skip


def _along(count: int) -> str:
    """Return lines on one line, each over most of the others."""
    return dxf(*(line((k, 0), (count + k, 0)) for k in range(count)))


def _rings(count: int) -> str:
    return dxf(*(circle((0, 0), 1 + k * 0.02) for k in range(count)))


def _star(count: int) -> str:
    """Return a closed polyline that goes round nearly half-way at every corner."""
    step = count // 2 - (0 if count % 2 else 1)
    corners = [on_circle(k * step % count / count, 500) for k in range(count)]
    return dxf(lwpolyline([(*corner, 0) for corner in corners]))


def _loose_star(count: int) -> str:
    """Return the same as lines."""
    step = count // 2 - (0 if count % 2 else 1)
    corners = [on_circle(k * step % count / count, 500) for k in range(count)]
    ends = [*corners[1:], corners[0]]
    return dxf(*(line(a, b) for a, b in zip(corners, ends, strict=True)))


def _spiral(count: int) -> str:
    """Return a band wound up, which crosses nothing."""
    half = count // 2
    out = [(*on_circle(k / 100, 100 + k * 0.02), 0.0) for k in range(half)]
    back = [(*on_circle(k / 100, 101 + k * 0.02), 0.0) for k in reversed(range(half))]
    return dxf(lwpolyline(out + back))


def _comb(count: int) -> str:
    return dxf(lwpolyline(_comb_rows(count)))


def _comb_rows(count: int) -> list[tuple[float, ...]]:
    """Return corners of long thin teeth."""
    teeth = (count - 2) // 4
    rows: list[tuple[float, ...]] = []
    for k in range(teeth):
        x = 1000.0 * k / teeth
        d = 250.0 / teeth
        rows += [(x, 0, 0), (x, 1000, 0), (x + d, 1000, 0), (x + d, 0, 0)]
    return [*rows, (1000, -10, 0), (0, -10, 0)]


def _toothed(count: int) -> str:
    """Return a round ring with fine teeth of equal form."""
    radii = (500, 500, 499, 499)
    return dxf(
        lwpolyline(
            [(*on_circle(k / count, radii[k % 4]), 0) for k in range(count // 4 * 4)]
        )
    )


def on_circle(turns: float, radius: float) -> tuple[float, float]:
    """Return a point of a circle about the origin, to 1e-6."""
    angle = math.tau * turns
    x, y = radius * math.cos(angle), radius * math.sin(angle)
    return round(x, 6) + 0.0, round(y, 6) + 0.0
