"""Tolerances that axes can hardly meet, told before anything is rendered."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from microplan.planner.assembly.step_states import unfold
from microplan.planner.plan.compiler import compile_task
from microplan.planner.plan.options import Options
from microplan.planner.source.diagnostics import Report
from microplan.planner.views.alignments import (
    GAIN_LIMIT,
    LEAST_SIGMAS,
    MOST_EXPECTED,
    check_tolerances,
)
from microplan.planner.views.check_task import check_task
from tests.planner.examples import change, copy_example, read
from tests.planner.placed import read as read_die
from tests.planner.placed import with_step


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a copy of the example, whose stage repeats to 1 um."""
    return copy_example(tmp_path / "task")


def line_of(file: Path, words: str) -> int:
    """Return the line of a file that holds some words."""
    lines = file.read_text(encoding="utf-8").splitlines()
    return 1 + next(k for k, line in enumerate(lines) if words in line)


@pytest.mark.parametrize(("within_um", "codes"), [(0.6, []), (0.59, ["MP603"])])
def test_a_hopeless_tolerance_is_told_at_its_line(
    file: Path, within_um: float, codes: list[str]
) -> None:
    change(file, "tolerance_xy_um: 3}", f"tolerance_xy_um: {within_um}}}")
    report = Report()
    assert check_task(read(file), report)
    found = [d for d in report.found if d.severity == "infeasible"]
    assert [d.code for d in found] == codes
    for finding in found:
        assert finding.where.line == line_of(file, f"tolerance_xy_um: {within_um}")
        assert finding.where.text[finding.where.column - 1 :].startswith(str(within_um))


def test_a_compile_of_a_hopeless_tolerance_renders_nothing(file: Path) -> None:
    change(file, "tolerance_xy_um: 3}", "tolerance_xy_um: 0.1}")
    report = Report()
    made = compile_task(read(file), report, Options(jobs=1))
    assert made is not None
    assert made.images == {}
    assert [(r.code, r.step) for r in made.plan.reasons] == [("MP603", "bring_between")]


def test_an_angle_finer_than_the_axes_is_refused() -> None:
    """The stage repeats to an arc second, 4.8 urad."""
    for tolerance_rad, codes in ((1e-5, []), (5e-7, ["MP603"])):
        task = with_step(read_die(), "over_site", tolerance_theta_rad=tolerance_rad)
        report = Report()
        states = unfold(task, Report())
        assert check_tolerances(task, states, report) is not bool(codes)
        assert [d.code for d in report.found] == codes


def test_the_least_tolerance_takes_the_most_looks_expected() -> None:
    """Looks at where a move of gain 1 ends, drawn."""
    rng = np.random.default_rng(3)
    away = np.hypot(*rng.normal(0.0, 1.0, (2, 200_000)))
    share = float((away < LEAST_SIGMAS).mean())
    # three standard errors of a share of 1 / 6 among so many: .0025 of .165
    assert 1 / share == pytest.approx(MOST_EXPECTED, rel=0.03)


def test_the_gain_limit_is_where_the_error_stops_shrinking() -> None:
    for gain, shrinks in ((0.99 * GAIN_LIMIT, True), (1.01 * GAIN_LIMIT, False)):
        assert (abs(1 - gain) < 1) is shrinks
