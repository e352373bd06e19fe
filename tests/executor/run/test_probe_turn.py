"""The probe of an angle: which way and how far the axes turn what is seen."""

from __future__ import annotations

import io
import json
import math
from dataclasses import replace
from typing import Any

import pytest

from microplan.executor.devices.drivers import AxisReading
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.record.frames import Frames
from microplan.executor.record.write_ahead_log import Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.image_jacobian import check_turn
from microplan.executor.run.probe import look_probed
from microplan.executor.run.run_context import Rig
from microplan.executor.simulated.axes import SimAxes
from microplan.executor.simulated.cell import build_cell
from microplan.schemas.plan import AlignAction, LocateAction, Plan
from tests.executor.bench import Folder, Seen, control, plan_of, quiet, step, world

ALONE = Seen(gear=(0, 0, 0), plate=(-600, 0, 0), opening_um=None)


class Reversed:
    """The simulated stage, its angle wired the wrong way round and read as told."""

    def __init__(self, stage: SimAxes) -> None:
        self._stage = stage

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stage, name)

    def start(self, *, theta_rad: float | None = None, **others: float | None) -> None:
        """Begin to go."""
        turned = None if theta_rad is None else -theta_rad
        self._stage.start(theta_rad=turned, **others)

    def reading(self) -> AxisReading:
        """Return the readings."""
        found = self._stage.reading()
        return replace(found, theta_rad=-found.theta_rad)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Artifacts]:
    """Return a plan that finds the gear and aligns it, its angle too."""
    folder = Folder(tmp_path_factory.mktemp("turn") / "gear.plan")
    found = folder.look(
        "find", "gear", ALONE, focus_um=100.0, chain=("circle_caliper", "tooth_notch")
    )
    align = AlignAction(
        target="gear", to="tweezers.grip", look="find", axes="stage", path=("xy",)
    )
    plan = plan_of(
        (
            step("find", LocateAction(target="gear", look="find"), looks=(found,)),
            step(
                "turn", align, looks=(found,), servo=control(tolerance_theta_rad=0.01)
            ),
        )
    )
    return plan, Artifacts.from_folder(plan, folder.folder)


def probed(made: tuple[Plan, Artifacts], *, backwards: bool) -> list[dict[str, Any]]:
    """Look at the gear, probe, and return what was noted."""
    plan, artifacts = made
    cell, stream = build_cell(quiet(world()), 0), io.StringIO()
    # turned about a point near the gear, so that little room is swept
    warm_start = replace(plan.requirements, theta_axis_um=(600.0, 0.0))
    stage = Reversed(cell.stage) if backwards else cell.stage
    cell.truth.world = replace(cell.truth.world, stage_theta_axis_um=(600.0, 0.0))
    rig = Rig(
        plan=replace(plan, requirements=warm_start),
        station=replace(cell.station, stage=stage),
        beliefs=Beliefs(plan.beliefs, plan.features),
        artifacts=artifacts,
        journal=Journal(stream, cell.station.clock),
        frames=Frames(None),
    )
    look_probed(rig, plan.steps[0].looks[0])
    assert cell.stage.reading().theta_rad == 0.0
    return [json.loads(line) for line in stream.getvalue().splitlines()]


def test_a_right_angle_passes_and_is_turned_back(made: tuple[Plan, Artifacts]) -> None:
    events = probed(made, backwards=False)
    (turn,) = [e for e in events if e["event"] == "probe_turn"]
    assert turn["seen"] == pytest.approx(turn["told"], abs=2e-3)


def test_a_reversed_angle_is_refused(made: tuple[Plan, Artifacts]) -> None:
    with pytest.raises(ExecutorError, match="the other way") as refused:
        probed(made, backwards=True)
    assert refused.value.code == "MP833"


def test_a_turn_is_held_to_two_per_cent_and_the_looks_sigma(
    made: tuple[Plan, Artifacts],
) -> None:
    look, told = made[0].steps[0].looks[0], math.radians(5)
    for seen in (told, 1.019 * told, 0.981 * told, told + 4.4e-3):
        check_turn(told, seen, 1e-3, look)
    for seen in (-told, 1.08 * told, 0.9 * told, told + 6.5e-3, math.nan):
        with pytest.raises(ExecutorError):
            check_turn(told, seen, 1e-3, look)
