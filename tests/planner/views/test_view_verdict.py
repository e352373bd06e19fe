"""The verdict on a look's settings: interval, aperture table, focus."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.planner.assembly.step_states import unfold
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.requests import Request, requests
from microplan.planner.views.view_verdict import view_verdict
from microplan.planner.views.zooms import ladder, microscope_at
from microplan.schemas.codec import from_data, to_data
from microplan.schemas.plan import View
from microplan.schemas.plan.views import ViewVerdict, ZoomTried
from tests.planner.examples import EXAMPLE, read

USABLE = {"gear.teeth": (-10.0, 20.0)}


@pytest.fixture(scope="module")
def task() -> Task:
    return read(EXAMPLE / "task.yaml")


@pytest.fixture(scope="module")
def find_gear(task: Task) -> Request:
    (found,) = requests(task, unfold(task, Report()), 0, None)
    return found


def view(task: Task, rung: int, *stops_um: float) -> View:
    scope = microscope_at(task.workcell, ladder(task.workcell)[rung])
    return View(
        magnification=scope.magnification,
        focus_um=100.0,
        focus_stops_um=stops_um,
        light=0.8,
        field_um=scope.field_um,
        um_per_px=scope.um_per_px,
    )


def test_the_table_has_the_rungs_that_are_allowed_and_marks_the_chosen_one(
    task: Task, find_gear: Request
) -> None:
    found = view_verdict(task, find_gear, view(task, 1), USABLE, ())
    # 30 um of the gear's place and 1 um of the stage's; the field is 3600 um / m high
    most = 3600 / (100 + 4 * (30**2 + 1) ** 0.5)
    assert (found.zoom.least, found.zoom.most) == pytest.approx((6.9, most))
    rows = found.apertures
    assert [row.magnification for row in rows] == pytest.approx(
        [6.9, 6.9 * 2**0.5, 13.8]
    )
    assert [row.chosen for row in rows] == [False, True, False]
    for row in rows:
        assert row.um_per_px == pytest.approx(7.5 / row.magnification)
        assert row.cutoff_um == pytest.approx(0.6 / (2 * 0.42))
        assert row.depth_um == pytest.approx(0.6 / 0.42**2)
        assert row.field_um[1] == pytest.approx(3600 / row.magnification)


def test_what_the_trials_refused_cuts_the_interval_from_below(
    task: Task, find_gear: Request
) -> None:
    refused = (ZoomTried(magnification=6.9, reason="sigma .9 um, tolerance .5 um"),)
    found = view_verdict(task, find_gear, view(task, 1), USABLE, refused)
    assert found.zoom.least == 6.9
    (bound,) = (b for b in found.zoom.bounds if b.by == "trials")
    assert "sigma .9 um" in bound.reason
    higher = (*refused, ZoomTried(magnification=9.758, reason="the same"))
    found = view_verdict(task, find_gear, view(task, 2), USABLE, higher)
    assert found.zoom.least == 9.758
    assert [row.chosen for row in found.apertures] == [False, True]
    # what was refused above the chosen one says nothing about those below
    above = (ZoomTried(magnification=13.8, reason="a fluke"),)
    found = view_verdict(task, find_gear, view(task, 1), USABLE, above)
    assert found.zoom.least == 6.9
    assert found.zoom.refused == above


def test_the_focus_says_what_it_takes_in(task: Task, find_gear: Request) -> None:
    found = view_verdict(task, find_gear, view(task, 0), USABLE, ()).focus
    (accepted,) = found.accepted
    assert (accepted.least_um, accepted.most_um) == (90.0, 120.0)
    assert found.sigma_um == 1.0  # the stage's in z
    assert found.margin_um == pytest.approx(3 * 0.5)  # the drive's repeatability
    # a target higher by e is sharp where the focus is lower by e
    assert found.covered_um == pytest.approx((-20 + 1.5, 10 - 1.5))
    more = view_verdict(task, find_gear, view(task, 0, 120.0), USABLE, ()).focus
    assert more.stops == 2
    assert more.covered_um == pytest.approx((-20 + 1.5, 30 - 1.5))


def test_a_verdict_is_kept_by_the_plans_codec(task: Task, find_gear: Request) -> None:
    tried = (ZoomTried(magnification=6.9, reason="too coarse"),)
    found = view_verdict(task, find_gear, view(task, 1), USABLE, tried)
    again = from_data(ViewVerdict, to_data(found, digits=17))
    assert again == replace(found)
