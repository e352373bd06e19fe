"""DXF files of much: copies of copies, and megabytes of everything."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.robustness.hostile_task import FINE, Case, drawing
from tests.planner.drawings.dxf_text import (
    Tags,
    binary,
    circle,
    dxf,
    entity,
    insert,
    line,
    xy,
)

MEGABYTES = 16  # what may be read of one file
SIZE = MEGABYTES << 20
PART = dxf(circle((0, 0), 50))
Blocks = list[tuple[str, tuple[float, float], list[Tags]]]


def bombs() -> Iterator[Case]:
    """Yield short files that stand for very many copies."""
    yield from _arrays()
    yield from _chains()
    yield from _doubled()
    yield _attributes()


def _arrays() -> Iterator[Case]:
    """Yield columns and rows of a block."""
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


def _chains() -> Iterator[Case]:
    """Yield blocks that hold each other."""
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


def _doubled() -> Iterator[Case]:
    """Yield blocks that hold the next one twice."""
    doubled: Blocks = [
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


def _attributes() -> Case:
    """Return an array of a block with attributes."""
    attributes = [entity("ATTRIB", *xy(10, (0, 0)))] * 3
    parts = [tag for one in attributes for tag in one]
    inner = [[*insert("C", (0, 0), (66, 1)), *parts, *entity("SEQEND")]]
    return drawing("1e9 attributes", dxf(
        insert("B", (0, 0), (70, 32767), (71, 32767)),
        blocks=[("B", (0, 0), inner), ("C", (0, 0), [])],
    ))  # fmt: skip


def _nested(depth: int, columns: int, rows: int) -> str:
    """Return blocks in blocks, in columns at even and in rows at odd depths."""
    blocks: Blocks = []
    for k in range(depth):
        many = (70, columns) if k % 2 else (71, rows)
        blocks.append((f"B{k}", (0, 0), [insert(f"B{k + 1}", (0, 0), many)]))
    blocks.append((f"B{depth}", (0, 0), [circle((0, 0), 1, layer="0")]))
    return dxf(insert("B0"), blocks=blocks)


def large() -> Iterator[Case]:
    """Yield files near and beyond the limit of 16 MiB."""
    yield from _padding()
    yield from _entities()
    yield from _tables()
    yield from _texts()


def _padding() -> Iterator[Case]:
    """Yield megabytes that say nothing."""
    yield drawing("16 MiB of comments", lambda: _padded(PART, "999\nx\n", SIZE),
                  statuses=FINE)  # fmt: skip
    yield drawing("16 MiB of one comment", lambda: (
        "999\n" + "x" * (SIZE - len(PART) - 10) + "\n" + PART
    ), statuses=FINE)  # fmt: skip
    yield drawing("16 MiB of blank lines", lambda: "\n" * SIZE)
    yield drawing("16 MiB of zeros", lambda: bytes(SIZE))
    yield drawing("16 MiB of nines", lambda: b"9" * SIZE)
    yield drawing("more than 16 MiB", lambda: bytes(SIZE + 1))


def _entities() -> Iterator[Case]:
    """Yield megabytes of entities."""
    other = "".join(f"{c:>3}\n{v}\n" for c, v in line((0, 0), (1, 1), layer="B"))
    yield drawing("16 MiB of lines on another layer",
                  lambda: _inside(PART, other, SIZE), statuses=FINE)  # fmt: skip
    short = "0\nLINE\n"
    yield drawing("16 MiB of empty entities", lambda: _inside(PART, short, SIZE),
                  statuses=FINE)  # fmt: skip
    own = "".join(f"{c:>3}\n{v}\n" for c, v in line((0, 0), (1, 1)))
    yield drawing("16 MiB of lines", lambda: _inside(PART, own, SIZE))
    yield drawing("16 MiB of empty lines on the layer",
                  lambda: _inside(PART, "0\nLINE\n8\nA\n", SIZE))  # fmt: skip
    odd = "0\nODD\n8\nA\n"
    yield drawing("16 MiB of unknown entities", lambda: _inside(PART, odd, SIZE))
    yield drawing("15000 unknown entities", lambda: _inside(PART, odd, 170_000))
    yield drawing("15000 kinds of unknown entities", lambda: dxf(
        *(entity(f"ODD{k}") for k in range(15_000))
    ))  # fmt: skip


def _tables() -> Iterator[Case]:
    """Yield very many layers and blocks."""
    yield drawing("16 MiB of layers", lambda: PART.replace(
        "  0\nENDTAB", "".join(f"0\nLAYER\n2\nL{k}\n" for k in range(800_000))
        + "  0\nENDTAB"
    ), statuses=FINE)  # fmt: skip
    yield drawing("16 MiB of blocks", lambda: PART.replace(
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


def _texts() -> Iterator[Case]:
    """Yield names and texts of megabytes, or of terminal codes."""
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
