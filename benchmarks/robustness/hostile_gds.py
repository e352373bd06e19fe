"""Hostile GDSII files: cut short, bombs, odd numbers, much that is hard to judge."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from functools import partial

from benchmarks.example import ROOT
from benchmarks.robustness.hostile_task import FINE, Case, drawing
from tests.planner.drawings.gds_writer import (
    SQUARE,
    Points,
    aref,
    boundary,
    cell,
    element,
    library,
    long,
    node,
    path,
    record,
    ring,
    short,
    sref,
    text,
    xy,
)

FILE = "parts/part.gds"
LASER = ROOT / "examples" / "laser_die" / "parts" / "laser_die.gds"
CUTS = 9  # places at which a file is cut short
MEGABYTES = 16  # what may be read of one file
_case = partial(drawing, file=FILE, layer="1/0")


def cases() -> Iterator[Case]:
    """Yield all hostile GDSII files."""
    yield from _cut_short()
    yield from _bombs()
    yield from _numbers()
    yield from _tangles()
    yield from _large()


def _cut_short() -> Iterator[Case]:
    data = LASER.read_bytes()
    for k in range(CUTS):
        end = (len(data) - 1) * k // (CUTS - 1)
        yield _case(f"GDSII cut at byte {end}", data[:end])


def _bombs() -> Iterator[Case]:
    for depth, each in ((9, 10), (5, 32_767), (31, 32_767), (40, 32_767)):
        yield _case(f"GDSII, {each}^{depth} copies", _nested(depth, each))
    yield _case("GDSII, a cell that holds itself", library(
        cell("A", boundary(SQUARE), sref("B")), cell("B", sref("B")),
    ))  # fmt: skip
    yield _case("GDSII, 30 cells that hold each other", library(
        *(cell(f"C{k}", sref(f"C{(k + 1) % 30}")) for k in range(30))
    ))  # fmt: skip
    yield _case("GDSII, 20000 cells in a chain", library(
        *(cell(f"C{k}", sref(f"C{k + 1}")) for k in range(20_000)),
        cell("C20000", boundary(SQUARE)),
    ))  # fmt: skip
    yield _case("GDSII, 2^30 copies of nothing", library(
        *(cell(f"C{k}", sref(f"C{k + 1}"), sref(f"C{k + 1}")) for k in range(30)),
        cell("C30", text("x")),
    ))  # fmt: skip
    yield _case("GDSII, 20000 references in each of 25 cells", lambda: library(
        *(cell(f"C{k}", *[sref(f"C{k + 1}")] * 4000) for k in range(25)),
        cell("C25", boundary(SQUARE)),
    ))  # fmt: skip


def _nested(depth: int, each: int) -> bytes:
    """Return arrays of arrays."""
    steps = ((20_000, 0), (0, 20_000)) if each < 100 else ((1, 0), (0, 1))
    inner = [
        cell(f"C{k}", aref(f"C{k + 1}", (0, 0), (each, 1), steps)) for k in range(depth)
    ]
    return library(*inner, cell(f"C{depth}", boundary(SQUARE)))


def _numbers() -> Iterator[Case]:
    far = 2**31 - 1
    corners = ((-far, -far), (far, -far), (far, far), (-far, far))
    yield _case("GDSII, corners at 2^31", library(cell("A", boundary(corners))))
    real = struct.Struct(">Q").pack
    for name, body in (
        ("0", bytes(8)), ("7e75", b"\x7f" + b"\xff" * 7), ("-7e75", b"\xff" * 8),
        ("5e-79", b"\x00\x10" + bytes(6)), ("unnormalised", real(0x41 << 56 | 1)),
    ):  # fmt: skip
        placed = element(
            0x0A, record(0x12, 6, b"B"), record(0x1A, 1, bytes(2)),
            record(0x1B, 5, body), record(0x1C, 5, body), xy([(0, 0)]),
        )  # fmt: skip
        file = library(cell("A", placed), cell("B", boundary(SQUARE)))
        yield _case(f"GDSII, a magnification and an angle of {name}", file)
        units = library(cell("A", boundary(SQUARE)))
        start = units.index(record(0x05, 2, bytes(24)))
        yield _case(
            f"GDSII, units of {name}",
            units[: start - 16] + body + body + units[start:],
        )
    for width in (0, -1, far, -far):
        for kind in range(6):
            shape = path([(0, 0), (10_000, 0), (10_000, 10_000)], width, kind)
            file = library(cell("A", shape))
            yield _case(f"GDSII, a path of type {kind}, width {width}", file,
                        statuses=FINE)  # fmt: skip
    yield _case("GDSII, a boundary of no points", library(
        cell("A", element(0x08, short(0x0D, 1), short(0x0E, 0), xy([])))
    ))  # fmt: skip
    yield _case("GDSII, a path of 4000 equal points", library(
        cell("A", path([(0, 0)] * 4000, 100))
    ))  # fmt: skip


def _tangles() -> Iterator[Case]:
    for count in (1000, 8000):
        yield _case(f"GDSII, a star of {count} corners", _one(_star(count)))
        yield _case(f"GDSII, a wild polygon of {count} corners", _one(_wild(count)))
        yield _case(f"GDSII, a comb of {count} corners", _one(_comb(count)),
                    statuses=FINE)  # fmt: skip
        yield _case(f"GDSII, a ring of {count} corners",
                    _one(ring(4_000_000, count)), statuses=FINE)  # fmt: skip
        yield _case(f"GDSII, a slit to each of {count // 8} holes",
                    _one(_slits(count // 8)), statuses=FINE)  # fmt: skip
        yield _case(f"GDSII, a back and forth of {count} corners",
                    _one([(k % 2 * 10_000, k % 3) for k in range(count)]))  # fmt: skip
        yield _case(f"GDSII, a wild path of {count} corners", library(
            cell("A", path(_wild(count), 50))
        ))  # fmt: skip
        yield _case(f"GDSII, a stair path of {count} corners", library(cell("A", path(
            [((k + 1) // 2 * 500, k // 2 * 500) for k in range(count)], 200
        ))), statuses=FINE)  # fmt: skip
        yield _case(f"GDSII, a stair path of {count} corners that folds back",
                    library(cell("A", path(_boustrophedon(count), 200))),
                    statuses=FINE)  # fmt: skip
    for count in (300, 2000, 20_000):
        boxes = [_shifted(SQUARE, k, k) for k in range(count)]
        yield _case(f"GDSII, {count} squares over each other", library(
            cell("A", *map(boundary, boxes))
        ), statuses=FINE)  # fmt: skip
        yield _case(f"GDSII, {count} squares side by side", library(
            cell("A", *(boundary(_shifted(SQUARE, k % 150 * 20_000, k // 150 * 20_000))
                        for k in range(count)))
        ))  # fmt: skip
        yield _case(f"GDSII, {count} squares that touch", library(
            cell("A", *(boundary(_shifted(SQUARE, k % 150 * 10_000, k // 150 * 10_000))
                        for k in range(count)))
        ), statuses=FINE)  # fmt: skip
    yield _case("GDSII, 300 discs of 300 corners over each other", library(
        cell("A", *(boundary(ring(100_000, 300, (k * 37, k * 91)))
                    for k in range(300)))
    ), statuses=FINE)  # fmt: skip
    yield _case("GDSII, 100 x 100 bars that cross", library(cell(
        "A",
        *(boundary(((k * 400, 0), (k * 400 + 200, 0), (k * 400 + 200, 40_000),
                    (k * 400, 40_000))) for k in range(100)),
        *(boundary(((0, k * 400), (0, k * 400 + 200), (40_000, k * 400 + 200),
                    (40_000, k * 400))) for k in range(100)),
    )), statuses=FINE)  # fmt: skip
    yield _case("GDSII, a disc of 1000 corners, 90 copies turned", library(
        cell("A", *(sref("B", angle=k) for k in range(90))),
        cell("B", boundary([(x + 900_000, y) for x, y in ring(1_000_000, 1000)])),
    ), statuses=FINE)  # fmt: skip
    yield _case("GDSII, 40 round path ends, magnified", library(
        cell("A", *(sref("B", (k, k), mag=1e3) for k in range(40))),
        cell("B", path([(0, 0), (10, 0)], 20_000, 1)),
    ), statuses=FINE)  # fmt: skip


def _one(points: Points) -> bytes:
    return library(cell("A", boundary(points)))


def _star(count: int) -> Points:
    """Return a polygon that goes round nearly half-way at every corner."""
    corners, step = ring(4_000_000, count), count // 2 - 1
    return [corners[k * step % count] for k in range(count)]


def _wild(count: int) -> Points:
    corners = ring(4_000_000, count)
    return [corners[int(k * 0.381966 * count) % count] for k in range(count)]


def _comb(count: int) -> Points:
    teeth = count // 4
    rows: list[tuple[int, int]] = []
    for k in range(teeth):
        x = k * 1000
        rows += [(x, 0), (x, 1_000_000), (x + 400, 1_000_000), (x + 400, 0)]
    return [*rows, (teeth * 1000, -10_000), (0, -10_000)]


def _slits(holes: int) -> Points:
    """Return a plate whose holes are reached by slits from below."""
    rows: list[tuple[int, int]] = [(-1000, 0)]
    for k in range(holes):
        x = k * 1000
        rows += [(x, 0), (x, 500), (x - 200, 800), (x + 200, 800), (x, 500), (x, 0)]
    return [*rows, (holes * 1000, 0), (holes * 1000, 2000), (-1000, 2000)]


def _boustrophedon(count: int) -> Points:
    """Return a path that goes to and fro, 150 units apart, 200 wide."""
    return [(((k + 1) // 2 % 2) * 400_000, k // 2 * 150 * 2) for k in range(count)]


def _shifted(points: Points, dx: int, dy: int) -> Points:
    return [(x + dx, y + dy) for x, y in points]


def _large() -> Iterator[Case]:
    size = MEGABYTES << 20
    part = boundary(SQUARE)
    yield _case("GDSII, 16 MiB of labels", lambda: library(
        cell("A", part, *[text("x")] * (size // len(text("x")) - 10))
    ), statuses=FINE)  # fmt: skip
    yield _case("GDSII, 16 MiB of nodes", lambda: library(
        cell("A", part, *[node()] * (size // len(node()) - 10))
    ), statuses=FINE)  # fmt: skip
    yield _case("GDSII, 16 MiB of squares", lambda: library(
        cell("A", *[part] * (size // len(part) - 10))
    ))  # fmt: skip
    yield _case("GDSII, 80000 squares on another layer", lambda: library(
        cell("A", part, *[boundary(SQUARE, 2)] * 80_000)
    ), statuses=FINE)  # fmt: skip
    yield _case("GDSII, 60000 layers", lambda: library(
        cell("A", *(boundary(SQUARE, 2, k) for k in range(60_000)))
    ))  # fmt: skip
    yield _case("GDSII, 16 MiB of empty cells", lambda: library(
        *(cell(f"C{k}") for k in range(size // 46))
    ))  # fmt: skip
    yield _case("GDSII, 16 MiB of one shape's properties", lambda: library(cell(
        "A", element(0x08, short(0x0D, 1), short(0x0E, 0), xy([*SQUARE, SQUARE[0]]),
                     record(0x2C, 6, b"x" * 60_000) * (size // 60_010)),
    )), statuses=FINE)  # fmt: skip
    points = [(k % 4000, k // 2) for k in range(4000)]
    yield _case("GDSII, 16 MiB of large polygons on another layer", lambda: library(
        cell("A", part, *[boundary(points, 2)] * (size // 32_100))
    ), statuses=FINE)  # fmt: skip
    yield _case("GDSII, 16 MiB of zeros after the end",
                lambda: library(cell("A", part)) + bytes(size - 1000),
                statuses=FINE)  # fmt: skip
    yield _case("GDSII, 16 MiB of records of no bytes",
                lambda: library()[:-4] + record(0x11, 0) * (4 << 20))  # fmt: skip
    yield _case("GDSII, records of length 0", library()[:-4] + bytes(4096))
    yield _case("GDSII, an extension of 2^31", library(cell("A", element(
        0x09, short(0x0D, 1), short(0x0E, 0), short(0x21, 4), long(0x0F, 100),
        long(0x30, 2**31 - 1), long(0x31, -(2**31)), xy([(0, 0), (10_000, 0)]),
    ))))  # fmt: skip
