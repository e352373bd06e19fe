"""Angular tolerances that fits give to alignments, and looks that measure angles."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.compiling.keyed import keyed_pairs, write_task
from benchmarks.compiling.outline_shapes import box, d_shape
from microplan.planner.assembly.fits.room import free_angles_rad
from microplan.planner.assembly.mating import mating_of
from microplan.planner.assembly.step_states import unfold
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task, TaskStep
from microplan.planner.views.check_task import check_fits
from microplan.planner.views.fit_angles import ANGLE_SHARE, unfold_with_angles
from microplan.planner.views.requests import LOOK_SHARE, requests
from microplan.planner.views.targets import shape_of
from tests.planner.examples import EXAMPLE, change, read


def align_of(task: Task) -> TaskStep:
    return next(step for step in task.steps if step.id == "over_shaft")


def keyed_task(folder: Path) -> Path:
    return write_task(folder, d_shape(25.0, 16.0), d_shape(21.0, 13.0))


def test_the_alignment_before_a_keyed_fit_gets_half_of_its_play(tmp_path: Path) -> None:
    given = read(keyed_task(tmp_path / "task"))
    report = Report()
    task, states = unfold_with_angles(given, report)
    insert = next(state for state in states if state.step.verb == "insert")
    mating = mating_of(task, insert.step, insert.after)
    assert mating is not None
    assert mating.shape is not None
    assert mating.shape.angle_rad == pytest.approx(0.0, abs=1e-9)  # turned alike
    play = free_angles_rad(mating.shape, mating.wider_um[0])
    within = align_of(task).tolerance_theta_rad
    assert within == pytest.approx(ANGLE_SHARE * min(-play[0], play[1]), rel=1e-6)
    check_fits(task, states, report)
    assert {d.code for d in report.found if d.code > "MP600"} == {"MP610"}


def test_the_looks_before_a_keyed_fit_measure_angles(tmp_path: Path) -> None:
    given = read(keyed_task(tmp_path / "task"))
    task, states = unfold_with_angles(given, Report())
    within = align_of(task).tolerance_theta_rad
    assert within is not None
    for index, state in enumerate(states):
        if state.step.id in ("find_shaft", "over_shaft"):
            (look,) = requests(task, states, index, 1.0)
            assert look.needs_angle_rad == pytest.approx(LOOK_SHARE * within)
            shape = shape_of(task, state.at_look, look.target)
            assert shape is not None
            assert shape.has_angle == (look.target == "shaft_plate.post")


def test_round_fits_ask_for_no_angle() -> None:
    given = read(EXAMPLE / "task.yaml")
    task, states = unfold_with_angles(given, Report())
    assert task is not given or align_of(task).tolerance_theta_rad is None
    assert align_of(task).tolerance_theta_rad is None
    assert [s.step.id for s in states] == [s.step.id for s in unfold(given, Report())]


def test_a_stated_angle_stays(tmp_path: Path) -> None:
    file = keyed_task(tmp_path / "task")
    change(file, "method: auto}", "method: auto, tolerance_theta_deg: 0.5}")
    task, _ = unfold_with_angles(read(file), Report())
    assert align_of(task).tolerance_theta_rad == pytest.approx(0.5 * 3.14159265 / 180)


def test_every_kind_of_key_is_a_clearance_fit(tmp_path: Path) -> None:
    for index, (kind, bore, post) in enumerate(keyed_pairs(8, 3)):
        report = Report()
        given = read(write_task(tmp_path / f"{index}", bore, post))
        task, states = unfold_with_angles(given, report)
        check_fits(task, states, report)
        found = [d.message for d in report.found if d.code == "MP610"]
        assert len(found) == 1, kind
        assert "clearance fit" in found[0]


def test_a_post_that_is_too_long_is_refused_with_its_depth(tmp_path: Path) -> None:
    report = Report()
    given = read(write_task(tmp_path / "task", d_shape(25.0, 16.0), box(24.0, 5.0)))
    task, states = unfold_with_angles(given, report)
    check_fits(task, states, report)
    (found,) = (d for d in report.found if d.code == "MP617")
    assert found.severity == "infeasible"
    # 24 um out along x, where the flat is at 16
    assert "8 um deep" in found.message
