"""Runs that are killed, resumed, refused and thrown away, through the command."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from microplan.executor.cli.main import main
from microplan.executor.devices.errors import CODES
from microplan.executor.record.run_folder import held
from microplan.executor.record.write_ahead_log import FileStore
from tests.executor.bench import QUICK, Folder, assembly, world
from tests.executor.cli.test_main import STATION, events, summary

pytestmark = pytest.mark.usefixtures("one_render_a_state")

# the command, killed when a line of its journal is on the disk
KILLED = """
import os, signal, sys
from microplan.executor.cli.main import main
from microplan.executor.record.write_ahead_log import FileStore
words, append = sys.argv[2:], FileStore.append
def die(self, line):
    append(self, line)
    if sys.argv[1].encode() in line:
        os.kill(os.getpid(), signal.SIGKILL)
FileStore.append = die
sys.exit(main(words))
"""
INSERTING = '"name": "insert 1", "device"'  # the intent of the insertion


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a plan folder of the whole job; the gear lies near its place."""
    folder = tmp_path_factory.mktemp("plans") / "gear.plan"
    maker, found = Folder(folder), world()
    parts = tuple(replace(p, sigma_xy_um=min(p.sigma_xy_um, 8.0)) for p in found.parts)
    maker.write(assembly(maker), replace(found, parts=parts))
    return folder


def killed_at(plan: Path, folder: Path, text: str, station: str = "sim") -> None:
    """Run a plan in a process of its own that is killed at a line with `text`."""
    words = [str(plan), "--station", station, "--run-dir", str(folder), "--no-frames"]
    seed = ["--seed", "3", "--camera", "quick"] if station == "sim" else []
    call = [sys.executable, "-c", KILLED, text, *words, *seed]
    ended = subprocess.run(call, capture_output=True, text=True, check=False)
    assert ended.returncode == -signal.SIGKILL, ended.stderr


@pytest.fixture(scope="module")
def left(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the run folder of a run that was killed as the insertion was to begin."""
    folder = tmp_path_factory.mktemp("killed") / "run"
    killed_at(built, folder, INSERTING)
    return folder


@pytest.fixture
def copy(left: Path, tmp_path: Path) -> Path:
    """Return a copy of that run folder."""
    return Path(shutil.copytree(left, tmp_path / "run"))


def run(plan: Path, folder: Path, *options: str, station: str = "sim") -> int:
    seen = (
        ["--camera", "quick"] if station == "sim" and "--camera" not in options else []
    )
    words = ["--station", station, "--run-dir", str(folder), "--no-frames", *options]
    return main([str(plan), *words, *seen])


def code_of(heard: pytest.CaptureFixture[str], status: int) -> str:
    """Return the code of the one finding that was printed."""
    err = heard.readouterr().err
    (line,) = [text for text in err.splitlines() if text.startswith("error[")]
    code = line[6:11]
    assert CODES[code][1] == status
    return code


def test_a_killed_run_is_taken_up_and_ends_seated(
    built: Path, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert [e["event"] for e in events(copy)][-1] == "move"
    assert run(built, copy, "--resume") == 0
    found = summary(copy)
    assert found["done"]
    assert found["seed"] == 3
    assert found["idle_faults"] is None  # of the executor before nothing is known
    assert found["cell_verdict"]["success"]
    assert [step["id"] for step in found["steps"]][:2] == ["find_gear", "fingers_in"]
    assert len(found["steps"]) == 12
    log = events(copy)
    assert [e["seq"] for e in log] == list(range(1, len(log) + 1))
    names = [e["event"] for e in log]
    assert (names.count("run"), names.count("resumed")) == (2, 1)
    assert names.count("jaws") == names.count("jaws_moved") == 2
    capsys.readouterr()
    assert code_of(capsys, run(built, copy, "--resume")) == "MP868"  # it is done
    assert run(built, copy, "--mode", "check") == 0


def test_a_new_run_does_not_delete_one_that_was_killed(
    built: Path, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (copy / "journal.jsonl").read_bytes()
    assert code_of(capsys, run(built, copy)) == "MP862"
    assert (copy / "journal.jsonl").read_bytes() == before
    assert run(built, copy, "--discard", "--seed", "3") == 0
    assert [e["event"] for e in events(copy)].count("resumed") == 0


def test_a_disk_that_fills_stops_the_run_before_the_motion(
    built: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    append, folder = FileStore.append, tmp_path / "run"

    def fill(store: FileStore, line: bytes) -> None:
        if INSERTING.encode() in line:
            append(store, line[: len(line) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        append(store, line)

    with monkeypatch.context() as full:
        full.setattr(FileStore, "append", fill)
        assert code_of(capsys, run(built, folder, "--seed", "3")) == "MP863"
    found = summary(folder)
    assert (found["code"], found["step"]) == ("MP863", "insert")
    stage = json.loads((folder / "cell.json").read_text("utf-8"))["devices"]["stage"]
    assert stage["commanded"]["z_um"] == -260.0
    assert code_of(capsys, run(built, folder)) == "MP862"
    assert run(built, folder, "--resume") == 0
    assert summary(folder)["cell_verdict"]["success"]


@pytest.mark.parametrize("name", ["events.jsonl", "calls-2.jsonl", "frames"])
def test_a_file_that_cannot_be_opened_is_no_bug(
    name: str, built: Path, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = copy / name
    path.unlink(missing_ok=True)
    path.write_bytes(b"") if name == "frames" else path.mkdir()
    words = [
        *QUICK,
        "--run-dir",
        str(copy),
        "--resume",
    ]
    status = main([str(built), *words])
    assert code_of(capsys, status) in ("MP863", "MP867")
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert main([str(built), *words]) == 0


def test_a_summary_that_was_lost_is_written_by_a_resumed_run(
    built: Path, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (copy / "summary.new").mkdir()
    assert code_of(capsys, run(built, copy, "--resume")) == "MP863"
    assert not (copy / "summary.json").exists()
    (copy / "summary.new").rmdir()
    assert run(built, copy, "--resume") == 0
    assert summary(copy)["cell_verdict"]["success"]
    assert code_of(capsys, run(built, copy, "--resume")) == "MP868"


def change_plan(plan: Path, _: Path) -> None:
    text = (plan / "plan.json").read_text(encoding="utf-8")
    (plan / "plan.json").write_text(text + "\n", encoding="utf-8")


def change_world(plan: Path, _: Path) -> None:
    data = json.loads((plan / "world.json").read_text(encoding="utf-8"))
    data["optics"]["light_gradient"] = 0.01
    (plan / "world.json").write_text(json.dumps(data), encoding="utf-8")


def damage(_: Path, folder: Path) -> None:
    path = folder / "journal.jsonl"
    path.write_bytes(path.read_bytes().replace(b"grasp", b"groom", 1))


def jog(_: Path, folder: Path) -> None:
    path = folder / "cell.json"
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    for kind in ("commanded", "actual"):
        data["devices"]["robot"][kind]["y_um"] += 25.0
    path.write_text(json.dumps(data), encoding="utf-8")


def stop_half_way(_: Path, folder: Path) -> None:
    path = folder / "cell.json"
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    for kind in ("commanded", "actual"):
        data["devices"]["stage"][kind]["z_um"] += 130.0
    path.write_text(json.dumps(data), encoding="utf-8")


def nothing(_: Path, __: Path) -> None:
    pass


def clear(_: Path, folder: Path) -> None:
    (folder / "journal.jsonl").unlink()


@pytest.mark.parametrize(
    ("spoil", "options", "code"),
    [
        (nothing, ["--seed", "9"], "MP866"),
        (nothing, ["--inject", "block"], "MP866"),
        (nothing, ["--camera", "solid"], "MP866"),
        (change_plan, [], "MP866"),
        (change_world, [], "MP866"),
        (damage, [], "MP867"),
        (jog, [], "MP865"),
        (stop_half_way, [], "MP864"),
        (clear, [], "MP868"),
    ],
)
def test_what_does_not_fit_is_refused_and_nothing_changes(
    spoil: Callable[[Path, Path], None],
    options: list[str],
    code: str,
    built: Path,
    copy: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    plan = Path(shutil.copytree(built, tmp_path / "gear.plan"))
    spoil(plan, copy)
    before = {p.name: p.read_bytes() for p in copy.iterdir() if p.name != "lock"}
    assert code_of(capsys, run(plan, copy, "--resume", *options)) == code
    after = {p.name: p.read_bytes() for p in copy.iterdir() if p.name != "lock"}
    assert after == before


@pytest.mark.parametrize(("answer", "status"), [("y", 0), ("n", 4)])
def test_at_a_terminal_the_operator_decides_on_a_half_done_insertion(
    answer: str, status: int, built: Path, copy: Path
) -> None:
    stop_half_way(built, copy)
    mine, its = os.openpty()
    os.write(mine, f"{answer}\n".encode())
    words = [
        str(built),
        *QUICK,
        "--run-dir",
        str(copy),
        "--no-frames",
    ]
    call = [sys.executable, "-m", "microplan.executor.cli.main", *words, "--resume"]
    ended = subprocess.run(
        call, stdin=its, stderr=its, stdout=subprocess.PIPE, text=True, check=False
    )
    os.close(its)
    told = os.read(mine, 1 << 16).decode()
    os.close(mine)
    way = "stage.z_um is at -130 on its way from -260 to 0; may it go on?"
    assert way in told
    assert ended.returncode == status, told
    assert ("MP864" in told) == (status == 4)
    assert ("seated, offset" in ended.stdout) == (status == 0)


def test_a_run_folder_in_use_is_refused(
    built: Path, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with held(copy / "lock", "run"):
        assert code_of(capsys, run(built, copy, "--resume")) == "MP861"
        assert code_of(capsys, run(built, copy, "--discard")) == "MP861"


def test_a_station_of_a_file_is_locked_and_a_run_on_it_resumed(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    station, folder = tmp_path / "station.toml", tmp_path / "run"
    text = STATION.read_text(encoding="utf-8")
    kept = 'seed = 0\nkept = "{station}/world.kept"'
    station.write_text(text.replace("seed = 0", kept, 1), encoding="utf-8")
    with held(tmp_path / "station.toml.lock", "station"):
        assert code_of(capsys, run(built, folder, station=str(station))) == "MP861"
    assert not folder.exists()
    killed_at(built, folder, INSERTING, station=str(station))
    assert (folder / "station.toml").read_bytes() == station.read_bytes()
    assert run(built, folder, "--resume", station=str(station)) == 0
    assert summary(folder)["cell_verdict"]["success"]
    station.write_text(station.read_text("utf-8") + "\n", encoding="utf-8")
    capsys.readouterr()
    status = run(built, folder, "--resume", station=str(station))
    assert code_of(capsys, status) == "MP868"
    assert os.path.lexists(tmp_path / "station.toml.lock")
