"""Hostile DXF files: cut short, odd numbers, much of everything, hard to judge."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.example import TASK
from benchmarks.robustness.hostile_dxf_curves import curves
from benchmarks.robustness.hostile_dxf_much import bombs, large
from benchmarks.robustness.hostile_dxf_tangles import tangles
from benchmarks.robustness.hostile_task import FINE, Case, drawing
from tests.planner.drawings.dxf_text import (
    binary,
    box,
    circle,
    dxf,
    entity,
    hatch,
    insert,
    xy,
)

GEAR = TASK.parent / "parts" / "gear18.dxf"
CUTS = 9  # places at which a file is cut short
NUMBERS = ("nan", "NaN", "inf", "-Infinity", "1e308", "-1e308", "1e400", "1e-320",
            "1_0", "0x10", "", " ", "9" * 5000, "\u0661", "1,5", "--1")  # fmt: skip


def cases() -> Iterator[Case]:
    """Yield all hostile DXF files."""
    yield from _cut_short()
    yield from bombs()
    yield from _numbers()
    yield from tangles()
    yield from curves()
    yield from large()


def _cut_short() -> Iterator[Case]:
    whole = dxf(box(100, 60), circle((50, 30), 10))
    for name, data in (
        ("text", whole.encode()),
        ("binary", binary(whole, short=False)),
        ("gear", GEAR.read_bytes()),
    ):
        for k in range(CUTS):
            end = (len(data) - 5) * k // (CUTS - 1)
            layer = "OUTLINE" if name == "gear" else "A"
            yield drawing(f"{name} DXF cut at byte {end}", data[:end], layer=layer)


def _numbers() -> Iterator[Case]:
    """Yield odd numbers in every place, and counts of what is not there."""
    for value in NUMBERS:
        short = value if len(value) < 20 else f"{len(value)} nines"
        yield from _lengths(value, short)
        yield from _counts(value, short)
        yield from _codes(value, short)
    yield from _announced()


def _lengths(value: str, short: str) -> Iterator[Case]:
    """Yield a number as coordinate, radius, scale and bulge."""
    yield drawing(
        f"an x of {short!r}", _box_with(x=value),
        statuses=FINE if value in ("1e-320", "\u0661") else frozenset((2,)),
    )  # fmt: skip
    yield drawing(f"a radius of {short!r}", dxf(
        box(100, 60), entity("CIRCLE", *xy(10, (50, 30)), (40, value)),
    ), statuses=FINE)  # fmt: skip
    yield drawing(f"a scale of {short!r}", dxf(
        insert("B", (0, 0), (41, value), (42, value)),
        blocks=[("B", (0, 0), [circle((0, 0), 10)])],
    ), statuses=FINE)  # fmt: skip
    yield drawing(f"a bulge of {short!r}", dxf(
        entity("LWPOLYLINE", (90, 2), (70, 1), *xy(10, (0, 0)), (42, value),
               *xy(10, (10, 0)), (42, 1)),
    ), statuses=FINE)  # fmt: skip


def _counts(value: str, short: str) -> Iterator[Case]:
    """Yield a number as a count."""
    yield drawing(f"a count of {short!r}", dxf(
        entity("LWPOLYLINE", (90, value), (70, 1), *xy(10, (0, 0)),
               *xy(10, (10, 0)), *xy(10, (10, 10))),
    ), statuses=FINE)  # fmt: skip
    yield drawing(f"an array of {short!r}", dxf(
        insert("B", (0, 0), (70, value)),
        blocks=[("B", (0, 0), [circle((0, 0), 10)])],
    ), statuses=FINE)  # fmt: skip


def _codes(value: str, short: str) -> Iterator[Case]:
    """Yield a number as group code and as unit."""
    yield drawing(f"a group code of {short!r}",
                  dxf(box(100, 60)).replace(" 10\n", f"{value}\n", 1),
                  statuses=FINE)  # fmt: skip
    yield drawing(
        f"units of {short!r}",
        dxf(circle((0, 0), 50)).replace("13\n", f"{value}\n"),
        statuses=FINE,
    )  # fmt: skip


def _announced() -> Iterator[Case]:
    """Yield counts of far more than there is."""
    yield drawing("hatch of 1e9 paths", dxf(entity(
        "HATCH", (2, "SOLID"), (70, 1), (91, 1_000_000_000)
    )))  # fmt: skip
    yield drawing("hatch spline of 1e9 knots", dxf(hatch(
        [(92, 1), (93, 1), (72, 4), (94, 3), (73, 0), (74, 0), (95, 1_000_000_000),
         (96, 5)]
    )))  # fmt: skip
    yield drawing("hatch of 1e300 paths", dxf(entity("HATCH", (91, "1e300"))))


def _box_with(x: str) -> str:
    """Return a box, one corner's x written as told."""
    corners = [("0", "0"), (x, "0"), (x, "60"), ("0", "60")]
    lines = []
    for (x0, y0), (x1, y1) in zip(corners, [*corners[1:], corners[0]], strict=True):
        lines.append(entity("LINE", (10, x0), (20, y0), (11, x1), (21, y1)))
    return dxf(*lines)
