"""What ends a whole run when two things go wrong at once."""

from __future__ import annotations

import errno
import io
import os
from dataclasses import replace
from pathlib import Path

import pytest

from executor.artifacts import Artifacts
from executor.asked import parse
from executor.beliefs import Beliefs
from executor.errors import ExecutorError
from executor.frames import Frames
from executor.journal import Journal
from executor.plan_file import PlanFile
from executor.recording import Record
from executor.rig import Rig
from executor.run_folder import RunFolder
from executor.simulated.cell import build_cell
from executor.station import Station
from executor.whole_run import Asking, _recorded, _run
from schemas.plan import MoveAction
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
    with pytest.raises(ExecutorError, match=r"stopped; stage\.stop: OSError") as caught:
        _run(
            rig,
            parse([str(tmp_path), "--station", "sim"]),
            PlanFile(plan=plan, source=b""),
            RunFolder(path=tmp_path, found=None),
            Asking(),
        )
    assert caught.value.code == "MP860"


def test_a_full_disk_hides_no_interrupt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_record: Record, _code: str, _why: str) -> None:
        raise ExecutorError("MP863", "calls.jsonl: the disk is full")

    station = build_cell(world(), 0).station
    monkeypatch.setattr(Record, "close", full)
    with (
        pytest.raises(ExecutorError) as caught,
        _recorded(tmp_path / "calls.jsonl", Frames(tmp_path), station, {}),
    ):
        raise ExecutorError("MP860", "stopped")
    assert caught.value.code == "MP860"
