"""Hostile DXF files: cut short, bombs, odd numbers, and much that is hard to judge."""

from __future__ import annotations

import math
from collections.abc import Iterator

from benchmarks.example import TASK
from benchmarks.hostile_task import FINE, Case, drawing
from tests.planner.inputs.dxf_text import (
    Tags,
    binary,
    box,
    circle,
    dxf,
    ellipse,
    entity,
    hatch,
    insert,
    line,
    lwpolyline,
    polyline,
    spline,
    xy,
)

GEAR = TASK.parent / "parts" / "gear18.dxf"
CUTS = 9  # places at which a file is cut short
MEGABYTES = 16  # what may be read of one file
LINE_BYTES = 66  # of one LINE as `dxf` writes it, about


def cases() -> Iterator[Case]:
    """Yield all hostile DXF files."""
    yield from _cut_short()
    yield from _bombs()
    yield from _numbers()
    yield from _tangles()
    yield from _curves()
    yield from _large()


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


def _bombs() -> Iterator[Case]:
    for depth, each in ((9, 10), (18, 10), (60, 1000), (60, 32_767)):
        yield drawing(
            f"{each}^{depth} copies by nested INSERTs", _nested(depth, each, each)
        )
    yield drawing("MINSERT of 32767 x 32767", dxf(
        insert("B", (0, 0), (70, 32767), (71, 32767), (44, 1), (45, 1)),
        blocks=[("B", (0, 0), [circle((0, 0), 1, layer="0")])],
    ))  # fmt: skip
    yield drawing("MINSERT of 1e308 x 1e308", dxf(
        insert("B", (0, 0), (70, "1e308"), (71, "1e308")),
        blocks=[("B", (0, 0), [circle((0, 0), 1, layer="0")])],
    ))  # fmt: skip
    yield drawing("a block that holds itself", dxf(
        insert("B"), blocks=[("B", (0, 0), [insert("B", layer="0")])],
    ))  # fmt: skip
    ring = [(f"B{k}", (0, 0), [insert(f"B{(k + 1) % 60}")]) for k in range(60)]
    yield drawing("60 blocks that hold each other", dxf(insert("B0"), blocks=ring))
    for depth in (63, 65, 20_000):
        chain = [(f"B{k}", (0, 0), [insert(f"B{k + 1}")]) for k in range(depth - 1)]
        chain.append((f"B{depth - 1}", (0, 0), [circle((0, 0), 10)]))
        file = dxf(insert("B0"), blocks=chain)
        yield drawing(f"a chain of {depth} blocks", file, statuses=FINE)
    doubled: list[tuple[str, tuple[float, float], list[Tags]]] = [
        (f"B{k}", (0.0, 0.0), [insert(f"B{k + 1}"), insert(f"B{k + 1}")])
        for k in range(60)
    ]
    for name, inner in (
        ("text", [entity("TEXT", *xy(10, (0, 0)))]),
        ("nothing", []),
        ("another layer", [circle((0, 0), 1, layer="B")]),
    ):
        blocks = [*doubled, ("B60", (0.0, 0.0), inner)]
        yield drawing(f"2^60 copies of {name}", dxf(insert("B0"), blocks=blocks))
    attributes = [entity("ATTRIB", *xy(10, (0, 0)))] * 3
    parts = [tag for one in attributes for tag in one]
    inner = [[*insert("C", (0, 0), (66, 1)), *parts, *entity("SEQEND")]]
    yield drawing("1e9 attributes", dxf(
        insert("B", (0, 0), (70, 32767), (71, 32767)),
        blocks=[("B", (0, 0), inner), ("C", (0, 0), [])],
    ))  # fmt: skip


def _nested(depth: int, columns: int, rows: int) -> str:
    """Return blocks in blocks, in columns at even and in rows at odd depths."""
    blocks: list[tuple[str, tuple[float, float], list[Tags]]] = []
    for k in range(depth):
        many = (70, columns) if k % 2 else (71, rows)
        blocks.append((f"B{k}", (0, 0), [insert(f"B{k + 1}", (0, 0), many)]))
    blocks.append((f"B{depth}", (0, 0), [circle((0, 0), 1, layer="0")]))
    return dxf(insert("B0"), blocks=blocks)


def _numbers() -> Iterator[Case]:
    said = ("nan", "NaN", "inf", "-Infinity", "1e308", "-1e308", "1e400", "1e-320",
            "1_0", "0x10", "", " ", "9" * 5000, "\u0661", "1,5", "--1")  # fmt: skip
    for value in said:
        short = value if len(value) < 20 else f"{len(value)} nines"
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
        yield drawing(f"a count of {short!r}", dxf(
            entity("LWPOLYLINE", (90, value), (70, 1), *xy(10, (0, 0)),
                   *xy(10, (10, 0)), *xy(10, (10, 10))),
        ), statuses=FINE)  # fmt: skip
        yield drawing(f"an array of {short!r}", dxf(
            insert("B", (0, 0), (70, value)),
            blocks=[("B", (0, 0), [circle((0, 0), 10)])],
        ), statuses=FINE)  # fmt: skip
        yield drawing(f"a group code of {short!r}",
                      dxf(box(100, 60)).replace(" 10\n", f"{value}\n", 1),
                      statuses=FINE)  # fmt: skip
        yield drawing(
            f"units of {short!r}",
            dxf(circle((0, 0), 50)).replace("13\n", f"{value}\n"),
            statuses=FINE,
        )  # fmt: skip
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


def _tangles() -> Iterator[Case]:
    """Yield what is drawn on one layer in sensible numbers, and makes no part."""
    n = 20_000
    chords = [
        line(_on(k / n, 500), _on(k * 0.381966 % 1 + 0.25, 500)) for k in range(n // 2)
    ]
    yield drawing("10000 crossing lines", lambda: dxf(*chords))
    yield drawing("20000 lines through one point", lambda: dxf(
        *(line(_on(k / n, 100), _on(k / n + 0.5, 100)) for k in range(n))
    ))  # fmt: skip
    yield drawing("20000 lines from one point", lambda: dxf(
        *(line((0, 0), _on(k / n, 100)) for k in range(n))
    ))  # fmt: skip
    yield drawing("100 x 100 crossing lines, all ends loose", lambda: dxf(
        *(line((k, -1), (k, 100)) for k in range(100)),
        *(line((-1, k), (100, k)) for k in range(100)),
    ))  # fmt: skip
    yield drawing("20000 lines along each other", lambda: dxf(
        *(line((0, 0), (k + 1, 0)) for k in range(n))
    ))  # fmt: skip
    for count in (700, 2000):
        yield drawing(f"{count} lines along each other", _along(count))
    yield drawing("20000 arcs along each other", lambda: dxf(*(
        entity("ARC", *xy(10, (0, 0)), (40, 50), (50, 0), (51, 1 + k * 0.01))
        for k in range(n)
    )))  # fmt: skip
    yield drawing("20000 circles that overlap", lambda: dxf(
        *(circle((k * 0.01, 0), 500) for k in range(n))
    ))  # fmt: skip
    yield drawing("1000 circles that overlap", lambda: dxf(
        *(circle((k * 0.5, 0), 500) for k in range(1000))
    ))  # fmt: skip
    yield drawing("20000 equal circles", lambda: dxf(
        *(circle((0, 0), 500) for k in range(n))
    ), statuses=FINE)  # fmt: skip
    for count in (1000, 5000, 20_000):
        yield drawing(f"{count} rings in each other", _rings(count))
    yield drawing("20000 circles side by side", lambda: dxf(
        *(circle((k % 150 * 3, k // 150 * 3), 1) for k in range(n))
    ))  # fmt: skip
    yield drawing("a plate with 19000 holes", lambda: dxf(
        box(450, 450, (-2, -2)),
        *(circle((k % 140 * 3, k // 140 * 3), 1) for k in range(19_000)),
    ), statuses=FINE)  # fmt: skip
    for count in (5000, 19_999):
        yield drawing(f"a star of {count} corners, crossing itself", _star(count))
        yield drawing(f"a spiral ring of {count} corners", _spiral(count),
                      statuses=FINE)  # fmt: skip
        yield drawing(f"a comb of {count} corners", _comb(count), statuses=FINE)
        round_ = dxf(lwpolyline([(*_on(k / count, 500), 0) for k in range(count)]))
        yield drawing(f"a round ring of {count} corners", round_, statuses=FINE)
        yield drawing(f"a gear of {count} corners", _toothed(count), statuses=FINE)
        yield drawing(f"a star of {count} corners of lines", _loose_star(count))
    yield drawing("two combs of 5000 corners that overlap", lambda: dxf(
        lwpolyline(_comb_rows(5000)),
        lwpolyline([(y, x, 0) for x, y, _ in _comb_rows(5000)]),
    ))  # fmt: skip
    yield drawing("10000 gaps of 5 nm", lambda: dxf(*(
        line(_on(k / 10_000, 500), _on((k + 1) / 10_000 - 2e-6, 500))
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
    corners = [_on(k * step % count / count, 500) for k in range(count)]
    return dxf(lwpolyline([(*corner, 0) for corner in corners]))


def _loose_star(count: int) -> str:
    """Return the same as lines."""
    step = count // 2 - (0 if count % 2 else 1)
    corners = [_on(k * step % count / count, 500) for k in range(count)]
    ends = [*corners[1:], corners[0]]
    return dxf(*(line(a, b) for a, b in zip(corners, ends, strict=True)))


def _spiral(count: int) -> str:
    """Return a band wound up, which crosses nothing."""
    half = count // 2
    out = [(*_on(k / 100, 100 + k * 0.02), 0.0) for k in range(half)]
    back = [(*_on(k / 100, 101 + k * 0.02), 0.0) for k in reversed(range(half))]
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
        lwpolyline([(*_on(k / count, radii[k % 4]), 0) for k in range(count // 4 * 4)])
    )


def _curves() -> Iterator[Case]:
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
    for ratio in (0.01, 1e-6, 1e-12):
        yield drawing(f"2000 ellipses of 1 : {ratio:g}", _ellipses(2000, ratio))
    yield drawing("an ellipse of 1 : 1e-5", _ellipses(1, 1e-5), statuses=FINE)
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
    yield drawing("a stroke of 10000 corners", lambda: dxf(polyline(
        [(*_on(k / 10_000, 500), 0, 0) for k in range(10_000)], (40, 1), (41, 1)
    )), statuses=FINE)  # fmt: skip
    yield drawing("a stroke of 6000 crossing corners", lambda: dxf(polyline(
        [(*_on(k * 0.381966, 500), 0, 0) for k in range(6000)], (40, 1), (41, 1)
    )))  # fmt: skip
    yield drawing("circles scaled to ellipses, 500", lambda: dxf(
        *(insert("B", (k, 0), (41, 1 + k * 1e-3)) for k in range(500)),
        blocks=[("B", (0, 0), [circle((0, 0), 400)])],
    ))  # fmt: skip


def _wild(count: int, degree: int) -> str:
    """Return a closed spline whose control points jump about."""
    points = [_on(k * 0.381966, 500) for k in range(count)]
    points.append(points[0])
    inner = count + 1 - degree
    knots = (
        [0.0] * degree + [float(k) for k in range(inner + 1)] + [float(inner)] * degree
    )
    return dxf(spline(degree, knots, points))


def _round(count: int) -> str:
    """Return a closed spline near a circle."""
    points = [_on(k / count, 500) for k in range(count)]
    points.append(points[0])
    inner = count + 1 - 3
    knots = [0.0] * 3 + [float(k) for k in range(inner + 1)] + [float(inner)] * 3
    return dxf(spline(3, knots, points))


def _ellipses(count: int, ratio: float) -> str:
    return dxf(*(ellipse((k * 0.1, k * 0.1), (400, k), ratio) for k in range(count)))


def _edges(count: int, turns: int = 1) -> Tags:
    """Return a hatch's boundary of lines round a circle."""
    corners = [_on(k * turns / count, 500) for k in range(count)]
    tags: Tags = [(92, 1), (93, count)]
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        tags += [(72, 1), *xy(10, a), *xy(11, b)]
    return tags


def _large() -> Iterator[Case]:
    """Yield files near and beyond the limit of 16 MiB."""
    size = MEGABYTES << 20
    part = dxf(circle((0, 0), 50))
    yield drawing("16 MiB of comments", lambda: _padded(part, "999\nx\n", size),
                  statuses=FINE)  # fmt: skip
    yield drawing("16 MiB of one comment", lambda: (
        "999\n" + "x" * (size - len(part) - 10) + "\n" + part
    ), statuses=FINE)  # fmt: skip
    yield drawing("16 MiB of blank lines", lambda: "\n" * size)
    yield drawing("16 MiB of zeros", lambda: bytes(size))
    yield drawing("16 MiB of nines", lambda: b"9" * size)
    yield drawing("more than 16 MiB", lambda: bytes(size + 1))
    other = "".join(f"{c:>3}\n{v}\n" for c, v in line((0, 0), (1, 1), layer="B"))
    yield drawing("16 MiB of lines on another layer",
                  lambda: _inside(part, other, size), statuses=FINE)  # fmt: skip
    short = "0\nLINE\n"
    yield drawing("16 MiB of empty entities", lambda: _inside(part, short, size),
                  statuses=FINE)  # fmt: skip
    own = "".join(f"{c:>3}\n{v}\n" for c, v in line((0, 0), (1, 1)))
    yield drawing("16 MiB of lines", lambda: _inside(part, own, size))
    yield drawing("16 MiB of empty lines on the layer",
                  lambda: _inside(part, "0\nLINE\n8\nA\n", size))  # fmt: skip
    odd = "0\nODD\n8\nA\n"
    yield drawing("16 MiB of unknown entities", lambda: _inside(part, odd, size))
    yield drawing("15000 unknown entities", lambda: _inside(part, odd, 170_000))
    yield drawing("15000 kinds of unknown entities", lambda: dxf(
        *(entity(f"ODD{k}") for k in range(15_000))
    ))  # fmt: skip
    yield drawing("16 MiB of layers", lambda: part.replace(
        "  0\nENDTAB", "".join(f"0\nLAYER\n2\nL{k}\n" for k in range(800_000))
        + "  0\nENDTAB"
    ), statuses=FINE)  # fmt: skip
    yield drawing("16 MiB of blocks", lambda: part.replace(
        "  2\nBLOCKS\n",
        "  2\nBLOCKS\n"
        + "".join(f"0\nBLOCK\n2\nB{k}\n0\nENDBLK\n" for k in range(500_000)),
    ), statuses=FINE)  # fmt: skip
    yield drawing("300000 layers in use", lambda: dxf(
        circle((0, 0), 50), *(entity("LINE", layer=f"L{k}") for k in range(300_000))
    ), layer="Z")  # fmt: skip
    yield drawing("400000 INSERTs of nothing", lambda: dxf(
        circle((0, 0), 50), *(insert("B") for k in range(300_000)),
        blocks=[("B", (0, 0), [])],
    ), statuses=FINE)  # fmt: skip
    yield drawing("a layer name of 15 MiB", lambda: dxf(
        circle((0, 0), 50, layer="L" * (15 << 20))
    ))  # fmt: skip
    yield drawing("a layer name of terminal codes", lambda: dxf(
        circle((0, 0), 50, layer="\x1b[2J\x1b]0;title\x07")
    ))  # fmt: skip
    yield drawing("a handle of 15 MiB", lambda: dxf(
        entity("ODD", (5, "A" * (15 << 20)))
    ))  # fmt: skip
    yield drawing("one binary text of 15 MiB", lambda: binary(
        dxf(circle((0, 0), 50), entity("TEXT", (1, "x" * (15 << 20)), layer="B")),
        short=False,
    ), statuses=FINE)  # fmt: skip
    yield drawing("16 MiB of binary tags", lambda: binary(
        dxf(circle((0, 0), 50)), short=False
    )[:-11] + b"\x00\x00E\x00" * (4 << 20))  # fmt: skip


def _padded(part: str, pad: str, size: int) -> str:
    return pad * ((size - len(part)) // len(pad)) + part


def _inside(part: str, pad: str, size: int) -> str:
    """Return a file with more entities before the first one."""
    start = part.index("  2\nENTITIES\n") + len("  2\nENTITIES\n")
    return part[:start] + pad * ((size - len(part)) // len(pad)) + part[start:]


def _on(turns: float, radius: float) -> tuple[float, float]:
    """Return a point of a circle about the origin, to 1e-6."""
    angle = math.tau * turns
    x, y = radius * math.cos(angle), radius * math.sin(angle)
    return round(x, 6) + 0.0, round(y, 6) + 0.0
