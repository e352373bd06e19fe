"""Several features of one look: the same picture, and which of them it holds."""

from __future__ import annotations

import cmath
from dataclasses import replace

import numpy as np
import pytest

from microplan.featuresel.look.design import design
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.planner.assembly.initial_state import initial
from microplan.planner.looks.evaluation import unseen
from microplan.planner.looks.scenario import MOST_TOGETHER, build_case, feature_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.features import offset_um, proposals
from microplan.planner.views.requests import Request
from microplan.planner.views.target_views import needed_shape, views, whole_view
from microplan.planner.views.targets import TargetShape
from microplan.planner.views.views import SEARCH_SIGMAS, ViewPlan
from tests.planner.examples import EXAMPLE, read
from tests.planner.views.test_features import HOLES, plate

THETA_RAD, SIGMA_RAD, SIGMA_UM = 0.4, 0.02, 1.0
KINDS = ("circle", "edge", "corner", "outline")


@pytest.fixture(scope="module")
def task() -> Task:
    """Return the plate with two holes, turned and nearly in place."""
    made = plate(read(EXAMPLE / "task.yaml"))
    start = replace(
        made.part_starts["gear"], theta_rad=THETA_RAD, theta_any=False,
        sigma_xy_um=SIGMA_UM, sigma_theta_rad=SIGMA_RAD, x_um=603.0, y_um=-2.0,
    )  # fmt: skip
    return replace(made, part_starts={**made.part_starts, "gear": start})


@pytest.fixture(scope="module")
def request_(task: Task) -> Request:
    return Request(
        id="look", target="gear.near", state=initial(task), tolerance_um=1.0,
        wants_angle=True, needs_angle_rad=None, where=task.steps[0].where,
        view_where=None,
    )  # fmt: skip


@pytest.fixture(scope="module")
def view(task: Task, request_: Request) -> ViewPlan:
    return whole_view(task, request_, views(task, request_, 7.5, Report())[0])


@pytest.fixture(scope="module")
def primary(task: Task, request_: Request, view: ViewPlan) -> LookCase:
    return build_case(task, request_, view, 0.002)[0]


@pytest.fixture(scope="module")
def others(
    task: Task, request_: Request, view: ViewPlan, primary: LookCase
) -> dict[str, tuple[TargetShape, LookCase]]:
    """Return a look at the first other feature of each kind."""
    found: dict[str, tuple[TargetShape, LookCase]] = {}
    known = proposals(task, needed_shape(task, request_))
    for _, shape in known.others:
        if shape.kind not in found:
            case = feature_case(task, request_, primary, shape)
            found[shape.kind] = (shape, case)
    return found


def away(task: Task, request_: Request, shape: TargetShape) -> complex:
    """Return a feature's place seen from the target, um of the part's axes."""
    return complex(*offset_um(shape, needed_shape(task, request_)))


@pytest.mark.parametrize("kind", KINDS)
def test_a_look_at_another_feature_shows_the_same_picture(
    kind: str,
    task: Task,
    request_: Request,
    primary: LookCase,
    others: dict[str, tuple[TargetShape, LookCase]],
) -> None:
    shape, case = others[kind]
    shown = nominal_render(case)
    # drawn from other numbers of the same places: rounding, 1e-16 of 1e3 px
    np.testing.assert_allclose(shown(), nominal_render(primary)(), atol=1e-9)
    # moved and turned about the target, the feature swings about it as well
    shift, turn = complex(0.7, -1.2), 0.03
    swing = cmath.rect(1.0, THETA_RAD) * (cmath.rect(1.0, turn) - 1)
    own = shift + swing * away(task, request_, shape)
    np.testing.assert_allclose(
        shown(dx_um=own.real, dy_um=own.imag, theta_rad=turn),
        nominal_render(primary)(dx_um=shift.real, dy_um=shift.imag, theta_rad=turn),
        atol=1e-9,
    )


@pytest.mark.parametrize("kind", KINDS)
def test_another_feature_is_where_the_part_has_it(
    kind: str,
    task: Task,
    request_: Request,
    primary: LookCase,
    others: dict[str, tuple[TargetShape, LookCase]],
) -> None:
    shape, case = others[kind]
    turned = cmath.rect(1.0, THETA_RAD) * away(task, request_, shape)
    at = complex(primary.x_um, primary.y_um) + turned
    assert (case.x_um, case.y_um) == pytest.approx((at.real, at.imag))
    seen = case.frame.to_world(case.target.column, case.target.row)
    assert seen == pytest.approx((at.real, at.imag))
    assert case.theta_rad == primary.theta_rad == THETA_RAD
    assert case.target.theta_rad == pytest.approx(THETA_RAD + shape.angle_rad)
    assert case.window == primary.window
    # the mean of so many is as much better than each
    share = case.tolerance_um / primary.tolerance_um
    assert share**2 == pytest.approx(MOST_TOGETHER)


@pytest.mark.parametrize("kind", KINDS)
def test_another_feature_is_sought_where_trials_of_the_target_put_it(
    kind: str,
    task: Task,
    request_: Request,
    primary: LookCase,
    others: dict[str, tuple[TargetShape, LookCase]],
) -> None:
    shape, case = others[kind]
    arm = cmath.rect(1.0, THETA_RAD) * away(task, request_, shape)
    trials = design(primary, 400, 1)
    off = [
        complex(t.dx_um, t.dy_um) + arm * (cmath.rect(1.0, t.dtheta_rad) - 1)
        for t in trials
    ]
    out = sum(abs(far) > case.spread.search_um for far in off)
    # three sigmas per axis: of two normal axes exp(-4.5) = 1.1 % lie beyond; more than
    # 13 of 400 are so by chance in fewer than one of 1000 cases
    assert out <= 13
    # and no farther than the worst of both at once
    assert case.spread.search_um <= primary.spread.search_um + (
        SEARCH_SIGMAS * primary.spread.pose_sigma_theta_rad * abs(arm)
    )


def test_the_edges_of_another_feature_are_its_own(
    others: dict[str, tuple[TargetShape, LookCase]],
) -> None:
    _, case = others["circle"]
    points = np.array(case.target.contour)[:, :2]
    np.testing.assert_allclose(np.hypot(*points.T), HOLES["far"][2], rtol=1e-9)


def test_what_lies_in_the_region_wherever_it_is_found_can_be_looked_for(
    primary: LookCase,
) -> None:
    """A hole's edges reach its radius from its middle, whatever the angle."""
    reach = HOLES["near"][2] * primary.target.px_per_um + primary.target.search_px
    inside = replace(
        primary, target=replace(primary.target, column=reach + 0.1, row=reach + 0.1)
    )
    assert unseen(inside) == ""
    last = (primary.window.columns - 1, primary.window.rows - 1)
    # contour points are half a pixel apart: one is within an eighth of the outermost
    for column, row in (
        (reach - 0.25, last[1] / 2), (last[0] / 2, reach - 0.25),
        (last[0] - reach + 0.25, last[1] / 2), (last[0] / 2, last[1] - reach + 0.25),
        (-500.0, last[1] / 2),
    ):  # fmt: skip
        target = replace(primary.target, column=column, row=row)
        words = unseen(replace(primary, target=target))
        assert words == "not tried: it may lie outside the region of the look"


def test_a_wider_search_needs_more_room(primary: LookCase) -> None:
    target = replace(primary.target, search_px=0.0)
    room = min(
        target.column, target.row,
        primary.window.columns - 1 - target.column,
        primary.window.rows - 1 - target.row,
    ) - HOLES["near"][2] * target.px_per_um  # fmt: skip
    for search, seen in ((room - 0.25, True), (room + 0.25, False)):
        some = replace(primary, target=replace(target, search_px=search))
        assert (unseen(some) == "") == seen


def test_a_feature_whose_edges_are_not_drawn_cannot_be_looked_for(
    primary: LookCase,
) -> None:
    bare = replace(primary, target=replace(primary.target, contour=()))
    assert unseen(bare) == "its edges are not drawn"
