"""Drawings in, outlines out: exact areas, and refusals where there is doubt."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import ezdxf
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.optics.outline.outline import Arc, Outline, Segment
from microplan.planner.drawings.dxf.drawing import Drawing, take
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.normalise import plain_outline
from tests.planner.drawings.reading import open_drawing

EXAMPLE = Path(__file__).parents[4] / "examples" / "gear_on_shaft"

Draw = Callable[[Any], None]
ON_A = {"layer": "A"}


def read(
    folder: Path, draw: Draw, units: str = "um", layers: Sequence[str] = ("A",)
) -> tuple[Outline | None, Report]:
    """Return what is read of a fresh drawing, and the findings."""
    document: Any = ezdxf.new()  # type: ignore[attr-defined]  # re-exported by ezdxf
    draw(document)
    document.saveas(folder / "part.dxf")
    report, at = Report(), Span(file="task.yaml", line=1)
    drawing = open_drawing(folder / "part.dxf", "part.dxf", units, at, at, report)
    return taken(drawing, layers, report), report


def taken(
    drawing: Drawing | None, layers: Sequence[str], report: Report
) -> Outline | None:
    """Return what layers of an opened drawing enclose."""
    found = None if drawing is None else take(drawing, layers, report)
    return None if found is None else found.outline


def outline(folder: Path, draw: Draw, units: str = "um") -> Outline:
    """Return the outline of a drawing without findings but the header's units."""
    found, report = read(folder, draw, units)
    assert {finding.code for finding in report.found} <= {"MP210"}
    assert found is not None
    return found


def codes(folder: Path, draw: Draw, layers: Sequence[str] = ("A",)) -> list[str]:
    """Return the codes of the findings, but the header's units."""
    report = read(folder, draw, layers=layers)[1]
    return [finding.code for finding in report.found if finding.code != "MP210"]


def lines(space: Any, points: Sequence[tuple[float, float]], layer: str = "A") -> None:
    """Draw a closed chain of lines."""
    for start, end in zip(points, [*points[1:], points[0]], strict=True):
        space.add_line(start, end, dxfattribs={"layer": layer})


def plate(document: Any) -> None:
    """Draw 100 x 60 with two holes, one with an island that is no island."""
    space = document.modelspace()
    lines(space, [(0, 0), (100, 0), (100, 60), (0, 60)])
    space.add_circle((30, 30), 10, dxfattribs=ON_A)
    space.add_circle((70, 30), 5, dxfattribs=ON_A)


def slot(document: Any) -> None:
    """Draw a slot 40 long between centres, R = 10, as a polyline with bulges."""
    points = [(-20, -10, 0), (20, -10, 1), (20, 10, 0), (-20, 10, 1)]
    polyline = document.modelspace().add_lwpolyline(points, "xyb", dxfattribs=ON_A)
    polyline.close()


def slot_of_pieces(document: Any) -> None:
    """Draw the same slot by lines and arcs, arcs split, one line backwards."""
    space = document.modelspace()
    space.add_line((20, -10), (-20, -10), dxfattribs=ON_A)
    space.add_line((20, 10), (0, 10), dxfattribs=ON_A)
    space.add_line((-20, 10), (0, 10), dxfattribs=ON_A)
    space.add_arc((20, 0), 10, 20, 90, dxfattribs=ON_A)
    space.add_arc((20, 0), 10, 270, 20, dxfattribs=ON_A)
    space.add_arc((-20, 0), 10, 90, 270, dxfattribs=ON_A)


def test_areas_and_holes_are_exact(tmp_path: Path) -> None:
    found = outline(tmp_path, plate)
    assert len(found.rings) == 3
    assert found.area_um2 == pytest.approx(6000 - 125 * math.pi, rel=1e-12)
    assert [ring.signed_area_um2 > 0 for ring in found.rings] == [True, False, False]
    holes = [ring.edges[0] for ring in found.rings[1:]]
    assert [(h.center, h.radius_um) for h in holes if isinstance(h, Arc)] == [
        ((30, 30), 10), ((70, 30), 5),
    ]  # fmt: skip


def test_bulges_become_arcs(tmp_path: Path) -> None:
    found = outline(tmp_path, slot)
    assert found.area_um2 == pytest.approx(800 + 100 * math.pi, rel=1e-12)
    arcs = [edge for edge in found.rings[0].edges if isinstance(edge, Arc)]
    assert [arc.radius_um for arc in arcs] == pytest.approx([10, 10], rel=1e-12)
    assert found.bounds_um == pytest.approx((-30, -10, 30, 10), abs=1e-12)


def test_how_it_was_drawn_means_nothing(tmp_path: Path) -> None:
    def reverse(document: Any) -> None:
        points = [(-20, 10, 0), (20, 10, -1), (20, -10, 0), (-20, -10, -1)]
        polyline = document.modelspace().add_lwpolyline(points, "xyb", dxfattribs=ON_A)
        polyline.close()

    def block(document: Any) -> None:
        inner = document.blocks.new("B", base_point=(5, 5))
        points = [(-15, -5, 0), (25, -5, 1), (25, 15, 0), (-15, 15, 1)]
        inner.add_lwpolyline(points, "xyb").close()
        document.modelspace().add_blockref("B", (0, 0), dxfattribs=ON_A)

    def behind(document: Any) -> None:
        points = [(-20, -10, 0), (20, -10, 1), (20, 10, 0), (-20, 10, 1)]
        attributes = {"layer": "A", "extrusion": (0, 0, -1)}
        space = document.modelspace()
        space.add_lwpolyline(points, "xyb", dxfattribs=attributes).close()

    drawn = plain_outline(outline(tmp_path, slot))
    for other in (slot_of_pieces, reverse, block, behind):
        assert plain_outline(outline(tmp_path, other)) == drawn, other.__name__


def test_units_scale_the_outline(tmp_path: Path) -> None:
    def in_mm(document: Any) -> None:
        space = document.modelspace()
        lines(space, [(0, 0), (0.1, 0), (0.1, 0.06), (0, 0.06)])
        space.add_circle((0.03, 0.03), 0.01, dxfattribs=ON_A)
        space.add_circle((0.07, 0.03), 0.005, dxfattribs=ON_A)

    drawn = plain_outline(outline(tmp_path, plate))
    assert plain_outline(outline(tmp_path, in_mm, "mm")) == drawn


def test_an_insert_turns_scales_and_mirrors(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        block = document.blocks.new("B")
        lines(block, [(0, 0), (40, 0), (0, 10)], "0")  # takes the INSERT's layer
        block.add_line((7, 7), (8, 8), dxfattribs={"layer": "OTHER"})
        attributes = {"layer": "A", "xscale": -2, "yscale": 2, "rotation": 90}
        document.modelspace().add_blockref("B", (100, 50), dxfattribs=attributes)

    found = outline(tmp_path, draw)
    assert found.area_um2 == pytest.approx(4 * 200, rel=1e-12)
    # (40, 0) is mirrored to (-80, 0), turned to (0, -80), shifted to (100, -30)
    assert found.bounds_um == pytest.approx((80, -30, 100, 50), abs=1e-9)


def test_an_insert_grid_makes_holes(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        lines(document.modelspace(), [(0, 0), (100, 0), (100, 60), (0, 60)])
        document.blocks.new("B").add_circle((10, 10), 2)
        attributes = {
            "layer": "A", "column_count": 4, "row_count": 2,
            "column_spacing": 20, "row_spacing": 30,
        }  # fmt: skip
        document.modelspace().add_blockref("B", (0, 0), dxfattribs=attributes)

    found = outline(tmp_path, draw)
    assert len(found.rings) == 9
    assert found.area_um2 == pytest.approx(6000 - 32 * math.pi, rel=1e-12)
    assert found.rings[8].edges[0].start == pytest.approx((72, 40))


def test_small_gaps_are_closed_and_said(tmp_path: Path) -> None:
    def gap(size: float) -> Draw:
        def draw(document: Any) -> None:
            space = document.modelspace()
            space.add_line((0, 0), (100, 0), dxfattribs=ON_A)
            space.add_line((100 + 0.6 * size, 0.8 * size), (100, 60), dxfattribs=ON_A)
            space.add_line((100, 60), (0, 0), dxfattribs=ON_A)

        return draw

    assert codes(tmp_path, gap(0.00005)) == []
    assert codes(tmp_path, gap(0.009)) == ["MP211"]
    assert codes(tmp_path, gap(0.011)) == ["MP205"]
    found, _ = read(tmp_path, gap(0.009))
    assert found is not None
    assert len(found.rings[0].edges) == 4  # the bridge is an edge; nothing is bent


def test_an_open_outline_is_refused_with_its_ends(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        space = document.modelspace()
        space.add_line((0, 0), (100, 0), dxfattribs={"layer": "A", "handle": "AB1"})
        space.add_line((100, 0), (100, 60.5), dxfattribs={"layer": "A"})

    report = read(tmp_path, draw)[1]
    (finding,) = [finding for finding in report.found if finding.code == "MP205"]
    assert "(0, 0) um (#AB1)" in finding.message
    assert "(100, 60.5) um" in finding.message


def test_holes_in_islands_count_by_depth(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        for radius in (40, 30, 20, 10):
            document.modelspace().add_circle((0, 0), radius, dxfattribs=ON_A)

    assert codes(tmp_path, draw) == ["MP209"]  # an island is a body of its own


def uneven(document: Any, space: Any) -> None:
    """Insert a circle as an ellipse."""
    document.blocks.new("B").add_circle((0, 0), 1)
    attributes = {"layer": "A", "xscale": 2, "yscale": 1}
    space.add_blockref("B", (50, 50), dxfattribs=attributes)


def endless(document: Any, space: Any) -> None:
    """Insert a block that inserts itself by way of another."""
    document.blocks.new("I").add_blockref("B", (0, 0))
    document.blocks.new("B").add_blockref("I", (0, 0))
    space.add_blockref("B", (50, 50), dxfattribs=ON_A)


def doubled_ring(_: Any, space: Any) -> None:
    """Draw a hole again, as two arcs."""
    space.add_arc((30, 30), 10, 0, 90, dxfattribs=ON_A)
    space.add_arc((30, 30), 10, 90, 0, dxfattribs=ON_A)


TILTED = {"layer": "A", "extrusion": (0, 1, 1)}

# what is added to the plate, and what it leads to
DOUBTFUL: dict[str, tuple[Callable[[Any, Any], object], str]] = {
    "text": (lambda _, s: s.add_text("B", dxfattribs=ON_A), "MP219"),
    "spline": (
        lambda _, s: s.add_spline([(0, 0), (1, 1), (2, 0)], dxfattribs=ON_A), "MP203"
    ),
    "ellipse": (
        lambda _, s: s.add_ellipse((50, 30), (5, 0), 0.5, dxfattribs=ON_A), "MP225"
    ),
    "crossing": (lambda _, s: s.add_circle((100, 30), 5, dxfattribs=ON_A), "MP208"),
    "bow tie": (lambda _, s: lines(s, [(9, 9), (9, 5), (5, 9), (5, 5)]), "MP208"),
    "tilted": (lambda _, s: s.add_circle((0, 0), 5, dxfattribs=TILTED), "MP214"),
    "slanted": (lambda _, s: s.add_line((1, 1), (2, 2, 2), dxfattribs=ON_A), "MP214"),
    "bulge": (
        lambda _, s: s.add_lwpolyline([(1, 1, 1e300), (2, 2)], "xyb", dxfattribs=ON_A),
        "MP214",
    ),
    "far": (lambda _, s: s.add_circle((0, 0), 1e200, dxfattribs=ON_A), "MP214"),
    "two bodies": (lambda _, s: s.add_circle((200, 0), 5, dxfattribs=ON_A), "MP209"),
    "branch": (lambda _, s: s.add_line((0, 0), (50, 30), dxfattribs=ON_A), "MP212"),
    "doubled line": (
        lambda _, s: s.add_line((100, 0), (0, 0), dxfattribs=ON_A), "MP213"
    ),
    "doubled ring": (doubled_ring, "MP213"),
    "uneven": (uneven, "MP225"),
    "endless": (endless, "MP217"),
    "nowhere": (lambda _, s: s.add_blockref("X", (0, 0), dxfattribs=ON_A), "MP202"),
}  # fmt: skip


def doubtful(name: str) -> Draw:
    """Return the plate with something added."""

    def draw(document: Any) -> None:
        plate(document)
        DOUBTFUL[name][0](document, document.modelspace())

    return draw


@pytest.mark.parametrize("name", DOUBTFUL)
def test_doubtful_drawings_have_their_codes(tmp_path: Path, name: str) -> None:
    assert codes(tmp_path, doubtful(name)) == [DOUBTFUL[name][1]]


def test_what_is_drawn_twice_is_taken_once(tmp_path: Path) -> None:
    for name in ("doubled line", "doubled ring"):
        found, _ = read(tmp_path, doubtful(name))
        assert found is not None
        assert found.area_um2 == pytest.approx(6000 - 125 * math.pi, rel=1e-12)


def test_layers_that_are_not_selected_may_hold_anything(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        plate(document)
        space = document.modelspace()
        space.add_text("title")
        space.add_line((0, 0), (5, 5))
        document.blocks.new("I").add_circle((0, 0), 1)
        document.blocks.new("B").add_blockref("I", (0, 0))
        space.add_blockref("B", (50, 50), dxfattribs={"xscale": 2})

    assert outline(tmp_path, draw).area_um2 == pytest.approx(6000 - 125 * math.pi)


def test_an_empty_selection_lists_what_there_is(tmp_path: Path) -> None:
    report = read(tmp_path, plate, layers=("a", "C"))[1]
    (finding,) = [finding for finding in report.found if finding.code == "MP204"]
    assert "'C'" in finding.message
    assert "'A' 6" in finding.hint


def test_a_tiny_array_that_asks_for_millions_is_refused(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        document.blocks.new("B").add_circle((0, 0), 1)
        attributes = {"layer": "A", "column_count": 30000, "row_count": 30000}
        document.modelspace().add_blockref("B", (0, 0), dxfattribs=attributes)

    assert codes(tmp_path, draw) == ["MP215"]


def test_arcs_cut_short_of_a_circle_are_open(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        document.modelspace().add_arc((0, 0), 10, 0, 359.9, dxfattribs=ON_A)

    assert codes(tmp_path, draw) == ["MP205"]


def test_lines_stay_lines_and_pieces_of_one_line_are_one(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        lines(document.modelspace(), [(0, 0), (30, 0), (70, 0), (100, 0), (50, 40)])

    found = outline(tmp_path, draw)
    assert len(found.rings[0].edges) == 3
    assert all(isinstance(edge, Segment) for edge in found.rings[0].edges)


ODD = ("nan", "inf", "1e300", "-1", "0", "SPLINE", "LINE", "", "x", "999999999", "B")


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_no_spoilt_drawing_breaks_the_reader(data: st.DataObject) -> None:
    lines = (EXAMPLE / "parts" / "shaft_plate.dxf").read_text().splitlines()
    for _ in range(data.draw(st.integers(1, 3))):
        i = data.draw(st.integers(0, len(lines) - 1))
        lines[i : i + 1] = data.draw(st.sampled_from([[odd] for odd in ODD] + [[]]))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "part.dxf"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        report, at = Report(), Span(file="task.yaml", line=1)
        drawing = open_drawing(path, "part.dxf", "um", at, at, report)
        found = taken(drawing, ["PLATE"], report)
    assert (found is None) == report.failed
    assert found is None or math.isfinite(found.area_um2)
