"""What a look waits for, against the clock of the simulated cell."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.executor.simulated.cell import build_cell
from microplan.planner.assembly.assembly import Axis4, Carrier, axes_of
from microplan.planner.assembly.initial_state import initial
from microplan.planner.assembly.step_states import StepState, unfold
from microplan.planner.assembly.world import build_world
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.view_times import (
    MicroscopeSetting,
    approach_times,
    centre_times,
    move_times,
    view_change,
)
from microplan.schemas.plan import Look, View
from microplan.schemas.plan.views import CoarseFirst, TimeRow
from tests.executor.disc import look as disc_look
from tests.planner.examples import EXAMPLE, read

VIEW = View(
    magnification=6.9, focus_um=100.0, focus_stops_um=(), light=0.8,
    field_um=(695.0, 521.0), um_per_px=1.087,
)  # fmt: skip


@pytest.fixture(scope="module")
def task() -> Task:
    return read(EXAMPLE / "task.yaml")


@pytest.fixture(scope="module")
def states(task: Task) -> tuple[StepState, ...]:
    return unfold(task, Report())


def seen(view: View) -> Look:
    found, _ = disc_look()
    return replace(found, view=view)


def total(rows: tuple[TimeRow, ...]) -> float:
    return sum(row.time_s for row in rows)


@pytest.mark.parametrize("carrier", ["stage", "robot"])
def test_a_move_takes_as_long_as_on_the_simulated_cell(
    task: Task, carrier: Carrier
) -> None:
    cell = build_cell(build_world(task, initial(task)), 1)
    axes = cell.stage if carrier == "stage" else cell.robot
    rng = np.random.default_rng(5)
    for moved in ("x", "xy", "z", "t", "xyzt", ""):
        here = axes.reading()
        start = Axis4(
            x_um=here.x_um, y_um=here.y_um, z_um=here.z_um, theta_rad=here.theta_rad
        )
        by = {axis: rng.uniform(-90, 90) if axis in moved else 0.0 for axis in "xyzt"}
        end = Axis4(
            x_um=start.x_um + by["x"],
            y_um=start.y_um + by["y"],
            z_um=start.z_um + abs(by["z"]),
            theta_rad=start.theta_rad + by["t"] / 100,
        )
        began_s = cell.station.clock.now_s()
        axes.move(x_um=end.x_um, y_um=end.y_um, z_um=end.z_um, theta_rad=end.theta_rad)
        took_s = cell.station.clock.now_s() - began_s
        rows = tuple(move_times(axes_of(task, carrier), carrier, start, end))
        assert total(rows) == pytest.approx(took_s, rel=1e-9, abs=1e-12)
        assert bool(rows) is bool(moved)


def test_a_step_waits_for_its_moves_and_an_alignment_for_its_approach(
    task: Task, states: tuple[StepState, ...]
) -> None:
    named = {state.step.id: state for state in states}
    assert approach_times(task, named["find_gear"]) == ()  # it lies there
    fingers = approach_times(task, named["see_fingers"])
    # stage 250 um; robot 3000 um at 5000 um/s; down 360 um at 2000 um/s
    moves_s = (0.25 + 0.15, 0.6 + 0.15, 0.18 + 0.15)
    assert total(fingers) == pytest.approx(sum(moves_s))
    brought = approach_times(task, named["bring_between"])
    # the stage goes those 250 um back, in y
    assert total(brought) == pytest.approx(0.25 + 0.15)
    assert approach_times(task, named["gear_in_fingers"]) == ()


def test_only_what_changes_takes_time_and_errs(task: Task) -> None:
    first = view_change(task, seen(VIEW), None, ())
    assert (first.since, first.focus_um) == (None, None)
    assert first.parcentric_sigma_um == first.lateral_sigma_um == 0  # since when?
    frame_s = 1 / 30
    assert first.total_s == pytest.approx(1.5 + 0.4 + frame_s)
    before = MicroscopeSetting(look="a", view=VIEW)
    same = view_change(task, seen(VIEW), before, ())
    assert [row.what for row in same.times] == ["exposure and readout"]
    assert same.total_s == pytest.approx(frame_s)
    assert (same.parcentric_sigma_um, same.lateral_sigma_um) == (0, 0)
    nearer = view_change(
        task, seen(replace(VIEW, magnification=13.8, focus_um=-10.0)), before, ()
    )
    assert nearer.since == "a"
    assert nearer.parcentric_sigma_um == 1.0
    assert nearer.focus_um == pytest.approx(110)
    assert nearer.lateral_sigma_um == pytest.approx(0.002 * 110)
    assert nearer.total_s == pytest.approx(1.5 + 0.4 + frame_s)


def test_a_target_is_centred_there_and_back(task: Task) -> None:
    waits = centre_times(task, "stage", 20.0)
    rng = np.random.default_rng(3)
    draws = np.hypot(*rng.normal(0.0, 20.0, (2, 200_000)))
    # of 2e5 draws with a spread of .52 of the mean: 4 sigma are .5 %
    assert waits[0].time_s == pytest.approx(draws.mean() / 1000, rel=0.005)
    way = CoarseFirst(look="a", axes="stage", at_um=(0.0, 0.0), most_um=90.0)
    fine = replace(seen(VIEW), coarse=way)
    change = view_change(task, fine, MicroscopeSetting(look="a", view=VIEW), waits)
    assert change.total_s == pytest.approx(2 * total(waits) + 1 / 30)
    assert math.isclose(change.total_s, total(change.times))
