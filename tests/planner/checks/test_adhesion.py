"""Adhesion: magnitudes against published ones, intervals that behave, verdicts."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.checks.adhesion import (
    Face,
    forces,
    total,
    verdict,
    weight_un,
)
from planner.checks.handling import report_handling, verdicts_of
from planner.checks.releasing import release_verdict
from planner.diagnostics import Report
from planner.inputs.task import Environment, Task
from planner.model.steps import StepState, unfold
from schemas.verdicts import Force
from tests.planner.examples import EXAMPLE, change, copy_example, read

TIP = Face(area_um2=870.0)  # a tooth 8.7 um wide, 100 um high
CELL = Environment()


def named(face: Face, environment: Environment) -> dict[str, Force]:
    return {force.name: force for force in forces(face, environment)}


def released(task: Task) -> tuple[tuple[StepState, ...], StepState]:
    states = unfold(task, Report())
    return states, next(s for s in states if s.step.verb == "release")


def test_weights_are_those_of_solid_bodies() -> None:
    # a nickel annulus of 100 um over 50 um, 100 um thick: 51.5 nN
    volume = math.pi * (50.0**2 - 25.0**2) * 100.0
    low, high = weight_un("Nickel", volume)
    assert low == high == pytest.approx(51.5e-3, rel=3e-3)
    low, high = weight_un("unobtainium", volume)
    assert low < 51.5e-3 < high


def test_every_force_reaches_micronewtons_but_none_is_one_number() -> None:
    """0.05 to 20 uN for parts of this size, as surveys of sticking effects have it."""
    found = named(TIP, replace(CELL, grounded=False))
    assert set(found) == {
        "van der Waals", "capillary", "charge", "contact potential"
    }  # fmt: skip
    for force in found.values():
        assert 0.05 < force.most_un < 20.0
        assert force.least_un < force.most_un / 10
        assert force.validity


def test_forces_are_those_of_the_textbook() -> None:
    found = named(TIP, CELL)
    # one asperity of 20 nm, 0.5e-19 J: A R / 6 D**2 = 6.1 nN
    assert found["van der Waals"].least_un == pytest.approx(3 * 6.12e-3, rel=2e-3)
    # a body as wide as the face: 4 pi gamma R = 0.915 uN a um
    assert found["capillary"].most_un == pytest.approx(0.9148 * TIP.radius_um, rel=1e-3)
    # two plates 20 nm apart at 0.5 V: 2767 N/m2
    assert found["contact potential"].most_un == pytest.approx(2.407, rel=1e-3)
    charged = named(TIP, replace(CELL, grounded=False))["charge"]
    assert charged.most_un == pytest.approx(3984e-6 * 870.0, rel=1e-3)  # N/m2 is uN/um2


def test_what_is_ruled_out_is_nothing() -> None:
    assert named(TIP, replace(CELL, humidity=0.0))["capillary"].most_un == 0.0
    assert named(TIP, CELL)["charge"].most_un == 0.0  # grounded


@settings(max_examples=60, deadline=None)
@given(
    rough=st.floats(0.0, 1000.0), humid=st.floats(0, 1), area=st.floats(1e-6, 1e8),
    grounded=st.booleans(),
)  # fmt: skip
def test_intervals_are_finite_and_in_order(
    rough: float, humid: float, area: float, grounded: bool
) -> None:
    cell = Environment(humidity=humid, grounded=grounded, roughness_um=rough)
    found = forces(Face(area_um2=area), cell)
    for force in found:
        assert 0 <= force.least_un <= force.most_un < math.inf
    larger = total(forces(Face(area_um2=2 * area), cell))
    assert larger[1] >= total(found)[1]


@pytest.mark.parametrize(
    ("pull", "hold", "wanted"),
    [
        ((0.1, 1.0), (2.0, 3.0), "stays"),
        ((0.1, 1.0), (0.5, 3.0), "may stick"),
        ((4.0, 9.0), (0.5, 3.0), "will stick"),
        ((0.0, 0.0), (0.0, 0.0), "stays"),
        ((1.0, 2.0), (0.0, 0.0), "will stick"),
    ],
)
def test_only_intervals_apart_decide(
    pull: tuple[float, float], hold: tuple[float, float], wanted: str
) -> None:
    assert verdict(pull, hold) == wanted


def test_a_shaft_strips_the_part_and_a_look_verifies() -> None:
    task = read(EXAMPLE / "task.yaml")
    states, here = released(task)
    found = release_verdict(task, states, here)
    assert found.verdict == "stays"
    assert "shaft" in found.reason
    assert found.verified_by == "check_seated"
    assert found.weight_un[0] == pytest.approx(44.6e-3, rel=0.02)
    assert found.ladder[0].action == "open to 130 um"
    assert found.ladder[1].action == "look"
    assert found.ladder[-1].action.startswith("stop")


def test_a_part_on_the_open_stage_may_stick(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    text = file.read_text(encoding="utf-8")
    start, end = text.index("  - {id: lift,"), text.index("  - {id: release,")
    file.write_text(text[:start] + text[end:], encoding="utf-8")
    task = read(file)
    states, here = released(task)
    found = release_verdict(task, states, here)
    assert found.verdict == "may stick"
    assert "uN" in found.reason
    report = Report()
    report_handling(here, None, found, report)
    assert [(d.code, d.severity) for d in report.found] == [("MP613", "note")]


def test_without_friction_it_follows_the_finger(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    text = file.read_text(encoding="utf-8")
    start, end = text.index("  - {id: lift,"), text.index("  - {id: release,")
    file.write_text(text[:start] + text[end:], encoding="utf-8")
    change(file, "friction: 0.3", "friction: 0")
    task = read(file)
    states, here = released(task)
    found = verdicts_of(task, states, here)
    assert found.release is not None
    assert found.release.verdict == "will stick"
    report = Report()
    report_handling(here, found.grasp, found.release, report)
    assert [(d.code, d.severity) for d in report.found] == [("MP613", "infeasible")]


def test_only_steps_that_need_it_have_it_worked_out() -> None:
    task = read(EXAMPLE / "task.yaml")
    states = unfold(task, Report())
    found = {s.step.verb: verdicts_of(task, states, s) for s in states}
    for verb, each in found.items():
        assert (each.fit is not None) is (verb == "insert")
        assert (each.grasp is not None) is (verb == "grasp")
        assert (each.release is not None) is (verb == "release")
