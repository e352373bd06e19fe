"""Which coarse look may come first, and what the fine look knows after it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from microplan.planner.assembly.step_states import unfold
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.check_task import check_task
from microplan.planner.views.coarse import (
    CoarseLook,
    assumed,
    centring,
    coarse_requests,
    fine_request,
    may_gain,
)
from microplan.planner.views.requests import PriorKnowledge, Request, requests
from microplan.planner.views.target_views import needed_shape, target_pose, views
from tests.planner.examples import change, copy_example, read

LOW = 6.9
REP_UM = math.sqrt(2) * 1.0  # two moves of the example's stage


def with_pixels(folder: Path, pixels: str) -> Path:
    """Return the example's task, its camera with other pixels on the same sensor."""
    file = copy_example(folder / "task")
    change(file.with_name("workcell.yaml"), "pixels: [640, 480]", f"pixels: {pixels}")
    return file


@pytest.fixture
def task(tmp_path: Path) -> Task:
    """Return the example with a camera whose four pixels take 19.2 x on a tooth."""
    return read(with_pixels(tmp_path, "[200, 150]"))


def find_gear(task: Task) -> Request:
    (found,) = requests(task, unfold(task, Report()), 0, None)
    return found


def seen(task: Task, coarse: Request, sigma_um: float) -> CoarseLook:
    return replace(assumed(task, coarse), sigma_um=sigma_um, sigma_theta_rad=None)


def test_something_coarser_on_the_part_is_looked_at_first(task: Task) -> None:
    request = find_gear(task)
    assert views(task, request, LOW, Report()) == ()
    found = coarse_requests(task, request)
    details = [needed_shape(task, each).finest_um for each in found]
    assert details == sorted(details, reverse=True)
    assert "gear" not in {each.target for each in found}  # its teeth are too fine
    for each in found:
        assert each.id == "find_gear.coarse"
        assert each.tolerance_um is None  # a pixel does
        assert views(task, each, LOW, Report())
        assert not each.divisible  # and nothing before that


def test_what_is_resolved_at_once_may_be_its_own_coarse_look(tmp_path: Path) -> None:
    """If its tolerance asks for more zoom than its place allows."""
    task = read(with_pixels(tmp_path, "[640, 480]"))
    assert coarse_requests(task, find_gear(task))[0].target == "gear"


def test_a_post_is_its_own_coarse_look(task: Task) -> None:
    states = unfold(task, Report())
    (look,) = (
        request
        for index, state in enumerate(states)
        for request in requests(task, states, index, None)
        if state.step.id == "find_shaft"
    )
    assert coarse_requests(task, look)[0].target == "shaft_plate.post"


def test_a_place_must_be_known_twice_as_well_to_be_worth_it(task: Task) -> None:
    request = find_gear(task)
    (coarse, *_) = coarse_requests(task, request)
    before_um = target_pose(task, request, needed_shape(task, request)).sigma_xy_um
    for share, found in ((0.4, True), (0.5, False)):
        told = seen(task, coarse, share * before_um)
        assert (fine_request(task, request, coarse, told) is not None) is found


def test_a_refused_look_gains_by_more_zoom_or_less_way_from_the_axis(
    tmp_path: Path,
) -> None:
    task = read(with_pixels(tmp_path, "[640, 480]"))
    request = find_gear(task)
    (coarse, *_) = coarse_requests(task, request)
    fine = fine_request(task, request, coarse, seen(task, coarse, 0.4))
    assert fine is not None
    assert may_gain(task, request, fine)  # 16.4 x before, 21 x are useful
    gear = replace(request.state.parts["gear"], sigma_xy_um=8.0)
    parts = {**request.state.parts, "gear": gear}
    near = replace(request, state=replace(request.state, parts=parts))
    fine = fine_request(task, near, coarse, seen(task, coarse, 0.4))
    assert fine is not None
    # the zoom cannot gain; half a percent of it over 3 sigma errs .25 um at 2 sigma
    assert not may_gain(task, replace(near, tolerance_um=0.26), fine)
    assert may_gain(task, replace(near, tolerance_um=0.24), fine)


def test_only_a_step_that_just_looks_can_be_split(task: Task) -> None:
    states = unfold(task, Report())
    for index, state in enumerate(states):
        for request in requests(task, states, index, 1.0):
            assert request.divisible is (state.step.verb == "locate")
            if not request.divisible or request.target.startswith("tweezers"):
                assert coarse_requests(task, request) == ()


def test_the_fine_look_knows_what_coarse_look_zoom_and_moves_leave(task: Task) -> None:
    request = find_gear(task)
    (coarse, *_) = coarse_requests(task, request)
    fine = fine_request(task, request, coarse, seen(task, coarse, 0.4))
    assert fine is not None
    spot = target_pose(task, fine, needed_shape(task, fine))
    far_um = 2 * math.hypot(30, 1)  # of the target at two sigma, seen at a wrong scale
    told_um = math.hypot(REP_UM, 0.4, 1.0, 0.002 * far_um)
    arm_um = math.dist(needed_shape(task, coarse).center_um, (0.0, 0.0))
    assert spot.sigma_xy_um == pytest.approx(math.hypot(told_um, arm_um))
    assert spot.pose == target_pose(task, request, needed_shape(task, request)).pose
    found = views(task, fine, LOW, Report())
    assert min(v.microscope.magnification for v in found) >= 19.2


def test_a_tolerance_leaves_room_for_the_way_back(task: Task) -> None:
    request = find_gear(task)
    (coarse, *_) = coarse_requests(task, request)
    for tolerance_um in (2 * REP_UM - 0.01, 3.0):
        asked = replace(request, tolerance_um=tolerance_um)
        fine = fine_request(task, asked, coarse, seen(task, coarse, 0.4))
        if tolerance_um < 2 * REP_UM:
            assert fine is None
            continue
        assert fine is not None
        assert fine.tolerance_um is not None
        assert math.hypot(fine.tolerance_um, 2 * REP_UM) == pytest.approx(tolerance_um)


def test_a_target_swings_about_what_was_measured(task: Task) -> None:
    """A place measured 30 um off the origin, an angle to .02: by Monte Carlo."""
    request = find_gear(task)
    known = PriorKnowledge(about_um=(30.0, 40.0), sigma_um=0.5, sigma_theta_rad=0.02)
    told = replace(request, known=known)
    spot = target_pose(task, told, needed_shape(task, told))
    rng = np.random.default_rng(2)
    turn = rng.normal(0.0, 0.02, 100_000)
    off = rng.normal(0, 0.5, (2, turn.size))
    swung = (1 - np.exp(1j * turn)) * complex(*known.about_um)
    x, y = swung.real + off[0], swung.imag + off[1]
    # the swing goes one way only: charged to both axes
    assert np.hypot(x.std(), y.std()) <= math.sqrt(2) * spot.sigma_xy_um
    assert max(x.std(), y.std()) <= spot.sigma_xy_um * 1.01
    assert spot.sigma_theta_rad == 0.02


def test_nothing_is_centred_that_would_touch_something(task: Task) -> None:
    request = find_gear(task)
    (coarse, *_) = coarse_requests(task, request)
    told = seen(task, coarse, 0.4)
    assert fine_request(task, request, coarse, told) is not None
    state = request.state
    near = replace(state, robot=replace(state.robot, x_um=0.0, y_um=120.0, z_um=30.0))
    beside = replace(request, state=near)
    assert fine_request(task, beside, coarse, told) is None
    most = centring(task, request, "a").most_um
    # three sigma of where it may be and of the benchmark's, and half as much again
    assert most == pytest.approx(1.5 * 3 * math.hypot(30, 1, 2))


def test_nothing_is_centred_beyond_the_end_of_an_axis(task: Task) -> None:
    request = find_gear(task)
    (coarse, *_) = coarse_requests(task, request)
    stage = replace(request.state.stage, x_um=4950.0)
    gear = request.state.parts["gear"]
    at = replace(gear, pose=replace(gear.pose, x_um=-4950.0))
    parts = {**request.state.parts, "gear": at}
    end = replace(request, state=replace(request.state, stage=stage, parts=parts))
    assert fine_request(task, end, coarse, seen(task, coarse, 0.4)) is None


def test_check_says_that_a_look_is_made_in_two(task: Task) -> None:
    report = Report()
    check_task(task, report)
    said = [d for d in report.in_order if d.code == "MP405"]
    (finding,) = said
    assert finding.severity == "note"
    assert "'find_gear'" in finding.message
    assert "19.2 x" in finding.message
    assert "MP403" not in {d.code for d in report.found}


def test_where_no_coarse_look_helps_the_first_refusal_stands(tmp_path: Path) -> None:
    file = with_pixels(tmp_path, "[40, 30]")
    report = Report()
    check_task(read(file), report)
    codes = [d.code for d in report.in_order if "'find_gear'" in d.message]
    assert "MP403" in codes
    assert "MP405" not in codes
