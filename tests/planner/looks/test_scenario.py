"""Cases of looks: what the region follows, and what sigma is promised for."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.featuresel.look.scenario import LookCase
from microplan.planner.assembly.assembly import height_sigma_um
from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.scenario import build_case, feature_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.features import proposals
from microplan.planner.views.requests import Request, requests
from microplan.planner.views.target_views import needed_shape, target_pose, views
from microplan.planner.views.views import ViewPlan
from tests.planner.examples import EXAMPLE, read

ZOOM = 6.9


def asked(task: Task, name: str) -> tuple[Request, ViewPlan]:
    """Return a look's request and its first view."""
    states = unfold(task, Report())
    (request,) = [
        each
        for index in range(len(states))
        for each in requests(task, states, index, None)
        if each.id == name
    ]
    return request, views(task, request, ZOOM, Report())[0]


def case_of(task: Task, name: str) -> LookCase:
    request, view = asked(task, name)
    case, _ = build_case(task, request, view, 0.05)
    return case


@pytest.fixture(scope="module")
def task() -> Task:
    return read(EXAMPLE / "task.yaml")


def test_what_a_robot_brought_to_a_goal_lies_off_together(task: Task) -> None:
    """By half a pixel: the region moves by whole ones."""
    along, alone = case_of(task, "over_shaft"), case_of(task, "find_gear")
    half_um = along.microscope.um_per_px / 2
    assert along.spread.together_um == along.promised.together_um == half_um
    assert alone.spread.together_um == 0.0


def test_where_the_frame_has_no_room_all_may_lie_farther_off(task: Task) -> None:
    request, view = asked(task, "over_shaft")
    followed_um = target_pose(task, request, needed_shape(task, request)).followed_um
    pitch_um = view.microscope.um_per_px
    for row, left_um in ((0, 2 * followed_um), (9, 2 * followed_um - 9 * pitch_um)):
        region = replace(view.region, row=row)
        case, _ = build_case(task, request, replace(view, region=region), 0.05)
        assert case.spread.together_um == pytest.approx(left_um)


def test_sigma_is_promised_for_the_whole_height(task: Task) -> None:
    """Of another feature of the body, too, whatever is tried."""
    tried = replace(task.benchmark, focus_sigma_um=0.6)
    task = replace(task, benchmark=tried)
    request, view = asked(task, "find_gear")
    case, _ = build_case(task, request, view, 0.05)
    (_, shape), *_ = proposals(task, needed_shape(task, request)).others
    other = feature_case(task, request, case, shape)
    height_um = height_sigma_um(task, request.state, "gear")
    assert height_um > 0.6
    for each in (case, other):
        assert each.promised.focus_sigma_um > height_um
        assert each.drawn.focus_sigma_um == 0.6
