"""What a look sees: its target in the field, its region, its light, hidden edges."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.optics.outline.outline import Arc, Outline, Ring, Segment
from microplan.planner.assembly.assembly import Axis4, Place, State
from microplan.planner.assembly.initial_state import initial
from microplan.planner.assembly.step_states import unfold
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Part, Task
from microplan.planner.views.check_task import check_task
from microplan.planner.views.requests import requests
from microplan.planner.views.scenes import EDGE_POINTS, shade_of
from microplan.planner.views.target_views import (
    needed_shape,
    search_um,
    target_pose,
    views,
)
from microplan.planner.views.targets import TargetShape, shape_of
from microplan.planner.views.views import SEARCH_SIGMAS, light_level, region_for
from microplan.planner.views.zooms import in_field, microscope_at
from microplan.schemas.pose import Pose
from tests.planner.examples import EXAMPLE, beyond_notes, down_the_bore, read

LOW = 6.9


@cache
def example() -> Task:
    return read(EXAMPLE / "task.yaml")


@pytest.fixture
def task() -> Task:
    return example()


def spot(x_um: float, y_um: float, sigma_um: float, z_um: float = 100.0) -> Place:
    return Place(
        name="gear.teeth",
        owner="gear",
        carrier="stage",
        pose=Pose(x_um=x_um, y_um=y_um),
        z_um=z_um,
        sigma_xy_um=sigma_um,
        sigma_theta_rad=math.pi,
    )


def gear(task: Task) -> TargetShape:
    shape = shape_of(task, initial(task), "gear")
    assert shape is not None
    return shape


def test_every_look_of_the_example_has_a_view_that_holds_its_target(task: Task) -> None:
    report = Report()
    states = unfold(task, report)
    looks = [r for i in range(len(states)) for r in requests(task, states, i, None)]
    assert [look.id for look in looks] == [
        "find_gear", "see_fingers", "bring_between", "gear_in_fingers", "find_shaft",
        "over_shaft", "check_seated.target", "check_seated.seat",
    ]  # fmt: skip
    for look in looks:
        found = views(task, look, LOW, report)
        assert found
        shape = needed_shape(task, look)
        for view in found:
            assert in_field(
                view.microscope, shape.box_um, target_pose(task, look, shape)
            )
            assert -500 <= view.focus_um <= 500
            assert 0 < view.light <= 1
    assert beyond_notes(report) == []


@given(
    x_um=st.floats(-200, 200), y_um=st.floats(-150, 150), sigma_um=st.floats(0.1, 30)
)
def test_the_region_holds_the_target_within_the_frame(
    x_um: float, y_um: float, sigma_um: float
) -> None:
    task = example()
    scope = microscope_at(task.workcell, LOW)
    box = gear(task).box_um
    region = region_for(scope, box, spot(x_um, y_um, sigma_um), 0.0)
    k = scope.px_per_um
    room = SEARCH_SIGMAS * sigma_um
    left = max(0.0, 319.5 + k * (x_um + box[0] - room))
    right = min(639.0, 319.5 + k * (x_um + box[2] + room))
    top = max(0.0, 239.5 - k * (y_um + box[3] + room))
    assert 0 <= region.column <= left
    assert right <= region.column + region.columns - 1 <= 639
    assert 0 <= region.row <= top
    assert region.row + region.rows <= 480


@given(sigma_um=st.floats(0.1, 20), followed_um=st.floats(0.1, 20))
def test_a_region_goes_along_with_what_the_robot_followed(
    sigma_um: float, followed_um: float
) -> None:
    """Only the field must hold it as far off; the search goes no farther."""
    task = example()
    scope, box = microscope_at(task.workcell, LOW), gear(task).box_um
    at_rest = spot(0.0, 0.0, sigma_um)
    near = replace(at_rest, followed_um=followed_um)
    far = spot(0.0, 0.0, math.hypot(sigma_um, followed_um))
    assert region_for(scope, box, near, 0.0) == region_for(scope, box, at_rest, 0.0)
    assert search_um(task, near) == search_um(task, at_rest)
    for zoom in (LOW, 4 * LOW, 8 * LOW):
        at = microscope_at(task.workcell, zoom)
        assert in_field(at, box, near) is in_field(at, box, far)


def test_the_brightest_face_stays_below_full_scale_in_the_worst_light(
    task: Task,
) -> None:
    look = next(iter(requests(task, unfold(task, Report()), 0, None)))
    (view, *_) = views(task, look, LOW, Report())
    worst = 0.80 * 1.3 * (1 + 0.3 / 2)  # reflectance, gain, half the gradient
    assert view.light * worst == pytest.approx(0.95)
    # the bare stage sends back a tenth: all the light there is stays below full scale
    assert light_level(task.workcell, (), task.benchmark, 0.1) == 1.0


# --- hidden and shaded edges, against circle and half-plane

HIGH_UM, HOLE_UM = 60.0, 25.0
SLOPE = math.tan(math.asin(0.42))


def disc(radius_um: float) -> Outline:
    arc = Arc(center=(0.0, 0.0), radius_um=radius_um, start_rad=0.0,
              sweep_rad=2 * math.pi)  # fmt: skip
    return Outline(rings=(Ring(edges=(arc,), layer=""),))


def slab(x_um: float) -> Outline:
    """Return a large rectangle whose left face stands at `x_um`."""
    points = [(x_um, -500.0), (x_um + 900, -500.0), (x_um + 900, 500.0), (x_um, 500.0)]
    edges = tuple(
        Segment(start=a, end=b)
        for a, b in zip(points, points[1:] + points[:1], strict=True)
    )
    return Outline(rings=(Ring(edges=edges, layer=""),))


def under(task: Task, face: float) -> tuple[Task, State]:
    """Return a disc-shaped part below a slab that is HIGH_UM above its face."""

    def part(name: str, outline: Outline, thickness_um: float) -> Part:
        return replace(
            task.parts["gear"], name=name, outline=outline, features={}, posts={},
            thickness_um=thickness_um,
        )  # fmt: skip

    state = initial(task)
    low = replace(state.parts["gear"], pose=Pose(x_um=0.0, y_um=0.0), sigma_xy_um=0.0)
    parts = {
        "coin": part("coin", disc(HOLE_UM), 10.0),
        "roof": part("roof", slab(face), 10.0 + HIGH_UM),
    }
    changed = replace(task, parts=parts)
    return changed, replace(
        state, stage=Axis4(), tool=None, parts={"coin": low, "roof": low}
    )


@pytest.mark.parametrize("face_um", [-20.0, -5.0, 0.0, 10.0, 24.0, 40.0, 60.0])
def test_hidden_and_shaded_arcs_have_a_closed_form(task: Task, face_um: float) -> None:
    changed, state = under(task, face_um)
    shape = shape_of(changed, state, "coin")
    assert shape is not None
    where = Place(
        name="coin", owner="coin", carrier="stage", pose=Pose(x_um=0.0, y_um=0.0),
        z_um=10.0, sigma_xy_um=0.0, sigma_theta_rad=0.0,
    )  # fmt: skip

    def beyond(x_um: float) -> float:
        """Return the share of the rim right of a line."""
        return math.acos(max(-1.0, min(1.0, x_um / HOLE_UM))) / math.pi

    hidden, reached = beyond(face_um), beyond(face_um - HIGH_UM * SLOPE)
    shades = shade_of(changed, state, shape, where, 0.42, 1.0)
    atol = 1.001 / EDGE_POINTS  # one arc, counted to within one point
    if reached == 0:
        assert shades == ()
        return
    (shade,) = shades
    assert (shade.target, shade.by) == ("coin.outline", "roof")
    assert shade.hidden == pytest.approx(hidden, abs=atol)
    assert shade.hidden + shade.shaded == pytest.approx(reached, abs=atol)


def test_a_look_says_once_what_stands_in_its_way_at_any_present_zoom(
    task: Task,
) -> None:
    """So `check`, which starts low, and `compile`, which may not, say the same."""
    states = unfold(task, Report())
    looks = [r for i in range(len(states)) for r in requests(task, states, i, None)]
    said = []
    for current in (LOW, 2 * LOW):
        report = Report()
        for look in looks:
            views(task, look, current, report)
        said.append([d for d in report.in_order if d.code == "MP306"])
    assert said[0] == said[1]
    checked = Report()
    check_task(task, checked)
    assert [d for d in checked.in_order if d.code == "MP306"] == said[0]
    shaded = {d.message.partition(":")[0] for d in said[0]}
    wanted = ("bring_between", "gear_in_fingers", "over_shaft", "check_seated.target")
    assert shaded == {f"look {name!r}" for name in wanted}
    assert len(said[0]) == len(wanted)
    assert all(d.severity == "note" and d.hint for d in said[0])


def test_edges_mostly_hidden_are_a_warning() -> None:
    task = read(down_the_bore())
    report, states = Report(), unfold(task, Report())
    look = next(r for i in range(len(states)) for r in requests(task, states, i, None)
                if r.id == "find_shaft")  # fmt: skip
    over = replace(look, state=replace(look.state, stage=Axis4(x_um=90.0, z_um=-260.0)))
    assert views(task, over, LOW, report)
    (finding,) = beyond_notes(report)
    assert (finding.code, finding.severity) == ("MP306", "warning")
    assert "tweezers.right 100%" in finding.message


def test_nothing_lower_hides_anything(task: Task) -> None:
    changed, state = under(task, -20.0)
    shape = shape_of(changed, state, "roof")
    assert shape is not None
    where = replace(spot(0, 0, 0), name="roof", owner="roof", z_um=10.0 + HIGH_UM)
    assert shade_of(changed, state, shape, where, 0.42, 1.0) == ()
