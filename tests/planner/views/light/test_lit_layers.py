"""Layers in light from below and from a ring, and what is opaque under a target."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from microplan.featuresel.look.design import design
from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.scenario import build_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task
from microplan.planner.views.light.lit_layers import field_level, looks_bright
from microplan.planner.views.requests import Request, requests
from microplan.planner.views.scenes import world_scene
from microplan.planner.views.target_views import needed_shape, views
from microplan.planner.views.zooms import microscope_at

EXAMPLE = Path(__file__).parents[4] / "examples" / "gear_on_shaft" / "task.yaml"
FINISH, RADIUS_UM = 0.25, 1.5


@pytest.fixture(scope="module")
def front() -> Task:
    found = load_task(EXAMPLE, Report())
    assert found is not None
    return found


@pytest.fixture(scope="module")
def below(front: Task) -> Task:
    """Return the task over a lamp of half the lens' aperture, on a clear stage."""
    cell = front.workcell
    light = replace(cell.light, kind="transmitted", aperture=0.21)
    stage = replace(cell.stage, transmittance=0.8)
    return replace(front, workcell=replace(cell, light=light, stage=stage))


@pytest.fixture(scope="module")
def ringed(front: Task) -> Task:
    """Return the task under a ring of light, all bodies finished alike."""
    cell = front.workcell
    elevation = (math.radians(20), math.radians(45))
    tools = {
        name: replace(
            tool,
            surface=replace(
                tool.surface, finish=(FINISH, FINISH), stated=(False, True),
                edge_radius_um=RADIUS_UM,
            ),
        )
        for name, tool in cell.tools.items()
    }  # fmt: skip
    parts = {}
    for name, part in front.parts.items():
        surface = replace(
            part.surface, finish=(FINISH, FINISH), stated=(False, True),
            edge_radius_um=RADIUS_UM,
        )  # fmt: skip
        posts = {k: replace(post, surface=surface) for k, post in part.posts.items()}
        parts[name] = replace(part, surface=surface, posts=posts)
    cell = replace(
        cell,
        light=replace(cell.light, kind="ring", elevation_rad=elevation),
        stage=replace(cell.stage, finish=(0.0, 0.4)),
        tools=tools,
    )
    return replace(front, workcell=cell, parts=parts)


def look(task: Task, name: str) -> Request:
    states = unfold(task, Report())
    found = [r for i in range(len(states)) for r in requests(task, states, i, None)]
    return next(request for request in found if request.id == name)


def test_bodies_over_a_lamp_send_nothing_and_have_walls(below: Task) -> None:
    request = look(below, "find_gear")
    seen = world_scene(below, request.state)
    assert {layer.reflectance for layer in seen.layers} == {0.0}
    assert all(layer.underside_um is not None for layer in seen.layers if layer.z_um)
    assert seen.background == 0.8
    scope = microscope_at(below.workcell, 6.9)
    # half the aperture is a quarter of the pupil
    assert field_level(0.8, below.workcell, scope) == pytest.approx(0.2)
    view = views(below, request, 6.9, Report())[0]
    case, _ = build_case(below, request, view, 0.05)
    assert case.background == pytest.approx(0.2)
    assert case.microscope.cone_aperture == 0.21
    assert not case.target.bright
    # the bright field is kept below full scale in the worst light
    worst = 0.2 * 1.3 * (1 + 0.3 / 2)
    assert view.light == pytest.approx(min(1.0, 0.95 / worst))


def test_clear_bodies_say_so(below: Task) -> None:
    plate = below.parts["shaft_plate"]
    clear = replace(plate, surface=replace(plate.surface, transmittance=0.9))
    task = replace(below, parts={**below.parts, "shaft_plate": clear})
    layers = world_scene(task, look(task, "find_gear").state).layers
    found = {layer.name: layer.transmittance for layer in layers}
    assert found["shaft_plate"] == 0.9
    assert found["shaft_plate.post"] == found["gear"] == 0


def test_a_post_on_an_opaque_plate_cannot_be_seen_from_below(below: Task) -> None:
    report = Report()
    request = look(below, "find_shaft")
    assert views(below, request, 6.9, report) == ()
    assert {d.code for d in report.found if d.severity == "infeasible"} == {"MP407"}
    plate = below.parts["shaft_plate"]
    clear = replace(plate, surface=replace(plate.surface, transmittance=0.9))
    task = replace(below, parts={**below.parts, "shaft_plate": clear})
    report = Report()
    assert views(task, request, 6.9, report)
    assert "MP407" not in {d.code for d in report.found}


def test_faces_in_a_ring_send_their_dull_share_and_edges_a_line(ringed: Task) -> None:
    request = look(ringed, "find_gear")
    seen = world_scene(ringed, request.state)
    gear = next(layer for layer in seen.layers if layer.name == "gear")
    assert gear.reflectance == pytest.approx(0.8 * (1 - FINISH))
    assert seen.background == pytest.approx(0.1 * (1 - 0.2))
    line = gear.edge_line
    assert line is not None
    assert (line.radius_um, line.rings) == (RADIUS_UM, len(gear.outline.rings))
    spread = math.cos(math.radians(20)) ** 2 - math.cos(math.radians(45)) ** 2
    assert line.level == pytest.approx(0.8 * FINISH / spread)
    shape = needed_shape(ringed, request)
    assert looks_bright(ringed, shape) == shape.bright


def test_a_look_in_a_ring_has_its_lamp_and_trials_draw_its_lines(
    ringed: Task,
) -> None:
    request = look(ringed, "find_gear")
    view = views(ringed, request, 6.9, Report())[0]
    case, _ = build_case(ringed, request, view, 0.05)
    assert case.ring is not None
    assert case.treatment == "joint"
    drawn = [trial.line for trial in design(case, 200, 1)]
    assert 0 <= min(drawn) < 0.05
    assert 0.95 < max(drawn) <= 1
    front = replace(case, ring=None)
    assert {trial.line for trial in design(front, 20, 1)} == {0.5}


def test_front_light_changes_no_layer(front: Task) -> None:
    seen = world_scene(front, look(front, "find_gear").state)
    assert {(la.transmittance, la.edge_line) for la in seen.layers} == {(0.0, None)}
    assert {la.reflectance for la in seen.layers} == {0.8, 0.15, 0.75, 0.7}
