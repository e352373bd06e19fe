"""Which looks have walls and faces that are not known, and which ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from microplan.featuresel.look.scenario import LookCase
from microplan.planner.assembly.assembly import bodies
from microplan.planner.looks.scenario import build_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.views.fit_angles import unfold_with_angles
from microplan.planner.views.light.unknown_walls import unknown_surfaces
from microplan.planner.views.requests import requests
from microplan.planner.views.target_views import views

EXAMPLE = Path(__file__).parents[4] / "examples" / "gear_on_shaft" / "task.yaml"
COARSE = 0.5  # of full scale, that an image may err by here: it is not rendered


def looks(*names: str) -> dict[str, LookCase]:
    """Return some of the example's looks."""
    task = load_task(EXAMPLE, Report())
    assert task is not None
    task, states = unfold_with_angles(task, Report())
    found = {}
    for index in range(len(states)):
        for request in requests(task, states, index, None):
            if request.id in names:
                view = views(task, request, 6.9, Report())[0]
                case, _ = build_case(task, request, view, COARSE)
                ground = bodies(task, request.state)
                tools = task.workcell.tools
                assert case.surfaces == unknown_surfaces(case, ground, tools)
                found[request.id] = case
    return found


def test_walls_are_unknown_where_a_thick_body_is_by_the_line_of_sight() -> None:
    names = ("find_gear", "see_fingers", "check_seated.seat", "check_seated.target")
    cases = looks(*names)
    assert cases["find_gear"].surfaces == ()  # its own walls shift no ring of teeth
    jaws = {s.body for s in cases["see_fingers"].surfaces if "tweezers" in s.layer}
    assert jaws == {"tweezers"}  # of one surface
    seat = {s.layer: s for s in cases["check_seated.seat"].surfaces}
    assert set(seat) == {"gear", "shaft_plate", "shaft_plate.post"}
    assert seat["gear"].underside_um == 0.0
    assert seat["gear"].wall == (0.0, 0.88)  # nickel
    assert seat["gear"].finish == (0.0, 1.0)
    assert seat["shaft_plate"].underside_um is None  # it has no thickness
    assert cases["check_seated.target"].surfaces
    below = cases["check_seated.target"]
    clear = tuple(replace(layer, transmittance=0.5) for layer in below.static)
    assert unknown_surfaces(replace(below, static=clear), ()) == ()
