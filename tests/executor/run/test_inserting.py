"""An insertion that something is in the way of goes back; no other fault does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from microplan.executor.run.artifacts import Artifacts
from microplan.schemas.plan import AxisMove, InsertAction, Plan
from tests.executor.bench import plan_of, quiet, stage_to, step, world
from tests.executor.recorder import Run, run

DOWN = stage_to(z_um=-150.0)
UNDER = stage_to(x_um=-530.0, y_um=0.0)  # the gear comes under the right finger
UP = stage_to(z_um=0.0, speed_um_per_s=20.0)
BACK = (DOWN, stage_to(x_um=-600.0, y_um=-180.0), stage_to(z_um=0.0))


def plan(*, retreat: Sequence[AxisMove] = BACK) -> Plan:
    """Return a plan whose last move would bring the gear up into a finger.

    Nothing is held: what is tested are moves.
    """
    raised = step(
        "up",
        InsertAction(
            target="gear.bore", onto="shaft_plate.post", moves=(DOWN, UNDER, UP)
        ),
        moves=(
            stage_to(y_um=-180.0),
            AxisMove(axes="robot", x_um=0.0, y_um=0.0),
            AxisMove(axes="robot", z_um=30.0),
        ),
    )
    conditions = replace(raised.conditions, retreat=tuple(retreat))
    return plan_of([replace(raised, conditions=conditions)])


def go(made: Plan, *faults: str) -> Run:
    return run(made, Artifacts({}), quiet(world()), faults)


def stands(found: Run) -> tuple[float, float, float]:
    reading = found.cell.stage.reading()
    return reading.x_um, reading.y_um, reading.z_um


def named(found: Run, name: str) -> int:
    return sum(event["event"] == name for event in found.events)


def test_a_move_that_is_in_the_way_is_gone_back_from() -> None:
    found = go(plan())
    assert found.result.code == "MP836"
    assert "went back" in found.result.message
    assert stands(found) == (-600.0, -180.0, 0.0)
    assert named(found, "retreat") == 1
    assert not found.cell.truth.collided
    assert all(c.device != "jaws" or c.method == "stop" for c in found.recorder.calls)


def test_without_a_way_back_everything_stays() -> None:
    found = go(plan(retreat=()))
    assert found.result.code == "MP836"
    assert stands(found) == (-530.0, 0.0, -150.0)


def test_a_blocked_way_back_is_told_and_not_tried() -> None:
    found = go(plan(retreat=(DOWN, stage_to(z_um=0.0), BACK[1])))
    assert found.result.code == "MP836"
    assert "way back is blocked" in found.result.message
    assert stands(found) == (-530.0, 0.0, -150.0)


@pytest.mark.parametrize("fault", ["axis_stalls@up", "axis_nan@up", "axis_short@up"])
def test_after_a_fault_of_the_machine_nothing_goes_back(fault: str) -> None:
    found = go(plan(), fault)
    assert found.result.code in ("MP845", "MP846", "MP847")
    assert named(found, "retreat") == 0
    assert found.events[-2]["event"] == "failed"
