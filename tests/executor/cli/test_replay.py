"""A run on its own record gives the same commands, and a change in it is told."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from microplan.executor.cli.main import main
from microplan.executor.cli.replay import Replayed, replay
from microplan.executor.devices.drivers import Clock
from microplan.executor.devices.station import Offer, Station
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.record.frames import Frames, read_png, write_png
from microplan.executor.record.plan_file import PlanFile
from microplan.executor.record.recorded_calls import CallReplay, read_record
from microplan.executor.record.recording import CallRecorder, plain
from microplan.executor.record.replay_station import replay_station
from microplan.executor.record.write_ahead_log import FileStore, Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.run import run_plan
from microplan.executor.run.run_context import Rig
from microplan.executor.simulated.cell import build_cell
from microplan.executor.simulated.hub import read_world
from microplan.schemas.codec import from_data
from microplan.schemas.plan import Plan, dump_plan, parse_plan
from tests.executor.bench import QUICK, Folder, assembly, world

# steps up to the first alignment: two looks to locate, one alignment by corrections
FIRST = 3


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a plan folder of the first steps of the job."""
    folder = tmp_path_factory.mktemp("plans") / "gear.plan"
    maker, found = Folder(folder), world()
    plan = assembly(maker)
    parts = tuple(replace(p, sigma_xy_um=min(p.sigma_xy_um, 8.0)) for p in found.parts)
    maker.write(replace(plan, steps=plan.steps[:FIRST]), replace(found, parts=parts))
    return folder


@pytest.fixture(scope="module")
def ran(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run on the simulated cell."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    call = [
        str(built),
        *QUICK,
        "--seed",
        "4",
        "--run-dir",
        str(folder),
    ]
    with contextlib.redirect_stdout(io.StringIO()):
        assert main(call) == 0
    return folder


def again(plan: Path, run: Path, *options: str) -> int:
    return main([str(plan), "--mode", "replay", "--from", str(run), *options])


def copied(run: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(run, tmp_path / "copy"))


def changed(built: Path, tmp_path: Path, **control: float) -> Path:
    """Return a copy of the plan folder with another control of the alignment."""
    copy = Path(shutil.copytree(built, tmp_path / "other.plan"))
    plan = parse_plan((copy / "plan.json").read_text("utf-8"))
    steps = tuple(
        replace(s, control=replace(s.control, **control)) if s.control else s  # type: ignore[arg-type]  # floats by name
        for s in plan.steps
    )
    (copy / "plan.json").write_text(dump_plan(replace(plan, steps=steps)), "utf-8")
    return copy


def rows(run: Path, name: str = "calls.jsonl") -> list[dict[str, Any]]:
    return [json.loads(x) for x in (run / name).read_text("utf-8").split("\n") if x]


def rewrite(run: Path, lines: list[dict[str, Any]], name: str = "calls.jsonl") -> None:
    text = "".join(json.dumps(line) + "\n" for line in lines)
    (run / name).write_text(text, "utf-8")


def test_a_run_on_its_own_record_gives_the_same_commands(
    built: Path, ran: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [r for r in rows(ran) if "with" in r]
    assert again(built, ran) == 0
    out = capsys.readouterr().out
    assert f"{len(given)} of {len(given)} commands are the same" in out
    assert len(given) > 10


def test_the_record_is_at_full_precision(ran: Path) -> None:
    moves = [r["with"] for r in rows(ran) if r.get("call") == "stage.start"]
    digits = max(len(repr(v)) for move in moves for v in move.values() if v)
    assert digits > 12  # six in the log
    exact = [r["gave"] for r in rows(ran) if r.get("call") == "stage.reading"]
    assert any(float(f"{v:.6g}") != v for reading in exact for v in reading)


def test_another_plan_is_refused_and_its_first_other_command_told(
    built: Path, ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = changed(built, tmp_path, gain=0.5, tolerance_xy_um=0.05)
    assert again(other, ran) == 2
    assert "error[MP877]: the record is of another plan" in capsys.readouterr().err
    assert again(other, ran, "--anyway") == 1
    heard = capsys.readouterr()
    assert "error[MP876]: command" in heard.err
    assert "recorded was" in heard.err or "record has no more" in heard.err
    assert "commands are the same" in heard.out


def test_a_changed_frame_is_refused_and_changes_the_commands(
    built: Path, ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = copied(ran, tmp_path)
    # a whole picture later by three pixels is the part 3.26 um to the right
    path = run / "frames" / "01_find_gear_001.png"
    write_png(path, np.roll(read_png(path), 3, axis=1))
    assert again(built, run) == 2
    assert "not the frame that was recorded" in capsys.readouterr().err
    assert again(built, run, "--anyway") == 1
    said = capsys.readouterr().err
    assert "error[MP876]" in said
    now, before = (
        float(said.partition(mark)[2].split()[0].rstrip(","))
        for mark in (" = ", "was ")
    )
    # the first move that goes by what was seen; the image goes with the stage
    assert before - now == pytest.approx(3 * 7.5 / 6.9, abs=0.2)


def test_a_frame_that_is_missing_or_damaged_has_a_code(
    built: Path, ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = copied(ran, tmp_path)
    path = sorted((run / "frames").glob("*.png"))[1]
    path.write_bytes(path.read_bytes()[:2000])
    assert again(built, run) == 2
    assert f"error[MP877]: {path}" in capsys.readouterr().err
    path.unlink()
    assert again(built, run, "--anyway") == 2
    assert "No such file" in capsys.readouterr().err


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: "",
        lambda text: "{}\n",
        lambda text: text.replace('"microplan_record":1', '"microplan_record":2'),
        lambda text: text.replace('"n":9,', '"n":"nine",'),
        lambda text: text.replace('"jaws_window_um":0.5', '"jaws_window_um":""'),
        lambda text: text.replace('"width_px":640', '"width_px":null'),
        lambda text: text.replace('"camera.grab"', '"camera.grab', 1),
        lambda text: text.replace('"frame":"frames/', '"frame":"../frames/'),
        lambda text: text.replace('"ended":null', '"ended":5'),
        lambda text: "[" * 100_000 + "\n",
    ],
)  # fmt: skip
def test_a_record_that_cannot_be_understood_is_refused(
    spoil: Any,
    built: Path,
    ran: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = copied(ran, tmp_path)
    file = run / "calls.jsonl"
    file.write_text(spoil(file.read_text("utf-8")), "utf-8")
    assert again(built, run) == 2
    assert "error[MP877]" in capsys.readouterr().err


def test_a_run_that_broke_off_is_replayed_as_far_as_its_record_goes(
    built: Path, ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = copied(ran, tmp_path)
    text = (run / "calls.jsonl").read_text("utf-8")
    (run / "calls.jsonl").write_text(text[: len(text) // 2], "utf-8")
    assert again(built, run) == 0
    assert "the record breaks off there" in capsys.readouterr().out


@pytest.fixture(scope="module")
def resumed(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run that three executors worked on, two of them ended.

    The first in an approach of the alignment, the second after its first look.
    """
    folder = tmp_path_factory.mktemp("runs") / "run"
    words = [
        str(built),
        *QUICK,
        "--run-dir",
        str(folder),
    ]
    ends = ['"name": "approach 2"', '"kind": "known"']
    with contextlib.redirect_stdout(io.StringIO()):
        assert ended_at(ends[0], [*words, "--seed", "4"]) == 4
        assert ended_at(ends[1], [*words, "--resume"]) == 4
        assert main([*words, "--resume"]) == 0
    return folder


def ended_at(text: str, words: list[str]) -> int:
    """Return how a run ends that is told to when its journal has a line with `text`."""
    append = FileStore.append

    def tell(self: FileStore, line: bytes) -> None:
        append(self, line)
        if text.encode() in line:
            os.kill(os.getpid(), signal.SIGTERM)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FileStore, "append", tell)
        return main(words)


def test_whoever_resumed_a_run_is_replayed_too(
    built: Path, resumed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ["calls.jsonl", "calls-2.jsonl", "calls-3.jsonl"]
    for name in names:
        assert sum("with" in row for row in rows(resumed, name)) > 0  # it did something
    assert again(built, resumed) == 0
    told = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in told] == [n for n in names for _ in "12"]
    for name, line in zip(names, told[::2], strict=True):
        given = sum("with" in row for row in rows(resumed, name))
        assert line == f"{name}: {given} of {given} commands are the same"
    assert [line.partition("replayed, ")[2] for line in told[1::2]] == [
        "the record breaks off there", "the record breaks off there", "done",
    ]  # fmt: skip


def test_a_resumed_run_that_parts_says_where(
    built: Path, resumed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = copied(resumed, tmp_path)
    path = sorted((run / "frames").glob("*_by3.png"))[0]
    write_png(path, np.roll(read_png(path), 4, axis=1))
    assert again(built, run, "--anyway") == 1
    heard = capsys.readouterr()
    assert "error[MP876]: calls-3.jsonl: command" in heard.err
    assert heard.out.count("are the same") == 3


def test_a_refused_resumption_is_replayed_as_one(
    built: Path, resumed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = copied(resumed, tmp_path)
    (run / "calls-3.jsonl").unlink()
    lines = rows(run, "calls-2.jsonl")
    first = next(k for k, row in enumerate(lines) if "with" in row)
    for row in lines[:first]:
        if row.get("call") == "stage.reading":
            row["gave"][0] += 50.0  # somebody moved the stage meanwhile
    end = {"ended": "MP865", "why": ""}
    rewrite(run, [*lines[:first], end], "calls-2.jsonl")
    assert again(built, run) == 0
    assert "calls-2.jsonl: gear-on-shaft: replayed, MP865" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda run: (run / "journal.jsonl").unlink(), "No such file"),
        (lambda run: (run / "journal.jsonl").write_text(""), "has 0 lines"),
        (lambda run: told_lines(run, None), "does not say from where"),
        (lambda run: told_lines(run, True), "does not say from where"),
        (lambda run: told_lines(run, "12"), "does not say from where"),
        (lambda run: told_lines(run, 10**9), "was resumed from 1000000000"),
    ],
)
def test_a_resumed_run_without_its_journal_is_refused(
    spoil: Any,
    why: str,
    built: Path,
    resumed: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = copied(resumed, tmp_path)
    spoil(run)
    assert again(built, run) == 2
    said = capsys.readouterr().err
    assert "error[MP877]" in said
    assert why in said


def told_lines(run: Path, count: Any) -> None:
    """Have the second executor tell another place from which it resumed the run."""
    lines = rows(run, "calls-2.jsonl")
    rewrite(run, [{**lines[0], "journal_lines": count}, *lines[1:]], "calls-2.jsonl")


def test_a_command_that_was_not_given_again_is_told(
    built: Path, ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = copied(ran, tmp_path)
    lines = rows(run)
    last = lines[-1]
    more = {"n": 10**6, "call": "light.set_level", "with": {"value": 0.5}, "gave": None}
    rewrite(run, [*lines[:-1], more, last])
    assert again(built, run) == 1
    assert "none any more, recorded was light.set_level" in capsys.readouterr().err
    rewrite(run, [*lines[:-1], {**last, "ended": "MP850"}])
    assert again(built, run) == 1
    assert "the run ends in done, recorded was MP850" in capsys.readouterr().err


@pytest.mark.parametrize(
    "fault",
    ["no_part", "dropped_frames", "axis_nan@fingers_in", "axis_raises@fingers_in",
     "short_frames", "camera_raises"],
)  # fmt: skip
def test_a_run_that_failed_fails_again_in_the_same_way(
    built: Path, tmp_path: Path, fault: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    call = [
        str(built),
        *QUICK,
        "--run-dir",
        str(run),
        "--inject",
        fault,
    ]
    assert main(call) in (1, 3)
    capsys.readouterr()
    assert again(built, run) == 0
    code = json.loads((run / "summary.json").read_text("utf-8"))["code"]
    assert f"replayed, {code}" in capsys.readouterr().out


def test_a_disk_that_fills_by_frames_is_no_other_command(
    built: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run, kept = tmp_path / "run", list[Path]()

    def fill(path: Path, counts: Any) -> None:
        if len(kept) == 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write_png(path, counts)
        kept.append(path)

    with monkeypatch.context() as full:
        full.setattr("microplan.executor.record.frames.write_png", fill)
        call = [
            str(built),
            *QUICK,
            "--run-dir",
            str(run),
        ]
        assert main(call) == 3
    assert "error[MP863]" in capsys.readouterr().err
    assert not any(row.get("hung") for row in rows(run))
    assert again(built, run) == 0
    assert "the record breaks off there" in capsys.readouterr().out


def test_a_device_that_did_not_answer_does_not_answer_again(
    built: Path, tmp_path: Path
) -> None:
    plan = parse_plan((built / "plan.json").read_text("utf-8"))
    cell = build_cell(world(), 0, ("lens_hangs",))
    rules = cell.station.rules
    soon = replace(rules, safety=replace(rules.safety, call_s=0.2))
    found = recorded(plan, built, tmp_path / "run", replace(cell.station, rules=soon))
    assert found.result.code == "MP844"
    assert not found.difference


class Creeping:
    """A clock that goes on between any two questions, as a real one does."""

    def __init__(self, clock: Clock) -> None:
        self._clock, self._asked = clock, 0

    def now_s(self) -> float:
        """Return the time, some microseconds later than it would be."""
        self._asked += 1
        return self._clock.now_s() + 1.7e-5 * self._asked

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self._clock.wait(seconds)


def test_a_run_by_a_real_clock_is_replayed_to_the_same_commands(
    built: Path, tmp_path: Path
) -> None:
    plan = parse_plan((built / "plan.json").read_text("utf-8"))
    station = build_cell(read_world(built / "world.json"), 1).station
    station = replace(station, clock=Creeping(station.clock))
    found = recorded(plan, built, tmp_path / "run", station)
    assert found.difference == ""
    assert found.result.code is None
    assert found.same == found.commands > 10
    assert found.apart == 0  # the same machine, the same numbers


def recorded(plan: Plan, folder: Path, run: Path, station: Station) -> Replayed:
    """Run a plan on a station; return the replay of its record."""
    artifacts = Artifacts.from_folder(plan, folder)
    run.mkdir()
    file = PlanFile(plan=plan, source=b"")
    facts = {"plan_sha256": file.sha256, "arrays_sha256": artifacts.sha256}
    frames = Frames(run)
    with (run / "calls.jsonl").open("w", encoding="utf-8") as stream:
        record = CallRecorder(stream, frames, station, facts)
        rig = Rig(
            plan=plan,
            station=record.station(),
            beliefs=Beliefs(plan.beliefs, plan.features),
            artifacts=artifacts,
            journal=Journal(io.StringIO(), station.clock),
            frames=frames,
        )
        rig.standing()  # as the journal of a run begins
        record.close(run_plan(rig).code)
    return replay(file, artifacts, read_record(run / "calls.jsonl"))


def test_the_offer_comes_back_as_it_was() -> None:
    offer = build_cell(world(), 0).station.offer
    back = from_data(Offer, json.loads(json.dumps(plain(offer))))
    assert replace(back, travel=dict(back.travel)) == replace(
        offer, travel=dict(offer.travel)
    )


def test_the_rules_of_a_replay_are_those_of_the_run(built: Path, ran: Path) -> None:
    station = replay_station(CallReplay(read_record(ran / "calls.jsonl")))
    cell = build_cell(read_world(built / "world.json"), 0)
    assert station.rules == cell.station.rules


def test_waiting_ends_where_the_record_says_no_more(ran: Path) -> None:
    clock = replay_station(CallReplay(read_record(ran / "calls.jsonl"))).clock
    times = [clock.now_s() for _ in range(50)]
    assert times == sorted(times)
    clock.wait(20.0)
    assert clock.now_s() >= times[-1] + 20.0
