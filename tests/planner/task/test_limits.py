"""Files at and beyond the limits: refused, or read, without a hang or a flood."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from microplan.optics.outline.outline import Arc, Ring
from microplan.planner.cli.main import main
from microplan.planner.drawings.dxf.file import MAX_ITEMS
from microplan.planner.drawings.nesting import MAX_RINGS
from microplan.planner.drawings.rings import rounded
from microplan.planner.source.diagnostics import (
    EXCERPT,
    MOST_ALIKE,
    MOST_WORDS,
    Report,
    Span,
    render_text,
)
from microplan.planner.source.source import parse
from microplan.planner.task.regions.features import dominant_circle
from tests.planner.drawings.dxf.test_corpus import codes, read
from tests.planner.drawings.dxf_text import circle, dxf, line, spline
from tests.planner.examples import change, copy_example


def test_lines_along_each_other_are_refused_not_cut_to_pieces(tmp_path: Path) -> None:
    lines = [line((k, 0), (700 + k, 0)) for k in range(700)]  # 245 000 overlaps
    assert codes(read(dxf(*lines), tmp_path)[1]) == ["MP205"]


def test_rings_within_rings_are_refused_before_they_are_compared(
    tmp_path: Path,
) -> None:
    rings = [circle((0, 0), 1 + k * 0.02) for k in range(1000)]
    assert codes(read(dxf(*rings), tmp_path)[1]) == ["MP208"]
    many = [circle((3 * k, 0), 1) for k in range(MAX_RINGS + 1)]
    assert codes(read(dxf(*many), tmp_path)[1]) == ["MP208"]


def test_a_file_of_too_many_entities_is_refused(tmp_path: Path) -> None:
    text = dxf(circle((0, 0), 5))
    start = text.index("  2\nENTITIES\n") + len("  2\nENTITIES\n")
    text = text[:start] + "0\nLINE\n" * MAX_ITEMS + text[start:]
    assert codes(read(text, tmp_path)[1]) == ["MP215"]


def test_a_spline_of_too_much_work_is_refused(tmp_path: Path) -> None:
    count, degree = 2000, 15
    points = [(math.cos(k), math.sin(k)) for k in range(count)]
    knots = [float(k) for k in range(count + degree + 1)]
    assert codes(read(dxf(spline(degree, knots, points)), tmp_path)[1]) == ["MP203"]


def test_the_dominant_circle_of_many_arcs_is_still_found() -> None:
    """The grid that saves comparing all with all hides none: against all with all."""
    rng = np.random.default_rng(0)
    turns = np.sort(rng.uniform(0, math.tau, 40))
    for near in (0.0, 4e-6, 3e-5):
        arcs = [
            Arc(center=(near * (k % 3), 0.0), radius_um=50.0, start_rad=a,
                sweep_rad=(b - a) % math.tau)
            for k, (a, b) in enumerate(zip(turns, np.roll(turns, -1), strict=True))
        ]  # fmt: skip
        ring = Ring(edges=tuple(arcs))
        found = dominant_circle(ring)
        share = sum(a.length_um for a in arcs if a.center == (0.0, 0.0))
        if near < 1e-5:  # all lie on one circle as far as SAME_UM tells
            assert found is not None
            assert all(found.on)
        elif share < sum(a.length_um for a in arcs) / 2:
            assert found is None


@pytest.mark.parametrize("text", ["0x" + "f" * 5000, "0o" + "7" * 9000, "9" * 5000])
def test_a_number_beyond_all_bounds_is_a_finding(text: str) -> None:
    report = Report()
    parse(f"a: {text}\n", Path("task.yaml"), "task.yaml", report)
    assert [d.code for d in report.found] == ["MP008"]


def test_findings_are_counted_beyond_the_first_hundred() -> None:
    report, text = Report(), "x" * 100_000
    for k in range(3 * MOST_ALIKE):
        where = Span(file="task.yaml", line=1, column=k + 1, length=9, text=text)
        report.error("MP104", where, f"unknown key {k}")
    report.error("MP101", Span(file="task.yaml", line=2), text)
    listed = report.in_order
    assert len(listed) == MOST_ALIKE + 2
    assert listed[MOST_ALIKE].message.endswith(
        f"and {2 * MOST_ALIKE - 1} more of MP104, not listed"
    )
    assert len(listed[-1].message) < MOST_WORDS + 50
    assert max(len(render_text(d)) for d in listed) < 4 * EXCERPT + MOST_WORDS + 100


def test_names_cannot_command_a_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task = copy_example(tmp_path / "job")
    change(task, "layers: [PLATE]", r'layers: ["\e[2J\ud800"]')
    assert main(["check", str(task)]) == 2
    said = capsys.readouterr().err
    assert "\\u001b[2J\\ud800" in said
    assert "\x1b" not in said


def test_points_of_decimals_keep_their_cell_whatever_the_unit() -> None:
    for k in range(2000):
        um = k / 2 * 1e-3 + k  # many of them half-way between nanometres
        for unit in (1e3, 25_400.0):
            back = um / unit * unit
            assert rounded((back, -back)) == rounded((um, -um))
