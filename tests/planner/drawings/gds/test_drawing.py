"""GDSII files in, outlines out: areas in closed form, refusals where there is doubt."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from pathlib import Path

import gdstk
import numpy as np
import pytest

from microplan.optics.outline.outline import Arc, Outline
from microplan.planner.drawings.dxf.drawing import MAX_BYTES
from microplan.planner.drawings.gds.cells import expand, reached
from microplan.planner.drawings.gds.drawing import take_gds
from microplan.planner.drawings.gds.library import read_library
from microplan.planner.drawings.gds.regions import unite
from microplan.planner.drawings.nesting import nest
from microplan.planner.source.diagnostics import Report, Span
from tests.planner.drawings.gds_writer import (
    SQUARE,
    Points,
    aref,
    boundary,
    box,
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
    transform,
    xy,
)
from tests.planner.drawings.reading import open_gds

AT, LAYERS_AT, CELL_AT = (Span(file="task.yaml", line=k) for k in (1, 2, 3))
SMALL: Points = ((0, 0), (4000, 0), (4000, 3000), (0, 1000))  # 8 um2, no symmetry


def read(
    folder: Path, data: bytes, layers: Sequence[str] = ("1/0",), *,
    top: str | None = None, units: str = "um",
) -> tuple[Outline | None, float, Report]:  # fmt: skip
    """Return what is read of a file, its chord error, and the findings."""
    file, report = folder / "mask.gds", Report()
    file.write_bytes(data)
    drawing = open_gds(file, "mask.gds", units, top, AT, LAYERS_AT, CELL_AT, report)
    found = take_gds(drawing, layers, report) if drawing else None
    assert (found is None) == report.failed
    if found is None:
        return None, 0.0, report
    return found.outline, found.chord_um, report


def outline(
    folder: Path, *elements: bytes, layers: Sequence[str] = ("1/0",)
) -> Outline:
    """Return the outline of one cell, which is read without a finding."""
    found, _, report = read(folder, library(cell("TOP", *elements)), layers)
    assert found is not None, report.found
    assert [f for f in report.found if f.severity != "note"] == []
    return found


def refusal(
    folder: Path, data: bytes, layers: Sequence[str] = ("1/0",), **how: str
) -> tuple[str, str]:
    """Return code and message of the only finding."""
    _, _, report = read(folder, data, layers, **how)
    (finding,) = report.found
    assert finding.severity == "error"
    return finding.code, finding.message


def refused(folder: Path, *elements: bytes) -> str:
    """Return why one cell is not read, which names a byte of the file."""
    code, message = refusal(folder, library(cell("TOP", *elements)))
    assert "(byte " in message
    return code


def test_a_boundary_and_a_box_enclose_their_area(tmp_path: Path) -> None:
    assert outline(tmp_path, boundary(SMALL)).area_um2 == pytest.approx(8, rel=1e-12)
    assert outline(tmp_path, box(SQUARE)).bounds_um == pytest.approx((0, 0, 10, 10))


def test_units_come_from_the_file(tmp_path: Path) -> None:
    one = cell("TOP", boundary(SQUARE))
    coarse, _, report = read(tmp_path, library(one, units=(1.0, 1e-9)), units="nm")
    assert not report.found
    assert coarse is not None
    assert coarse.area_um2 == pytest.approx(100, rel=1e-12)
    fine, _, _ = read(tmp_path, library(one, units=(1e-4, 1e-10)))
    assert fine is not None
    assert fine.area_um2 == pytest.approx(1, rel=1e-12)


def test_units_that_contradict_the_task_are_refused(tmp_path: Path) -> None:
    data = library(cell("TOP", boundary(SMALL)))
    assert refusal(tmp_path, data, units="mm")[0] == "MP210"
    found, _, report = read(
        tmp_path, library(cell("TOP", boundary(SMALL)), units=(1e-4, 1e-9))
    )
    assert [(f.code, f.severity) for f in report.found] == [("MP210", "warning")]
    assert found is not None
    assert found.area_um2 == pytest.approx(8, rel=1e-12)


@pytest.mark.parametrize(
    ("path_type", "ends", "length"),
    [(0, None, 30_000), (2, None, 32_000), (4, (500, -300), 30_200)],
)
def test_a_path_covers_its_width_times_its_length(
    tmp_path: Path, path_type: int, ends: tuple[int, int] | None, length: int
) -> None:
    bent = [(0, 0), (10_000, 0), (10_000, 0), (10_000, 10_000), (16_000, 18_000)]
    found = outline(tmp_path, path(bent, 2000, path_type, ends=ends))
    # a mitred bend adds outside what two rectangles share inside
    assert found.area_um2 == pytest.approx(2 * length / 1000, rel=1e-6)


def test_round_ends_are_half_discs_within_the_chord_error(tmp_path: Path) -> None:
    data = library(cell("TOP", path([(0, 0), (10_000, 0)], 4000, 1)))
    found, chord_um, _ = read(tmp_path, data)
    assert found is not None
    assert 0 < chord_um <= 1e-4  # a tenth of a database unit
    missing = 40 + math.pi * 4 - found.area_um2
    # between chord and arc lie 2/3 of chord times sagitta
    assert 0 < missing <= 2 * math.pi * 2 * chord_um


def test_an_absolute_width_is_not_magnified(tmp_path: Path) -> None:
    line = [(0, 0), (10_000, 0)]
    for width, covered in ((2000, 120.0), (-2000, 60.0)):
        inner = cell("IN", path(line, width))
        top = cell("TOP", sref("IN", mag=3.0, angle=90.0))
        found, _, _ = read(tmp_path, library(inner, top))
        assert found is not None
        # magnified: 30 by 6, else 30 by 2
        assert found.area_um2 == pytest.approx(covered * (1.5 if width > 0 else 1))


def test_nested_placements_are_the_product_of_their_matrices(tmp_path: Path) -> None:
    inner = cell("IN", boundary(SMALL))
    middle = cell("MID", sref("IN", (7000, -2000), mag=0.5, angle=30, mirrored=True))
    top = cell("TOP", sref("MID", (-1000, 4000), mag=3, angle=-75.5))
    found, _, _ = read(tmp_path, library(inner, middle, top))
    assert found is not None
    flip = np.diag([1.0, -1.0])
    corners = np.array(SMALL) / 1000
    corners = 0.5 * corners @ flip.T @ _turn(30).T + (7, -2)
    corners = 3 * corners @ _turn(-75.5).T + (-1, 4)
    starts = np.array([edge.start for edge in found.rings[0].edges])
    order = [np.hypot(*(starts - c).T).argmin() for c in corners]
    assert sorted(order) == [0, 1, 2, 3]
    # corners are taken to 2**-14 of a database unit
    np.testing.assert_allclose(starts[order], corners, rtol=0, atol=1e-7)


def _turn(angle_deg: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    angle = math.radians(angle_deg)
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def test_quarter_turns_are_exact(tmp_path: Path) -> None:
    for angle, bounds in (
        (90, (-3, 0, 0, 4)),
        (180, (-4, -3, 0, 0)),
        (270, (0, -4, 3, 0)),
        (-90, (0, -4, 3, 0)),
    ):
        data = library(
            cell("IN", boundary(SMALL)), cell("TOP", sref("IN", angle=angle))
        )
        found, _, _ = read(tmp_path, data)
        assert found is not None
        assert found.bounds_um == pytest.approx(bounds, rel=0, abs=0)


def test_arrays_fill_columns_and_rows(tmp_path: Path) -> None:
    unit = cell("U", boundary(SQUARE))
    plate = cell("TOP", aref("U", (0, 0), (5, 3), ((10_000, 0), (0, 10_000))))
    found, _, _ = read(tmp_path, library(unit, plate))
    assert found is not None
    assert len(found.rings) == 1
    assert found.bounds_um == pytest.approx((0, 0, 50, 30), rel=0, abs=0)
    skew = cell(
        "TOP", aref("U", (0, 0), (5, 3), ((9_000, 3000), (0, 10_000)), angle=90)
    )
    found, _, _ = read(tmp_path, library(unit, skew))
    assert found is not None
    assert found.bounds_um == (-10, 0, 36, 42)


def test_shapes_are_united_and_leave_holes(tmp_path: Path) -> None:
    frame = [
        boundary([(0, 0), (30_000, 0), (30_000, 5000), (0, 5000)]),
        boundary([(0, 25_000), (30_000, 25_000), (30_000, 30_000), (0, 30_000)]),
        boundary([(0, 0), (5000, 0), (5000, 30_000), (0, 30_000)]),
        box([(25_000, 5000), (30_000, 5000), (30_000, 25_000), (25_000, 25_000)]),
    ]
    found = outline(tmp_path, *frame)
    assert len(found.rings) == 2
    assert [len(r.edges) for r in found.rings] == [4, 4]
    assert found.area_um2 == pytest.approx(900 - 400, rel=1e-12)


def test_a_keyhole_is_a_ring_with_a_hole(tmp_path: Path) -> None:
    keyhole = [
        (0, 0), (30_000, 0), (30_000, 30_000), (0, 30_000), (0, 15_000),
        (10_000, 15_000), (10_000, 20_000), (20_000, 20_000), (20_000, 10_000),
        (10_000, 10_000), (10_000, 15_000), (0, 15_000),
    ]  # fmt: skip
    found = outline(tmp_path, boundary(keyhole))
    assert [len(r.edges) for r in found.rings] == [4, 4]
    assert found.area_um2 == pytest.approx(900 - 100, rel=1e-12)
    aslant = library(cell("IN", boundary(keyhole)), cell("TOP", sref("IN", angle=33.3)))
    turned, _, _ = read(tmp_path, aslant)
    assert turned is not None
    assert [len(r.edges) for r in turned.rings] == [4, 4]
    assert turned.area_um2 == pytest.approx(900 - 100, rel=1e-6)


def test_two_holes_by_one_slit_are_two(tmp_path: Path) -> None:
    """The slit to the second hole begins amid an edge of the first."""
    points = [
        (0, 0), (60_000, 0), (60_000, 30_000), (0, 30_000), (0, 15_000),
        (10_000, 15_000), (10_000, 20_000), (20_000, 20_000), (20_000, 17_000),
        (30_000, 17_000),
        (30_000, 20_000), (40_000, 20_000), (40_000, 10_000), (30_000, 10_000),
        (30_000, 17_000), (20_000, 17_000), (20_000, 10_000), (10_000, 10_000),
        (10_000, 15_000), (0, 15_000),
    ]  # fmt: skip
    found = outline(tmp_path, boundary(points))
    assert len(found.rings) == 3
    assert found.area_um2 == pytest.approx(1800 - 200, rel=1e-12)


def test_a_boundary_that_crosses_or_covers_itself_is_refused(tmp_path: Path) -> None:
    bow = [(0, 0), (10_000, 10_000), (10_000, 0), (0, 12_000)]
    assert refused(tmp_path, boundary(bow)) == "MP208"
    # goes round the square twice: filled or not, as programs please
    twice = [*SQUARE, (0, 0), *[(2 * x, 2 * y) for x, y in SQUARE]]
    assert refused(tmp_path, boundary(twice)) == "MP208"


def test_polygons_that_sample_a_circle_are_circles(tmp_path: Path) -> None:
    data = library(cell("TOP", boundary(ring(10_000, 64, at=(500, -300)))))
    found, chord_um, report = read(tmp_path, data)
    assert found is not None
    (edge,) = found.rings[0].edges
    assert isinstance(edge, Arc)
    # 64 corners off by at most half a unit along x and y: a mean below a tenth
    assert edge.center == pytest.approx((0.5, -0.3), abs=2e-4)
    assert edge.radius_um == pytest.approx(10, abs=2e-4)
    assert chord_um == pytest.approx(10 * (1 - math.cos(math.pi / 64)), abs=1e-3)
    (note,) = report.found
    assert (note.code, note.severity) == ("MP235", "note")
    assert "64 corners" in note.message


def test_corners_that_may_be_meant_stay_corners(tmp_path: Path) -> None:
    eight = outline(tmp_path, boundary(ring(10_000, 8)))
    assert len(eight.rings[0].edges) == 8
    gap = ring(10_000, 64)[3:]  # a flat of four chords
    assert len(outline(tmp_path, boundary(gap)).rings[0].edges) == 61
    oval = [(x, round(0.99 * y)) for x, y in ring(10_000, 64)]
    assert len(outline(tmp_path, boundary(oval)).rings[0].edges) == 64


def test_a_layer_within_another_is_a_hole(tmp_path: Path) -> None:
    plate = [boundary(SQUARE), boundary(ring(2000, 64, at=(5000, 5000)), 2, 7)]
    found = outline(tmp_path, *plate, layers=("1/0", "2/7"))
    assert [r.layer for r in found.rings] == ["1/0", "2/7"]
    assert found.area_um2 == pytest.approx(100 - 4 * math.pi, rel=1e-4)


def test_which_cell_must_be_clear(tmp_path: Path) -> None:
    two = library(cell("A", boundary(SQUARE)), cell("B", boundary(SMALL)))
    code, message = refusal(tmp_path, two)
    assert code == "MP231"
    assert "'A', 'B'" in message
    assert refusal(tmp_path, two, top="C")[0] == "MP231"
    found, _, _ = read(tmp_path, two, top="B")
    assert found is not None
    assert found.area_um2 == pytest.approx(8)
    assert refusal(tmp_path, library())[0] == "MP231"


def test_klayouts_notes_are_no_cell(tmp_path: Path) -> None:
    notes = cell("$$$CONTEXT_INFO$$$", sref("TOP"), boundary(ring(50_000, 8)))
    found, _, report = read(tmp_path, library(notes, cell("TOP", boundary(SQUARE))))
    assert not report.found
    assert found is not None
    assert found.area_um2 == pytest.approx(100)


def test_labels_and_nodes_are_passed_over_and_counted(tmp_path: Path) -> None:
    inner = cell("IN", boundary(SQUARE), text("left"), text("right"), node())
    found, _, report = read(tmp_path, library(inner, cell("TOP", sref("IN"))))
    assert found is not None
    (note,) = report.found
    assert note.code == "MP236"
    assert note.message.endswith("passed over: 1 NODE, 2 TEXT")


def test_an_empty_layer_is_refused_with_what_there_is(tmp_path: Path) -> None:
    inner = cell("IN", boundary(SQUARE, 3, 1), text("only words", 5))
    top = cell("TOP", aref("IN", (0, 0), (4, 2), ((9000, 0), (0, 9000))))
    _, _, report = read(tmp_path, library(inner, top), ("5/0",))
    assert [f.code for f in report.found] == ["MP236", "MP204"]
    assert report.found[1].hint == "shapes by layer: '3/1' 8"
    assert refusal(tmp_path, library(cell("TOP")), ("metal",))[0] == "MP107"


def test_several_bodies_are_refused(tmp_path: Path) -> None:
    away = [(x + 20_000, y) for x, y in SQUARE]
    data = library(cell("TOP", boundary(SQUARE), boundary(away)))
    assert refusal(tmp_path, data)[0] == "MP209"
    across = library(
        cell("TOP", boundary(SQUARE), boundary([(5000, 5000), *away[1:]], 2))
    )
    assert refusal(tmp_path, across, ("1/0", "2/0"))[0] == "MP208"


def test_an_absurd_size_is_refused(tmp_path: Path) -> None:
    tiny = [(x // 100_00, y // 100_00) for x, y in SQUARE]
    assert refusal(tmp_path, library(cell("TOP", boundary(tiny))))[0] == "MP216"
    large = cell("TOP", sref("IN", mag=1e4))
    assert refusal(tmp_path, library(cell("IN", boundary(SQUARE)), large))[0] == "MP216"
    gone = cell("TOP", sref("IN", mag=1e-6), sref("IN", mag=1e-6))
    inner = cell("IN", sref("LOW", mag=1e-5))
    low = cell("LOW", boundary(SQUARE))
    assert refusal(tmp_path, library(low, inner, gone))[0] == "MP233"


@pytest.mark.parametrize(
    ("shape", "code"),
    [
        (path([(0, 0), (9000, 0)], 0), "MP233"),
        (path([(0, 0), (0, 0)], 100), "MP233"),
        (path([(0, 0), (9000, 0)], 100, 3), "MP233"),
        (path([(0, 0), (9000, 0), (1000, 100)], 100), "MP233"),
        (path([(0, 0), (9000, 0)], 100, 4, ends=(-9000, 0)), "MP233"),
        (boundary([(0, 0), (9000, 0), (4000, 0)]), "MP233"),
        (boundary([(0, 0), (9000, 0)]), "MP233"),
        (boundary([(0, 0), (9000, 0), (9000, 9000), (9000, 0)]), "MP233"),
        (boundary([(0, 0), (9000, 9000), (9000, 0), (0, 9000)]), "MP208"),
        (element(0x08, short(0x0D, 1), short(0x0E, 0), xy(SQUARE)), "MP233"),
        (element(0x08, short(0x0D, 1), xy(SQUARE)), "MP230"),
        (
            element(0x08, short(0x0D, 1), short(0x0E, 0), xy(SQUARE), xy(SQUARE)),
            "MP230",
        ),
        (
            element(0x08, short(0x0D, 1), short(0x0E, 0), long(0x0F, 1), xy(SQUARE)),
            "MP230",
        ),
        (short(0x0D, 1), "MP230"),
    ],
)
def test_what_has_no_exact_reading_is_refused(
    tmp_path: Path, shape: bytes, code: str
) -> None:
    assert refused(tmp_path, shape) == code


def test_odd_shapes_on_other_layers_do_not_matter(tmp_path: Path) -> None:
    odd = path([(0, 0), (9000, 0)], 0, layer=2)
    assert outline(tmp_path, boundary(SQUARE), odd).area_um2 == pytest.approx(100)


def test_cells_that_make_no_drawing_are_refused(tmp_path: Path) -> None:
    inner = cell("IN", boundary(SQUARE))

    def code(*cells: bytes) -> str:
        return refusal(tmp_path, library(*cells), top="TOP")[0]

    assert code(cell("TOP", sref("IN"))) == "MP232"  # not there
    assert code(inner, inner, cell("TOP", sref("IN"))) == "MP232"  # there twice
    assert code(cell("TOP", sref("TOP"))) == "MP232"
    assert (
        code(cell("TOP", sref("A")), cell("A", sref("B")), cell("B", sref("A")))
        == "MP232"
    )
    deep = [cell(f"D{k}", sref(f"D{k + 1}")) for k in range(5000)]
    assert code(cell("TOP", sref("D0")), *deep, cell("D5000")) == "MP232"
    assert refusal(tmp_path, library(cell("TOP", sref("TOP"))))[0] == "MP231"


def test_placements_with_two_readings_are_refused(tmp_path: Path) -> None:
    inner = cell("IN", boundary(SQUARE))
    name = record(0x12, 6, b"IN")
    for how in (
        transform(mag=1.0, angle=0.0, mirrored=False, bits=4),
        transform(mag=1.0, angle=0.0, mirrored=False, bits=2),
        transform(mag=-2.0, angle=0.0, mirrored=False),
        transform(mag=0.0, angle=0.0, mirrored=False),
        transform(mag=1e70, angle=0.0, mirrored=False),
        transform(mag=1.0, angle=1e70, mirrored=False),
    ):
        top = cell("TOP", element(0x0A, name, how, xy([(0, 0)])))
        assert refusal(tmp_path, library(inner, top))[0] == "MP233"


def test_far_copies_are_refused(tmp_path: Path) -> None:
    cells = [cell("A0", boundary(SQUARE))]
    cells += [cell(f"A{k + 1}", sref(f"A{k}", (1 << 30, 0), mag=1e6)) for k in range(9)]
    assert refusal(tmp_path, library(*cells))[0] == "MP233"


def test_bombs_are_counted_before_they_go_off(tmp_path: Path) -> None:
    cells = [cell("A0", boundary(SQUARE), boundary(SQUARE, 2))]
    full = (32767, 32767)
    cells += [
        cell(f"A{k + 1}", aref(f"A{k}", (0, 0), full, ((1, 0), (0, 1))))
        for k in range(20)
    ]
    plain = boundary(SQUARE, 3)
    data = library(*cells, cell("TOP", sref("A20"), plain))
    code, message = refusal(tmp_path, data)
    assert code == "MP215"
    assert str(32767**40) in message
    found, _, _ = read(tmp_path, data, ("3/0",))  # what is not selected stays folded
    assert found is not None
    assert found.area_um2 == pytest.approx(100)


def test_shapes_that_cross_too_often_are_refused(tmp_path: Path) -> None:
    bars = cell("BAR", boundary([(0, 0), (30_000, 0), (30_000, 1), (0, 1)]))
    across = aref("BAR", (0, 0), (1, 4000), ((0, 0), (0, 3)))
    up = aref("BAR", (0, 0), (1, 4000), ((0, 0), (3, 0)), angle=90)
    code, _ = refusal(tmp_path, library(bars, cell("TOP", across, up)))
    assert code == "MP215"
    tangle = [(k * 7919 % 30011, k * 104729 % 30013) for k in range(8000)]
    assert refused(tmp_path, boundary(tangle)) == "MP215"


def test_more_holes_than_any_part_has_are_refused(tmp_path: Path) -> None:
    bars = cell("BAR", boundary([(0, 0), (30_000, 0), (30_000, 1), (0, 1)]))
    across = aref("BAR", (0, 0), (1, 60), ((0, 0), (0, 3)))
    up = aref("BAR", (0, 0), (1, 60), ((0, 0), (3, 0)), angle=90)
    code, message = refusal(tmp_path, library(bars, cell("TOP", across, up)))
    assert code == "MP215"
    assert f"{59 * 59 + 1} outlines and holes" in message


def test_a_file_that_is_cut_short_is_refused_at_every_byte(tmp_path: Path) -> None:
    whole = library(
        cell("IN", boundary(SQUARE), path([(0, 0), (5000, 0)], 100, 4, ends=(1, 2))),
        cell(
            "TOP", aref("IN", (0, 0), (2, 2), ((5000, 0), (0, 5000)), mag=2, angle=90)
        ),
    )
    for size in range(len(whole)):
        code, message = refusal(tmp_path, whole[:size])
        assert code == "MP230"
        assert "(byte " in message


def test_any_byte_may_be_wrong(tmp_path: Path) -> None:
    """Whatever a byte turns into, there is an outline or a finding, no exception."""
    whole = library(
        cell("IN", boundary(SQUARE), path([(0, 0), (5000, 0)], 100, 2), text("a")),
        cell(
            "TOP",
            sref("IN", mag=2, angle=45),
            aref("IN", (0, 0), (2, 2), ((9, 0), (0, 9))),
        ),
    )
    chance = random.Random(1)
    for place in range(len(whole)):
        for value in {whole[place] ^ 0x80, chance.randrange(256)}:
            spoilt = bytes([*whole[:place], value, *whole[place + 1 :]])
            _, _, report = read(tmp_path, spoilt)
            assert all(f.code in KNOWN for f in report.found)


KNOWN = {f"MP2{k:02}" for k in (4, 8, 9, 10, 15, 16, 30, 31, 32, 33, 35, 36)}


def test_what_cannot_be_opened_is_said(tmp_path: Path) -> None:
    report = Report()
    for name in ("none.gds", "."):
        open_gds(tmp_path / name, name, "um", None, AT, LAYERS_AT, CELL_AT, report)
    (tmp_path / "large.gds").write_bytes(bytes(MAX_BYTES + 1))
    open_gds(
        tmp_path / "large.gds", "large.gds", "um", None, AT, LAYERS_AT, CELL_AT, report
    )
    assert [f.code for f in report.found] == ["MP001", "MP001", "MP009"]


@pytest.mark.parametrize("seed", range(12))
def test_gdstk_covers_the_same_area(tmp_path: Path, seed: int) -> None:
    """Random cells three deep, by the same file; gdstk unites them its own way.

    Absolute widths are left out: gdstk 1.0.2 magnifies them.
    """
    data = random_library(random.Random(seed))
    (tmp_path / "mask.gds").write_bytes(data)
    (top,) = gdstk.read_gds(tmp_path / "mask.gds").top_level()
    assert isinstance(top, gdstk.Cell)
    covered = top.get_polygons(layer=1, datatype=0)
    united = gdstk.boolean(covered, [], "or", precision=1e-7)
    mask = read_library(data)
    placed = expand(mask, reached(mask, "TOP"), {"1/0"})
    found, _, _ = nest(unite(placed, mask.unit_um).rings)
    rival = sum(polygon.area() for polygon in united)
    # gdstk takes corners to 1e-7 um along x and y, finer ones are ours
    assert found.area_um2 == pytest.approx(rival, abs=2e-7 * found.perimeter_um)


def random_library(chance: random.Random) -> bytes:
    """Return nested cells whose shapes all lie over one large square."""

    def some(name: str) -> bytes:
        return sref(
            name, (chance.randrange(-9000, 9000), chance.randrange(-9000, 9000)),
            mag=chance.choice([0.5, 1.0, 1.37]), mirrored=chance.random() < 0.5,
            angle=chance.choice([0.0, 90.0, 45.0, 17.3, 271.5]),
        )  # fmt: skip

    line = [(0, 0), (8000, 0), (8000, 5000), (14_000, 9000)]
    low = cell(
        "LOW", boundary(SMALL), box(SQUARE, 2),
        path(line, 600, chance.choice([0, 2])),
    )  # fmt: skip
    grid = aref(
        "LOW", (-3000, 1000), (3, 2), ((5100, 700), (-300, 6100)),
        mag=0.5, angle=chance.choice([0.0, 33.0]), mirrored=True,
    )  # fmt: skip
    middle = cell("MIDDLE", some("LOW"), some("LOW"), grid)
    large = [(-6000, -6000), (6000, -6000), (6000, 6000), (-6000, 6000)]
    top = cell("TOP", boundary(large), *(some("MIDDLE") for _ in range(4)))
    return library(low, middle, top)
