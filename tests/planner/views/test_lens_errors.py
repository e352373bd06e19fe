"""The workcell's lens in looks, ledger and budget."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from microplan.featuresel.look.scenario import UnknownRotation, scene
from microplan.optics.coherence.degree import Coherence
from microplan.optics.layers.layer_error import layer_error
from microplan.optics.lens.distorted_scene import lens_scene
from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.scenario import build_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task
from microplan.planner.views.lens_errors import (
    known_errors,
    lamp_aperture,
    lens_rows,
    middle_sigma_um,
)
from microplan.planner.views.requests import Request, requests
from microplan.planner.views.target_views import needed_shape, target_pose, views
from tests.planner.examples import down_the_bore, read

EXAMPLE = Path(__file__).parents[3] / "examples" / "gear_on_shaft" / "task.yaml"


@pytest.fixture(scope="module")
def task() -> Task:
    found = load_task(EXAMPLE, Report())
    assert found is not None
    return found


def with_optics(task: Task, **changes: object) -> Task:
    """Return the task with a lens of other errors, or light of another coherence."""
    optics = task.workcell.optics
    coherence = changes.pop("coherence", optics.coherence)
    lens = replace(optics.lens, **changes)  # type: ignore[arg-type]  # by name
    if isinstance(coherence, float):
        coherence = Coherence(least=coherence, most=coherence)
    assert coherence is None or isinstance(coherence, Coherence)
    optics = replace(optics, lens=lens, coherence=coherence)
    return replace(task, workcell=replace(task.workcell, optics=optics))


def look(task: Task, name: str) -> Request:
    states = unfold(task, Report())
    found = [r for i in range(len(states)) for r in requests(task, states, i, None)]
    return next(request for request in found if request.id == name)


def test_an_unknown_distortion_is_charged_where_the_target_is(task: Task) -> None:
    request = look(task, "see_fingers")
    shape = needed_shape(task, request)
    spot = target_pose(task, request, shape)
    view = views(task, request, 6.9, Report())[0]
    rows = {
        row.effect: row
        for row in lens_rows(task, request.state, shape, spot, view.microscope)
    }
    half_um = math.hypot(*view.microscope.field_um) / 2
    x, y = spot.pose.x_um, spot.pose.y_um
    left, low, right, high = shape.box_um
    far_um = max(math.hypot(x + a, y + b) for a in (left, right) for b in (low, high))
    row = rows["radial distortion"]
    assert row.level == "charged from sigma"
    assert row.sigma_nm == pytest.approx(1e3 * 0.001 * far_um**3 / half_um**2)
    middle_um = math.hypot(x, y)
    assert middle_sigma_um(task.workcell, view.microscope, spot) == pytest.approx(
        0.001 * middle_um**3 / half_um**2
    )


def test_what_is_known_is_in_the_images(task: Task) -> None:
    bent = with_optics(task, distortion=0.05)
    request = look(bent, "find_shaft")
    view = views(bent, request, 6.9, Report())[0]
    case, _ = build_case(bent, request, view, 0.01)
    assert case.lens == known_errors(bent.workcell)
    assert case.lens.distortion_sigma == 0
    seen = scene(case, 0.0, 0.0, 0.0)
    assert lens_scene(seen, case.microscope, case.lens, 0.0) is not seen
    straight, _ = build_case(task, look(task, "find_shaft"), view, 0.01)
    seen = scene(straight, 0.0, 0.0, 0.0)
    assert lens_scene(seen, straight.microscope, straight.lens, 0.0) is seen


def test_a_held_part_stands_above_at_an_angle_that_trials_vary() -> None:
    found, task = {}, read(down_the_bore())
    for name in ("find_gear", "bring_between", "over_shaft"):
        request = look(task, name)
        view = views(task, request, 6.9, Report())[0]
        found[name] = build_case(task, request, view, 0.01)[0].spread.turning
    gear = UnknownRotation(owner="gear", x_um=0.0, y_um=0.0, sigma_theta_rad=math.pi)
    # nothing stands above the gear on the stage; fingers have their angle in their tips
    assert found == {"find_gear": (), "bring_between": (), "over_shaft": (gear,)}


def test_the_lamp_is_as_wide_as_the_workcell_says(task: Task) -> None:
    scope = views(task, look(task, "find_gear"), 6.9, Report())[0].microscope
    assert task.workcell.light.kind == "coaxial"
    assert lamp_aperture(task.workcell, scope) == scope.aperture
    narrow = with_optics(task, coherence=0.5).workcell
    assert lamp_aperture(narrow, scope) == pytest.approx(0.5 * scope.aperture)
    wide = with_optics(task, coherence=2.0).workcell
    assert lamp_aperture(wide, scope) == scope.aperture  # the objective is its stop
    blind = replace(scope, aperture=0.9)
    assert (lamp_aperture(wide, blind) or 1) < 1  # below the index of air
    ring = replace(task.workcell, light=replace(task.workcell.light, kind="ring"))
    assert lamp_aperture(ring, scope) is None


def test_looks_have_joint_occlusion_unless_rays_alone_keep_the_limit(
    task: Task,
) -> None:
    """Faces of the look over the shaft are 100 um apart: rays add nothing to that."""
    light = replace(task.workcell.light, kind="ring")
    ring = replace(task, workcell=replace(task.workcell, light=light))
    request = look(ring, "over_shaft")
    view = views(ring, request, 6.9, Report())[0]
    case, _ = build_case(ring, request, view, 0.5)
    joint, occluded = (
        layer_error(
            scene(case, 0.0, 0.0, 0.0),
            case.microscope,
            focus_um=view.focus_um,
            treatment=treatment,
            window=view.region,
        )
        for treatment in ("joint", "occluded")
    )
    assert joint < occluded
    below, _ = build_case(ring, request, view, joint / 2)
    lit, _ = build_case(task, request, view, 0.1)
    assert case.treatment == below.treatment == "joint"
    assert (lit.treatment, lit.lamp_aperture) == ("joint", view.microscope.aperture)
