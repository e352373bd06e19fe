"""Ctrl-C while a task is compiled: what is said, what is kept, what is left running."""

from __future__ import annotations

import contextlib
import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from microplan.planner.cli.main import main
from microplan.planner.cli.progress import Progress
from microplan.planner.looks.progress.work import CompileProgress
from tests.planner.examples import FEW, ONE_LOOK, ROOT, change, copy_example, cut
from tests.planner.examples import one_look as with_one_look

AGAIN = ONE_LOOK.replace("see_post", "see_again")


@pytest.fixture
def task(tmp_path: Path) -> Path:
    """Return a task of two looks at a post, which show little: fast."""
    file = copy_example(tmp_path / "task")
    with_one_look(file)
    cut(file, ONE_LOOK, AGAIN)
    change(file, "max_image_error: 0.06", "max_image_error: 0.5")
    return file


@pytest.fixture(autouse=True)
def _fewer_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    few = dict.fromkeys(("fast", "balanced"), FEW)
    monkeypatch.setattr("microplan.planner.plan.compiler.PRESETS", few)


def test_a_compile_that_is_stopped_goes_on_from_there(
    task: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """What the first step's look made is made no more."""
    heard: list[CompileProgress] = []
    stops = [True]

    def listens(_shown: Progress, reached: CompileProgress) -> None:
        heard.append(reached)
        _shown.last = reached
        if stops and reached.steps == 1 and reached.stage == "random trials":
            raise KeyboardInterrupt

    monkeypatch.setattr(Progress, "__call__", listens)
    words = ["compile", str(task), "--preset", "fast", "--cache"]
    cache = str(tmp_path / "cache")
    stopped = tmp_path / "stopped"
    assert main([*words, cache, "-o", str(stopped)]) == 130
    assert "kept: 1 of 2 steps; the same command goes on" in capsys.readouterr().err
    assert not stopped.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cache", "task"]
    assert {r.look for r in heard if r.stage} == {"see_post", "see_again"}

    heard.clear()
    stops.clear()
    assert main([*words, cache, "-o", str(stopped)]) == 0
    assert {(r.look, r.stage) for r in heard if r.stage} == {
        ("see_again", "random trials")
    }
    assert (stopped / "plan.json").is_file()


def _group(pid: int) -> list[int]:
    """Return the processes of a group that run."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            name, _, fields = stat.read_text().rpartition(")")
            state, _, group, *_ = fields.split()
            if int(group) == pid and state != "Z":
                found.append(int(name.split()[0]))
    return found


@contextlib.contextmanager
def on_a_terminal(*words: str) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """Yield `microplan` in a group of its own, and what reads its standard error."""
    ours, theirs = pty.openpty()
    call = [sys.executable, "-m", "microplan.planner.cli.main", *words]
    try:
        with subprocess.Popen(
            call, cwd=ROOT, stdout=subprocess.PIPE, stderr=theirs,
            start_new_session=True,
        ) as process:  # fmt: skip
            os.close(theirs)
            yield process, ours
            process.kill()
    finally:
        os.close(ours)


def _heard(reader: int, until: bytes = b"") -> bytes:
    """Return what comes until something has come, or to the end."""
    heard = b""
    with contextlib.suppress(OSError):  # its other end is closed
        while not until or until not in heard:
            more = os.read(reader, 1 << 16)
            if not more:
                break
            heard += more
    return heard


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize("more", [(), ("--jobs", "2", "--no-cache")])
def test_ctrl_c_leaves_no_process_no_folder_and_no_traceback(
    more: tuple[str, ...], task: Path, tmp_path: Path
) -> None:
    out = tmp_path / "new"
    words = ["compile", str(task), "--preset", "fast", "-o", str(out)]
    cache = () if "--no-cache" in more else ("--cache", str(tmp_path / "cache"))
    with on_a_terminal(*words, *cache, *more) as (process, reader):
        heard = _heard(reader, b"see_post, ")
        os.killpg(process.pid, signal.SIGINT)
        heard += _heard(reader)
        assert process.wait() == 130
        deadline = time.monotonic() + 60
        while _group(process.pid) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert _group(process.pid) == []
        assert process.stdout is not None
        assert process.stdout.read() == b""
    said = heard.decode()
    assert "Traceback" not in said
    kept = "nothing is kept: --no-cache" if more else "nothing of use is kept yet"
    assert f"stopped; {kept}" in said.splitlines()[-1]
    assert not list(tmp_path.glob("*new*"))
