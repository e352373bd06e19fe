"""What ends a whole run when two things go wrong at once."""

from __future__ import annotations

import errno
import hashlib
import io
import os
from dataclasses import replace
from pathlib import Path

import pytest

from microplan.executor.cli.options import parse
from microplan.executor.cli.select_station import Site
from microplan.executor.cli.session import Asking, RunJob, _recorded, _run, header_of
from microplan.executor.devices.device_values import CheckedClock
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.station import Station
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.record.frames import Frames
from microplan.executor.record.plan_file import PlanFile
from microplan.executor.record.recording import CallRecorder
from microplan.executor.record.run_folder import RunFolder
from microplan.executor.record.write_ahead_log import Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.run import run_plan
from microplan.executor.run.run_context import Rig
from microplan.executor.simulated.cell import build_cell
from microplan.schemas.plan import MoveAction
from tests.executor.bench import plan_of, stage_to, step, world


class Full(io.StringIO):
    """A log whose disk is full for lines with some words."""

    def __init__(self, words: str) -> None:
        super().__init__()
        self._words = words

    def write(self, text: str) -> int:
        if self._words in text:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(text)


class Runaway:
    """A stage that cannot be stopped."""

    def __init__(self, station: Station) -> None:
        self._stage = station.stage

    def __getattr__(self, name: str) -> object:
        return getattr(self._stage, name)

    def stop(self) -> None:
        raise OSError("cable")


def test_what_could_not_be_stopped_is_told_on_a_full_disk_too(tmp_path: Path) -> None:
    station = build_cell(world(), 0).station
    station = replace(station, stage=Runaway(station))  # type: ignore[arg-type]
    plan = plan_of([step("away", MoveAction(), moves=(stage_to(),))])
    rig = Rig(
        plan=plan,
        station=station,
        beliefs=Beliefs(plan.beliefs, plan.features),
        artifacts=Artifacts({}),
        journal=Journal(Full('"stopped"'), station.clock),
        frames=Frames(None),
    )

    def interrupt(_step: str) -> None:
        raise KeyboardInterrupt

    rig.on_step = interrupt
    job = RunJob(
        options=parse([str(tmp_path), "--station", "sim"]),
        file=PlanFile(plan=plan, source=b""),
        site=Site(name="sim", station=station, cell=None),
        artifacts=Artifacts({}),
        run=RunFolder(path=tmp_path, found=None),
    )
    with pytest.raises(ExecutorError, match=r"stopped; stage\.stop: OSError") as caught:
        _run(rig, job, Asking())
    assert caught.value.code == "MP860"


class Dying:
    """A clock that answers until its controller is gone."""

    def __init__(self, station: Station) -> None:
        self._clock = station.clock
        self.gone = False

    def now_s(self) -> float:
        if self.gone:
            raise OSError("cable")
        return self._clock.now_s()

    def wait(self, seconds: float) -> None:
        self._clock.wait(seconds)


class Last:
    """A stage that takes the clock with it when it fails, or when it has arrived."""

    def __init__(self, station: Station, clock: Dying, *, fails: bool) -> None:
        self._stage, self._clock, self._fails = station.stage, clock, fails

    def __getattr__(self, name: str) -> object:
        return getattr(self._stage, name)

    def start(self, **targets: float) -> None:
        if self._fails:
            self._clock.gone = True
            raise OSError("cable")
        self._stage.start(**targets)


@pytest.mark.parametrize("fails", [True, False])
def test_a_clock_that_fails_hides_no_fault_and_no_step(fails: bool) -> None:
    station = build_cell(world(), 0).station
    clock = Dying(station)
    stage = Last(station, clock, fails=fails)
    station = replace(
        station,
        stage=stage,  # type: ignore[arg-type]
        clock=CheckedClock(clock),
    )
    plan = plan_of(
        [step(name, MoveAction(), moves=(stage_to(),)) for name in ("away", "on")]
    )
    rig = Rig(
        plan=plan,
        station=station,
        beliefs=Beliefs(plan.beliefs, plan.features),
        artifacts=Artifacts({}),
        journal=Journal(io.StringIO(), station.clock),
        frames=Frames(None),
    )

    def end_clock(name: str) -> None:
        clock.gone = clock.gone or (name == "on" and not fails)

    rig.on_step = end_clock
    result = run_plan(rig)
    if fails:
        assert [(s.id, s.code) for s in result.steps] == [("away", "MP841")]
        assert "stage" in result.message
        assert result.time_s == 0.0
    else:  # it fails between two steps: the first is told
        assert [(s.id, s.code) for s in result.steps] == [
            ("away", None), ("on", "MP841"),
        ]  # fmt: skip
        assert "clock" in result.message
        assert result.time_s == result.steps[0].time_s


def test_a_run_is_begun_with_the_station_file_as_it_was_read(tmp_path: Path) -> None:
    file = tmp_path / "station.toml"
    file.write_bytes(b"another by now")
    call = parse([str(tmp_path), "--station", str(file)])
    plan = PlanFile(plan=plan_of([]), source=b"")
    made = header_of(call, plan, {}, b"as it was read").station
    assert made == hashlib.sha256(b"as it was read").hexdigest()
    assert header_of(call, plan, {}).station != made


def test_a_full_disk_hides_no_interrupt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_record: CallRecorder, _code: str, _why: str) -> None:
        raise ExecutorError("MP863", "calls.jsonl: the disk is full")

    station = build_cell(world(), 0).station
    monkeypatch.setattr(CallRecorder, "close", full)
    with (
        pytest.raises(ExecutorError) as caught,
        _recorded(tmp_path / "calls.jsonl", Frames(tmp_path), station, {}),
    ):
        raise ExecutorError("MP860", "stopped")
    assert caught.value.code == "MP860"
