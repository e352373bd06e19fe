"""Nothing of a drawing goes without a word: it is taken, or ignored with a reason."""

from __future__ import annotations

import time
from collections import Counter

import pytest

from microplan.planner.drawings.census import LayerRow
from microplan.planner.drawings.dxf.census import by_layer, held
from microplan.planner.drawings.dxf.drawing import load_drawing
from microplan.planner.drawings.dxf.file import read_dxf
from microplan.planner.drawings.gds.drawing import load_gds
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.task.drawings import AnyDrawing, DrawingSheet, form, rows, take
from tests.planner.drawings import gds_writer as gds
from tests.planner.drawings.dxf.test_corpus import EXACT, HATCH_SLOT
from tests.planner.drawings.dxf_text import (
    Tags,
    box,
    circle,
    dxf,
    entity,
    hatch,
    insert,
    line,
)

FRAME = ((-1000, -1000), (99_000, -1000), (99_000, 99_000), (-1000, 99_000))
AT = Span(file="task.yaml", line=1)


def sheet(drawing: AnyDrawing | None, *layers: str) -> DrawingSheet:
    """Return what some layers of a drawing give."""
    report = Report()
    assert drawing is not None
    taken = take(drawing, layers, report)
    assert taken is not None, report.found
    return DrawingSheet(drawing=drawing, takes=(taken,))


def drawn(text: str) -> AnyDrawing | None:
    """Return a DXF file opened."""
    return load_drawing(text.encode(), "part.dxf", "um", AT, AT, Report())


def table(text: str, *layers: str) -> dict[str, LayerRow]:
    """Return the rows of a DXF file by layer."""
    found, whole = rows(sheet(drawn(text), *layers))
    assert whole
    return {row.layer: row for row in found}


LABEL = entity("TEXT", (10, 0.0), (20, 0.0), (1, "x"))
MANY = dxf(
    box(100, 60), LABEL, circle((9, 9), 2, (60, 1)), circle((9, 9), 2, (67, 1)),
    line((1, 1), (1, 1)), hatch(HATCH_SLOT),
    entity("DIMENSION", layer="DIM"), circle((5, 5), 2, layer="OFF"),
    circle((5, 5), 2, layer="ICE"), circle((5, 5), 1, layer="PAPER"),
    circle((5, 5), 1, (67, 1), layer="PAPER"),
    insert("B", (20, 20), (70, 3), (71, 2), (44, 9.0), (45, 9.0)),
    insert("B", (20, 20), layer="ICE"),
    blocks=[
        ("B", (0, 0), [circle((0, 0), 1, layer="0"), circle((0, 0), 9, layer="C")]),
    ],
    layers=[("OFF", 0, -7), ("ICE", 1, 7)],
)  # fmt: skip


def test_every_entity_is_in_the_table_with_its_reason() -> None:
    found = table(MANY, "a")
    assert {name: (row.taken, row.ignored) for name, row in found.items()} == {
        "A": (
            (("CIRCLE", 6), ("LINE", 4)),
            (
                ("CIRCLE in paper space", 1),
                ("CIRCLE made invisible", 1),
                ("HATCH beside linework", 1),
                ("LINE without length", 1),
                ("TEXT", 1),
            ),
        ),
        "C": ((), (("CIRCLE", 6), ("CIRCLE on a frozen layer", 1))),
        "DIM": ((), (("DIMENSION", 1),)),
        "ICE": ((), (("CIRCLE on a frozen layer", 2),)),
        "OFF": ((), (("CIRCLE on a layer that is off", 1),)),
        "PAPER": ((), (("CIRCLE", 1), ("CIRCLE in paper space", 1))),
    }
    assert [name for name, row in found.items() if row.selected] == ["A"]


@pytest.mark.parametrize("name", EXACT)
def test_what_is_taken_and_ignored_is_all_there_is(name: str) -> None:
    text = EXACT[name][0]
    there, whole = held(read_dxf(text.encode()))
    assert whole
    for row in table(text, "A").values():
        counts = Counter[str]()
        for what, n in (*row.taken, *row.ignored):
            counts[what.partition(" ")[0]] += n
        layer = {k: n for (layer, k), n in there.items() if layer == row.layer}
        assert counts == layer


def nested(depth: int, layer: str) -> list[tuple[str, tuple[float, float], list[Tags]]]:
    """Return blocks that hold 100 x 100 copies each, circles in the last."""
    blocks = [("B0", (0.0, 0.0), [circle((0, 0), 1, layer=layer)])]
    for k in range(depth):
        many = insert(f"B{k}", (0, 0), (70, 100), (71, 100), layer=layer)
        blocks.append((f"B{k + 1}", (0.0, 0.0), [many]))
    return blocks


def test_copies_are_multiplied_and_not_walked() -> None:
    text = dxf(box(9, 9), insert("B20", layer="X"), blocks=nested(20, "X"))
    assert table(text, "A")["X"].ignored == (("CIRCLE", 10**80),)
    text = dxf(box(9, 9), insert("B20", layer="X"), blocks=nested(20, "0"))
    assert table(text, "A")["X"].ignored == (("CIRCLE", 10**80),)


def test_blocks_on_too_many_layers_end_the_count() -> None:
    """A thousand layers of a block with a thousand kinds: 1e6 rows of one kilobyte."""
    inner = [entity(f"K{k}", layer="0") for k in range(1000)]
    layers = [insert("B", layer=f"L{k}") for k in range(1000)]
    drawing = drawn(dxf(box(9, 9), *layers, blocks=[("B", (0, 0), inner)]))
    started = time.perf_counter()
    found, whole = rows(sheet(drawing, "A"))
    assert time.perf_counter() - started < 5  # 0.2 s; all rows take 2 s
    assert not whole
    assert [row.taken for row in found if row.selected] == [(("LINE", 4),)]


def test_layers_are_counted_without_the_paper_space() -> None:
    counts = by_layer(held(read_dxf(MANY.encode()))[0])
    assert counts == {"A": 14, "C": 7, "DIM": 1, "ICE": 2, "OFF": 1, "PAPER": 1}


def test_cells_and_labels_of_a_mask_are_counted() -> None:
    steps = (20_000, 0), (0, 20_000)
    file = gds.library(
        gds.cell("DOT", gds.boundary(gds.SQUARE, layer=2), gds.text("hi", layer=3)),
        gds.cell("ROW", gds.aref("DOT", (0, 0), (3, 2), steps), gds.node(layer=1)),
        gds.cell("TOP", gds.box(FRAME), gds.sref("ROW")),
        gds.cell("ELSE", gds.sref("DOT"), gds.boundary(gds.SQUARE, layer=7)),
    )
    drawing = load_gds(file, "mask.gds", "um", "TOP", AT, AT, AT, Report())
    assert drawing is not None
    assert (
        form(drawing) == "GDSII, cell 'TOP' made of 'DOT', 'ROW'; cells ignored: 'ELSE'"
    )
    found, _ = rows(sheet(drawing, "1/0"))
    assert {row.layer: (row.taken, row.ignored) for row in found} == {
        "1/0": ((("BOX", 1),), (("NODE", 1),)),
        "2/0": ((), (("BOUNDARY", 6),)),
        "3/0": ((), (("TEXT", 6),)),
    }
