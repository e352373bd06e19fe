"""Every entity and every trap: exact areas, holes and circles, or the right code."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.arrays import Point
from microplan.optics.outline.outline import Arc, Outline
from microplan.planner.drawings.biarcs import CURVE_UM
from microplan.planner.drawings.dxf.drawing import take
from microplan.planner.drawings.nesting import CHORD_UM
from microplan.planner.source.diagnostics import Report, Span
from tests.planner.drawings.dxf_text import (
    Tags,
    arc,
    box,
    circle,
    dxf,
    ellipse,
    entity,
    hatch,
    insert,
    line,
    lwpolyline,
    path,
    polyline,
    quad,
    spline,
    xy,
)
from tests.planner.drawings.reading import open_drawing

PI = math.pi
BEHIND = (230, -1.0)
SLOT = [(-20, -10, 0), (20, -10, 1), (20, 10, 0), (-20, 10, 1)]
SLOT_AREA = 800 + 100 * PI
QUARTER = math.sqrt(0.5)  # weight of a quarter circle's middle control point


def read(
    text: str | bytes, folder: Path, layers: Sequence[str] = ("A",), units: str = "um"
) -> tuple[tuple[Outline, float] | None, Report]:
    """Return what is read of a file, and the findings."""
    file = folder / "part.dxf"
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    report, at = Report(), Span(file="task.yaml", line=1)
    drawing = open_drawing(file, "part.dxf", units, at, at, report)
    found = None if drawing is None else take(drawing, layers, report)
    return None if found is None else (found.outline, found.chord_um), report


def codes(report: Report) -> list[str]:
    """Return the codes that were found, each once."""
    return sorted({finding.code for finding in report.found})


def octagon(*, bent: bool) -> list[tuple[float, float, float, int]]:
    """Return a circle of radius 10 as a fitted curve: every other vertex was added."""
    corners = [(math.cos(k * PI / 4), math.sin(k * PI / 4)) for k in range(8)]
    bulge = math.tan(PI / 16) if bent else 0.0
    return [(10 * x, 10 * y, bulge, k % 2) for k, (x, y) in enumerate(corners)]


FRAMED = [
    (0, 0, 0, 8),
    (500, 500, 0, 16),
    (100, 0, 0, 8),
    (100, 60, 0, 8),
    (0, 60, 0, 8),
]
RECTANGLE = [(0, 0, 0.0, 32), (100, 0, 0.0, 32), (100, 60, 0.0, 32), (0, 60, 0.0, 32)]
HATCH_SLOT: Tags = [(92, 3), (72, 1), (73, 1), (93, 4)] + [
    tag for x, y, bulge in SLOT for tag in (*xy(10, (x, y)), (42, bulge))
]
# a half disc of radius 10: a line, and an arc that runs clockwise from 180 to 0 deg;
# its angles are counted clockwise too
HATCH_HALF: Tags = [
    (92, 1), (93, 2), (72, 1), *xy(10, (10, 0)), *xy(11, (-10, 0)),
    (72, 2), *xy(10, (0, 0)), (40, 10.0), (50, 180.0), (51, 360.0), (73, 0),
]  # fmt: skip
HATCH_ELLIPSE: Tags = [
    (92, 1), (93, 1), (72, 3), *xy(10, (0, 0)), *xy(11, (50, 0)), (40, 0.4),
    (50, 0.0), (51, 360.0), (73, 1),
]  # fmt: skip
HATCH_PART: Tags = [
    (92, 1), (93, 2), (72, 3), *xy(10, (0, 0)), *xy(11, (20, 0)), (40, 0.5), (50, 0.0),
    (51, 180.0), (73, 1), (72, 1), *xy(10, (-20, 0)), *xy(11, (20, 0)),
]  # fmt: skip
HATCH_SPLINE: Tags = [
    (92, 1), (93, 2), (72, 4), (94, 2), (73, 0), (74, 0), (95, 6), (96, 3),
    *((40, k) for k in (0, 0, 0, 1, 1, 1)),
    *xy(10, (0, 0)), *xy(10, (50, 100)), *xy(10, (100, 0)),
    (97, 0), (72, 1), *xy(10, (100, 0)), *xy(11, (0, 0)),
]  # fmt: skip

# name -> what is drawn, area in um2, holes, diameters of the rings that are circles
EXACT: dict[str, tuple[str, float, int, list[float]]] = {
    "lines": (dxf(path([(0, 0), (30, 0), (0, 40)])), 600, 0, []),
    "arc": (dxf(arc((0, 0), 10, 0, 180), line((-10, 0), (10, 0))), 50 * PI, 0, []),
    "arc over 0 deg": (
        dxf(arc((0, 0), 10, 270, 90), line((0, -10), (0, 10))), 50 * PI, 0, []
    ),
    "circle": (dxf(circle((5, 5), 7)), 49 * PI, 0, [14]),
    "holes": (
        dxf(box(100, 60), circle((30, 30), 10), circle((70, 30), 5)),
        6000 - 125 * PI, 2, [20, 10],
    ),
    "ellipse": (dxf(ellipse((3, 4), (40, 30), 0.4)), 1000 * PI, 0, []),
    "ellipse 5 to 1": (dxf(ellipse((0, 0), (5, 0), 0.2)), 5 * PI, 0, []),
    "ellipse that is round": (dxf(ellipse((0, 0), (3, 4), 1.0)), 25 * PI, 0, [10]),
    "half ellipse": (
        dxf(ellipse((0, 0), (50, 0), 0.4, 0, PI), line((-50, 0), (50, 0))),
        500 * PI, 0, [],
    ),
    "lwpolyline": (dxf(lwpolyline(SLOT)), SLOT_AREA, 0, []),
    "polyline": (dxf(polyline([(*row, 0) for row in SLOT])), SLOT_AREA, 0, []),
    "fitted polyline": (dxf(polyline(octagon(bent=True), flags=3)), 100 * PI, 0, [20]),
    "framed polyline": (dxf(polyline(FRAMED, flags=5)), 6000, 0, []),
    "polyline in space": (dxf(polyline(RECTANGLE, flags=9)), 6000, 0, []),
    "parabola": (
        dxf(spline(2, [0, 0, 0, 1, 1, 1], [(0, 0), (50, 100), (100, 0)]),
            line((0, 0), (100, 0))),
        10000 / 3, 0, [],
    ),
    "rational spline": (
        dxf(spline(2, [0, 0, 0, 1, 1, 1], [(50, 0), (50, 50), (0, 50)],
                   [1, QUARTER, 1], flags=12),
            path([(0, 50), (0, 0), (50, 0)], closed=False)),
        625 * PI, 0, [],
    ),
    "periodic spline": (  # a diamond and four parabolas: 5/6 of its square
        dxf(spline(2, list(range(9)), [(0, 0), (60, 0), (60, 60), (0, 60), (0, 0),
                                       (60, 0)], flags=11)),
        3000, 0, [],
    ),
    "straight spline": (
        dxf(spline(1, [0, 0, 1, 2, 2], [(0, 0), (30, 0), (0, 40)]),
            line((0, 40), (0, 0))),
        600, 0, [],
    ),
    "solid": (dxf(quad("SOLID", [(0, 0), (100, 0), (0, 60), (100, 60)])), 6000, 0, []),
    "trace": (dxf(quad("TRACE", [(0, 0), (30, 0), (0, 40), (0, 40)])), 600, 0, []),
    "wide line": (
        dxf(lwpolyline([(0, 0), (100, 0)], (43, 10.0), flags=0)), 1000, 0, []
    ),
    "wide corner": (
        dxf(lwpolyline([(0, 0), (100, 0), (100, 50)], (43, 10.0), flags=0)), 1500, 0, []
    ),
    "wide slot": (dxf(lwpolyline(SLOT, (43, 4.0))), 4 * (80 + 20 * PI), 1, []),
    "wide box": (
        dxf(lwpolyline([(0, 0), (100, 0), (100, 60), (0, 60)], (43, 10.0))), 3200, 1, []
    ),
    "arrow": (
        dxf(polyline([(0, 0, 0, 0), (100, 0, 0, 0)], (40, 10.0), (41, 0.0), flags=0)),
        500, 0, [],
    ),
    "donut": (
        dxf(lwpolyline([(-10, 0, 1), (10, 0, 1)], (43, 4.0))), 80 * PI, 1, [24, 16]
    ),
    "dot": (dxf(lwpolyline([(-5, 0, 1), (5, 0, 1)], (43, 10.0))), 100 * PI, 0, [20]),
    "hatch": (dxf(hatch(HATCH_SLOT)), SLOT_AREA, 0, []),
    "hatch, clockwise": (dxf(hatch(HATCH_HALF)), 50 * PI, 0, []),
    "hatch, ellipse": (dxf(hatch(HATCH_ELLIPSE)), 1000 * PI, 0, []),
    "hatch, spline": (dxf(hatch(HATCH_SPLINE)), 10000 / 3, 0, []),
    "hatch beside lines": (dxf(hatch(HATCH_SLOT), box(50, 50)), 2500, 0, []),
    "half ellipse hatched beside lines": (
        dxf(hatch(HATCH_PART), box(50, 50)), 2500, 0, []
    ),
    "grid of blocks": (
        dxf(
            box(100, 60),
            insert("B", (0, 0), (70, 4), (71, 2), (44, 20.0), (45, 30.0)),
            blocks=[("B", (0, 0), [circle((10, 10), 2, layer="0")])],
        ),
        6000 - 32 * PI, 8, [4] * 8,
    ),
    "uneven block": (
        dxf(insert("B", (0, 0), (41, 5.0), (42, 2.0)),
            blocks=[("B", (0, 0), [circle((1, 1), 10)])]),
        1000 * PI, 0, [],
    ),
    "uneven and back": (  # stays a circle
        dxf(insert("O", (0, 0), (41, 1.0), (42, 3.0)),
            blocks=[("I", (0, 0), [circle((1, 1), 10)]),
                    ("O", (0, 0), [insert("I", (7, 8), (41, 3.0), (42, 1.0))])]),
        900 * PI, 0, [60],
    ),
    "shared side": (  # partly drawn twice: 0 to 60 and 40 to 100
        dxf(line((0, 0), (60, 0)), line((100, 0), (40, 0)),
            path([(100, 0), (100, 60), (0, 60), (0, 0)], closed=False)),
        6000, 0, [],
    ),
    "shared arc": (
        dxf(arc((0, 0), 10, 0, 200), arc((0, 0), 10, 160, 360)), 100 * PI, 0, [20]
    ),
    "circle over its arc": (
        dxf(circle((0, 0), 10), arc((0, 0), 10, 30, 50)), 100 * PI, 0, [20]
    ),
    "side of a closed polyline": (
        dxf(lwpolyline([(0, 0), (100, 0), (100, 60), (0, 60)]), line((20, 0), (70, 0))),
        6000, 0, [],
    ),
}  # fmt: skip
SAID = {  # findings that are no errors
    "ellipse": ["MP225"], "ellipse 5 to 1": ["MP225"], "half ellipse": ["MP225"],
    "parabola": ["MP225"], "rational spline": ["MP225"], "periodic spline": ["MP225"],
    "wide line": ["MP224"], "wide corner": ["MP224"], "wide slot": ["MP224"],
    "wide box": ["MP224"], "arrow": ["MP224"], "donut": ["MP224"], "dot": ["MP224"],
    "hatch, ellipse": ["MP225"], "hatch, spline": ["MP225"],
    "hatch beside lines": ["MP219"], "half ellipse hatched beside lines": ["MP219"],
    "uneven block": ["MP225"],
    "shared side": ["MP213"], "shared arc": ["MP213"],
    "circle over its arc": ["MP213"], "side of a closed polyline": ["MP213"],
}  # fmt: skip


@pytest.mark.parametrize("name", EXACT)
def test_areas_holes_and_circles(name: str, tmp_path: Path) -> None:
    text, area_um2, holes, diameters_um = EXACT[name]
    found, report = read(text, tmp_path)
    assert found is not None, report.found
    outline, chord_um = found
    assert outline.area_um2 == pytest.approx(area_um2, rel=1e-6)
    assert len(outline.rings) == 1 + holes
    round_um = [
        2 * ring.edges[0].radius_um
        for ring in outline.rings
        if isinstance(ring.edges[0], Arc) and ring.edges[0].is_circle
    ]
    assert sorted(round_um) == pytest.approx(sorted(diameters_um), rel=1e-6)
    assert codes(report) == SAID.get(name, [])
    assert chord_um == (CURVE_UM if "MP225" in codes(report) else 0.0)


MESH = [(0, 0, 0.0, 64), (9, 0, 0.0, 64), (9, 9, 0.0, 64), (0, 9, 0.0, 64)]
ROUND = [(400 * math.cos(k / 7), 400 * math.sin(k / 7)) for k in range(44)]
SHORT = spline(2, [0, 0, 0, 1, 1, 1], [(0, 0), (50, 100), (100, 0)])

# name -> what is drawn, and the code that it leads to
REFUSED: dict[str, tuple[str, str]] = {
    "open": (dxf(path([(0, 0), (9, 0), (9, 9)], closed=False)), "MP205"),
    "gap of 11 nm": (dxf(arc((0, 0), 10, 0, 359.937)), "MP205"),
    "junction": (dxf(box(100, 60), line((0, 0), (50, 30))), "MP212"),
    "T on a side": (dxf(box(100, 60), line((50, 0), (50, 30))), "MP205"),
    "crossing": (dxf(box(100, 60), circle((100, 30), 5)), "MP208"),
    "bow tie": (dxf(path([(0, 0), (9, 9), (9, 0), (0, 9)])), "MP208"),
    "there and back": (dxf(lwpolyline([(0, 0), (9, 0), (9, 0), (0, 0)])), "MP208"),
    "two bodies": (dxf(circle((0, 0), 5), circle((20, 0), 5)), "MP209"),
    "island": (dxf(*(circle((0, 0), r) for r in (30, 20, 10))), "MP209"),
    "polyline that climbs": (
        dxf([(0, "LINE"), (8, "A"), *xy(10, (0, 0)), *xy(11, (9, 0)), (31, 5.0)]),
        "MP214",
    ),
    "tilted": (dxf(circle((0, 0), 5, (220, 1.0), (230, 1.0))), "MP214"),
    "no radius": (dxf(circle((0, 0), 0)), "MP214"),
    "nan": (dxf(circle((math.nan, 0), 5)), "MP214"),
    "too large": (dxf(circle((0, 0), 1e308)), "MP214"),
    "no number": (dxf(entity("CIRCLE", (10, "one"), (20, 0), (40, 5))), "MP214"),
    "no center": (dxf(entity("CIRCLE", (40, 5))), "MP214"),
    "face": (dxf(quad("3DFACE", [(0, 0), (9, 0), (9, 9), (0, 9)])), "MP203"),
    "mesh": (dxf(polyline(MESH, (71, 2), (72, 2), flags=16)), "MP203"),
    "fit points": (dxf(entity("SPLINE", (71, 3), *xy(11, (0, 0)))), "MP203"),
    "width that changes": (
        dxf(polyline([(0, 0, 0, 0), (9, 0, 0, 0), (9, 9, 0, 0)], (40, 1.0), (41, 2.0),
                     flags=0)), "MP203",
    ),
    "stroke too tight": (dxf(lwpolyline(SLOT, (43, 30.0))), "MP203"),
    "vertices missing": (dxf(lwpolyline(SLOT)).replace(" 90\n4", " 90\n5"), "MP202"),
    "knots missing": (dxf(SHORT).replace(" 72\n6", " 72\n7"), "MP202"),
    "knots that do not fit": (
        dxf(spline(3, [0, 0, 0, 1, 1, 1], [(0, 0), (50, 100), (100, 0)])), "MP214"
    ),
    "weight of 0": (
        dxf(spline(2, [0, 0, 0, 1, 1, 1], [(0, 0), (5, 9), (9, 0)], [1, 0, 1])), "MP214"
    ),
    "spline that jumps": (
        dxf(spline(1, [0, 0, 1, 2, 2, 3, 4, 4],
                   [(0, 0), (90, 0), (90, 50), (95, 50), (95, 90), (0, 90)]),
            line((0, 90), (0, 0))), "MP205",
    ),
    "half ellipse hatched alone": (dxf(hatch(HATCH_PART)), "MP203"),
    "hatch cut short": (dxf(hatch(HATCH_SLOT[:-3])), "MP202"),
    "vertex alone": (dxf(entity("VERTEX", *xy(10, (0, 0)))), "MP202"),
    "polyline without end": (dxf(entity("POLYLINE"), circle((0, 0), 5)), "MP202"),
    "block nowhere": (dxf(insert("B")), "MP202"),
    "block twice": (
        dxf(insert("B"), blocks=[("B", (0, 0), [circle((0, 0), r)]) for r in (5, 6)]),
        "MP202",
    ),
    "block in itself": (
        dxf(insert("B"), blocks=[("B", (0, 0), [insert("b", (1, 1))])]), "MP217"
    ),
    "blocks too deep": (
        dxf(insert("B99"), blocks=[
            ("B0", (0, 0), [circle((0, 0), 5)]),
            *((f"B{k + 1}", (0, 0), [insert(f"B{k}")]) for k in range(99)),
        ]), "MP217",
    ),
    "1e9 circles": (
        dxf(insert("B3"), blocks=[
            ("B0", (0, 0), [circle((0, 0), 5)]),
            *((f"B{k + 1}", (0, 0), [insert(f"B{k}", (0, 0), (70, 32), (71, 32))])
              for k in range(3)),
        ]), "MP215",
    ),
    "block without width": (
        dxf(insert("B", (0, 0), (41, 0.0)),
            blocks=[("B", (0, 0), [circle((0, 0), 5)])]), "MP214",
    ),
    "text alone": (dxf(entity("TEXT", *xy(10, (0, 0)), (1, "B"))), "MP204"),
    "layer off": (dxf(circle((0, 0), 5), layers=[("a", 0, -7)]), "MP204"),
    "layer frozen": (dxf(circle((0, 0), 5), layers=[("a", 1, 7)]), "MP204"),
    "invisible": (dxf(circle((0, 0), 5, (60, 1))), "MP204"),
    "frozen with its block": (
        dxf(insert("B", layer="F"), blocks=[("B", (0, 0), [circle((0, 0), 5)])],
            layers=[("F", 1, 7)]), "MP204",
    ),
    "paper": (dxf(circle((0, 0), 5, (67, 1))), "MP220"),
    "nothing": (dxf(circle((0, 0), 5, layer="B")), "MP204"),
    "in mm": (dxf(circle((0, 0), 0.05)), "MP216"),
    "html": ("<!DOCTYPE html>\n<html></html>\n", "MP201"),
    "empty": ("", "MP201"),
    "no entities": ("  0\nSECTION\n  2\nHEADER\n  0\nENDSEC\n  0\nEOF\n", "MP201"),
    "section in a section": (
        "  0\nSECTION\n  2\nENTITIES\n  0\nSECTION\n  2\nBLOCKS\n  0\nEOF\n", "MP201"
    ),
    "coarse": (dxf(path([(round(x), round(y)) for x, y in ROUND])), "MP218"),
    "units of the header": (dxf(circle((0, 0), 5), units=4), "MP210"),
    "gap of 9 nm": (dxf(arc((0, 0), 10, 0, 359.948)), "MP211"),
}  # fmt: skip
WARNED = {"MP210", "MP211", "MP218"}


@pytest.mark.parametrize("name", REFUSED)
def test_traps_lead_to_their_codes(name: str, tmp_path: Path) -> None:
    text, code = REFUSED[name]
    found, report = read(text, tmp_path)
    assert code in codes(report)
    assert (found is None) == report.failed == (code not in WARNED)
    assert set(codes(report)) <= {code, "MP219", "MP224", "MP225"}


@pytest.mark.parametrize(
    "raw",
    [b"\x89PNG\r\n\x1a\n" + bytes(64), b"AC1032" + bytes(64), bytes(64)],
    ids=["PNG", "DWG", "zeros"],
)
def test_other_files_are_refused(raw: bytes, tmp_path: Path) -> None:
    assert codes(read(raw, tmp_path)[1]) == ["MP201"]


def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.dxf")
    report, at = Report(), Span(file="task.yaml", line=1)
    assert open_drawing(tmp_path / "pipe.dxf", "pipe", "um", at, at, report) is None
    assert codes(report) == ["MP001"]


def test_a_file_cut_short_anywhere_is_refused(tmp_path: Path) -> None:
    whole = dxf(lwpolyline(SLOT), circle((0, 0), 2))
    for length in range(0, len(whole.rstrip()), 3):
        found, report = read(whole[:length], tmp_path)
        assert found is None
        assert codes(report) == ["MP201"]


ODD = ("nan", "1e308", "-1", "0", "", "A", "B", "LINE", "INSERT", "SEQEND", "99999999")


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_no_spoilt_drawing_of_any_kind_breaks_the_reader(data: st.DataObject) -> None:
    cases = [*(text for text, *_ in EXACT.values()), *(t for t, _ in REFUSED.values())]
    lines = data.draw(st.sampled_from(cases)).split("\n")
    for _ in range(data.draw(st.integers(1, 4))):
        i = data.draw(st.integers(0, max(len(lines) - 1, 0)))
        other = data.draw(st.sampled_from(cases)).split("\n")
        j = 2 * data.draw(st.integers(0, len(other) // 2))
        swap = [[odd] for odd in ODD] + [[], other[j : j + 2], other[j : j + 20]]
        lines[i : i + 1] = data.draw(st.sampled_from(swap))
    with TemporaryDirectory() as folder:
        found, report = read("\n".join(lines), Path(folder))
    assert (found is None) == report.failed
    assert found is None or math.isfinite(found[0].area_um2)


def test_places_and_entities_are_named(tmp_path: Path) -> None:
    spoke = line((100, 60), (50, 30), (5, "AB1"))
    message = read(dxf(box(100, 60), spoke), tmp_path)[1].found[0].message
    assert "(100, 60) um (line" in message
    assert "#AB1)" in message
    text = dxf(box(100, 60), circle((100, 30), 5, (5, "AB2")))
    message = read(text, tmp_path)[1].found[0].message
    assert "#AB2" in message
    place = re.search(r"near \(([\d.]+), ([\d.]+)\) um", message)
    assert place is not None
    # polygons are judged by, and lie within CHORD_UM of the circle
    assert float(place[1]) == pytest.approx(100, abs=CHORD_UM)
    assert abs(float(place[2]) - 30) == pytest.approx(5, abs=2 * CHORD_UM)


def test_what_is_left_out_is_counted(tmp_path: Path) -> None:
    text = dxf(
        circle((0, 0), 5),
        *(entity("TEXT", *xy(10, (k, 0)), (1, "B")) for k in range(3)),
        entity("DIMENSION"),
        circle((0, 0), 2, (60, 1)),
        circle((0, 0), 3, (67, 1)),
        insert("B", layer="F"),
        entity("TEXT", (1, "elsewhere"), layer="Z"),
        blocks=[("B", (0, 0), [circle((0, 0), 1)])],
        layers=[("F", 1, 7)],
    )
    (finding,) = read(text, tmp_path)[1].found
    assert finding.code == "MP219"
    assert finding.severity == "note"
    assert finding.message == (
        "part.dxf: left out: 1 CIRCLE in paper space, 1 CIRCLE made invisible, "
        "1 DIMENSION, 1 INSERT on a frozen layer, 3 TEXT"
    )


def test_a_layer_that_is_off_hides_its_own_lines_alone(tmp_path: Path) -> None:
    """An INSERT on a layer that is off still shows what names other layers."""
    text = dxf(
        insert("B", layer="OFF"),
        blocks=[("B", (0, 0), [circle((0, 0), 5), circle((0, 0), 2, layer="0")])],
        layers=[("OFF", 0, -1)],
    )
    found, report = read(text, tmp_path, ["A", "OFF"])
    assert found is not None
    assert found[0].area_um2 == pytest.approx(25 * PI, rel=1e-12)
    assert "1 CIRCLE on a layer that is off" in report.found[0].message


def test_bombs_on_other_layers_do_no_harm(tmp_path: Path) -> None:
    bomb = insert("B", (0, 0), (70, 30000), (71, 30000), layer="Z")
    text = dxf(
        circle((0, 0), 5), bomb, blocks=[("B", (0, 0), [circle((0, 0), 1, layer="0")])]
    )
    found, report = read(text, tmp_path)
    assert found is not None
    assert report.found == []


def test_layers_may_be_named_in_the_files_own_code_page(tmp_path: Path) -> None:
    for name in ("Au\u00dfen".encode("cp1252"), b"Au\\U+00DFen"):
        text = dxf(circle((0, 0), 5)).encode().replace(b"\nA\n", b"\n" + name + b"\n")
        found, _ = read(text, tmp_path, ["AUSSEN".replace("SS", "\u00df")])
        assert found is not None


def test_seen_from_behind_x_runs_the_other_way(tmp_path: Path) -> None:
    found, _ = read(dxf(circle((30, 5), 2, BEHIND)), tmp_path)
    assert found is not None
    assert found[0].bounds_um == pytest.approx((-32, 3, -28, 7))
    sides = line((0, -20), (0, 0)), line((0, 0), (50, 0))
    quarter = ellipse((0, 0), (50, 0), 0.4, 0, PI / 2, BEHIND)
    found, _ = read(dxf(quarter, *sides), tmp_path)  # its center is no own coordinate
    assert found is not None
    assert found[0].bounds_um == pytest.approx((0, -20, 50, 0), abs=1e-4)
    assert found[0].area_um2 == pytest.approx(250 * PI, rel=1e-6)


def matrix(
    at: Point, degrees: float, scale: Point, base: Point, *, behind: bool
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return the 3 x 3 matrix of an INSERT, from its definition."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    to_base = np.array([[1, 0, -base[0]], [0, 1, -base[1]], [0, 0, 1.0]])
    scaled = np.diag([scale[0], scale[1], 1.0])
    turned = np.array([[c, -s, at[0]], [s, c, at[1]], [0, 0, 1.0]])
    own = np.diag([-1.0 if behind else 1.0, 1.0, 1.0])
    product: np.ndarray[tuple[int, ...], np.dtype[np.float64]]
    product = own @ turned @ scaled @ to_base
    return product


@pytest.mark.parametrize("seed", range(12))
def test_nested_blocks_follow_the_product_of_their_matrices(
    seed: int, tmp_path: Path
) -> None:
    rng = np.random.default_rng(seed)
    corners = np.array([[0, 0], [8, 0], [8, 3], [2, 3], [0, 6.0]])
    inner = [
        lwpolyline([(x, y) for x, y in corners.tolist()]),
        circle((3, 1.5), 1.0, layer="0"),
    ]
    whole = np.eye(3)
    bases = rng.uniform(-5, 5, (3, 2)).tolist()
    blocks: list[tuple[str, Point, list[Tags]]] = [("B0", tuple(bases[0]), inner)]
    for depth in range(3):
        at = tuple(rng.uniform(-50, 50, 2).tolist())
        scale = tuple((rng.uniform(0.5, 2, 2) * rng.choice([-1, 1], 2)).tolist())
        degrees, behind = float(rng.uniform(0, 360)), bool(rng.integers(2))
        tags: Tags = [(41, scale[0]), (42, scale[1]), (50, degrees)]
        tags += [(210, 0.0), (220, 0.0), (230, -1.0 if behind else 1.0)]
        step = matrix(at, degrees, scale, tuple(bases[depth]), behind=behind)
        whole = step @ whole
        held = insert(f"B{depth}", at, *tags, layer="0" if depth < 2 else "A")
        if depth < 2:
            blocks.append((f"B{depth + 1}", tuple(bases[depth + 1]), [held]))
    found, report = read(dxf(held, blocks=blocks), tmp_path)
    assert found is not None, report.found
    outline = found[0]
    area_um2 = abs(np.linalg.det(whole[:2, :2])) * (27 - PI)
    assert outline.area_um2 == pytest.approx(area_um2, rel=1e-6)
    ends = np.array([edge.start for edge in outline.rings[0].edges])
    wanted = (whole @ np.column_stack([corners, np.ones(5)]).T)[:2].T
    apart = np.linalg.norm(ends[:, None] - wanted[None], axis=2)
    assert apart.min(axis=0).max() < 1e-9  # rounding of coordinates below 1e3
    assert apart.min(axis=1).max() < 1e-9
    # every point of the hole lies on the circle before the blocks moved it
    back = np.linalg.inv(whole)
    hole = np.array([edge.start for edge in outline.rings[1].edges])
    local = (back @ np.column_stack([hole, np.ones(len(hole))]).T)[:2].T
    stretch = np.linalg.norm(back[:2, :2], 2)
    off = np.abs(np.linalg.norm(local - [3, 1.5], axis=1) - 1)
    assert off.max() < CURVE_UM * stretch
