"""`microplan compile --watch`: rounds, and what begins one."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from microplan.planner.cli.watching import GONE_S, POLL_S, Round, watch
from microplan.planner.source.diagnostics import Report
from tests.planner.examples import GRASP, ROOT, between_jaws, change, copy_example, cut

DEADLINE_S = 120.0  # for a line that must come; it comes within a second or two


def _hears_ctrl_c() -> None:
    """Undo what shells give to jobs in the background: Ctrl-C is not theirs."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


class Watched:
    """A process that watches a task, and the lines that it says."""

    def __init__(self, task: Path, *more: str) -> None:
        words = ["compile", str(task), "--watch", "-o", str(task.parent / "p"), *more]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "microplan.planner.cli.main", *words],
            cwd=ROOT, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            preexec_fn=_hears_ctrl_c,
        )  # fmt: skip
        self._said = b""

    def line(self) -> str:
        """Return the next line of standard output."""
        assert self.process.stdout is not None
        end = time.monotonic() + DEADLINE_S
        while b"\n" not in self._said:
            left = max(end - time.monotonic(), 0.0)
            ready, _, _ = select.select([self.process.stdout], [], [], left)
            assert ready, "no line came"
            more = os.read(self.process.stdout.fileno(), 4096)
            assert more, (
                f"it ended: {self.process.stderr and self.process.stderr.read()!r}"
            )
            self._said += more
        line, _, self._said = self._said.partition(b"\n")
        return line.decode("utf-8")

    def interrupt(self) -> tuple[int, str]:
        """Press Ctrl-C; return the exit status and standard error."""
        self.process.send_signal(signal.SIGINT)
        _, err = self.process.communicate(timeout=DEADLINE_S)
        return self.process.returncode, err.decode("utf-8")


@pytest.fixture
def task(tmp_path: Path) -> Path:
    """Return a task without looks, which compiles at once."""
    file = copy_example(tmp_path / "task")
    between_jaws(file)
    cut(file, GRASP)
    return file


def put(file: Path, text: str) -> None:
    """Replace a file as editors do: a new one is moved into its place."""
    fresh = file.with_name(f".{file.name}.swp")
    fresh.write_text(text, encoding="utf-8")
    fresh.replace(file)


def test_every_change_is_a_round_and_a_mistake_keeps_the_last_good_plan(
    task: Path,
) -> None:
    watched = Watched(task)
    try:
        first = watched.line()
        assert first.startswith("[1]: feasible, P(success) ")
        plan = task.parent / "p" / "plan.json"
        text = task.read_text(encoding="utf-8")

        put(task, text.replace("opening_um: 96", "opening_um: 97"))
        second = watched.line()
        assert second.startswith("[2] task.yaml: ")
        assert " differences: " in second
        assert '"opening_um": 97' in plan.read_text(encoding="utf-8")
        good = plan.read_bytes()

        put(task, text.replace("seed: 1998", "sead: 1998"))
        third = watched.line()
        assert third.startswith("[3] task.yaml: 1 error, the last good plan is kept; ")
        assert plan.read_bytes() == good

        # a file that is not the task, while the task is still at fault
        change(
            task.with_name("workcell.yaml"), "reflectance: 0.70", "reflectance: 0.71"
        )
        assert watched.line().startswith("[4] workcell.yaml: 1 error, ")

        put(task, text)
        assert watched.line().startswith("[5] task.yaml: feasible, ")
        assert plan.read_bytes() != good

        # the same again is no change; the next round is that of the drawing
        put(task, text)
        drawing = task.parent / "parts" / "gear18.dxf"
        drawn = drawing.read_text(encoding="utf-8")
        put(drawing, f"999\nby hand\n{drawn}")
        sixth = watched.line()
        assert sixth.startswith("[6] parts/gear18.dxf: feasible, ")
        assert "the plans mean the same; " in sixth

        status, said = watched.interrupt()
    finally:
        watched.process.kill()
        watched.process.communicate()
    assert status == 130
    assert said.count("error[MP104]") == 2  # rounds 3 and 4
    assert said.endswith("stopped\n")
    assert "Traceback" not in said


def test_it_cannot_be_asked_for_what_it_does_not_do(
    task: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from microplan.planner.cli.main import main

    for more in (["--golden", "x"], ["--format", "json"]):
        assert main(["compile", str(task), "--watch", *more]) == 2
        assert "--watch" in capsys.readouterr().err
    (task.parent / "thesis").mkdir()
    (task.parent / "thesis" / "a.txt").write_text("years", encoding="utf-8")
    out = ["-o", str(task.parent / "thesis")]
    assert main(["compile", str(task), "--watch", *out]) == 2
    assert "error[MP701]" in capsys.readouterr().err


# what begins a round, by a wait that is the test's own: no time passes


class Hands:
    """Does one thing at each wait, as a person at an editor may; then stops."""

    def __init__(self, *acts: Callable[[], object]) -> None:
        self.acts, self.waits = [*acts], 0

    def __call__(self, seconds: float) -> None:
        assert seconds == POLL_S
        self.waits += 1
        if not self.acts:
            raise KeyboardInterrupt
        self.acts.pop(0)()


def nothing() -> None:
    """Leave everything as it is for one wait."""


def rounds(file: Path, hands: Hands) -> Iterator[tuple[Round, str]]:
    """Yield the rounds of a watched file and what each of them read."""

    def compiled(report: Report) -> None:
        report.sought.add(str(file))
        if file.exists():
            read.append(file.read_text(encoding="utf-8"))
            from microplan.planner.cli.watching import digest

            report.files[str(file)] = str(digest(str(file)))
        else:
            read.append("")

    read: list[str] = []
    try:
        for found in watch(str(file), compiled, None, hands):
            yield found, read[-1]
    except KeyboardInterrupt:
        return


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "task.yaml"
    path.write_text("a", encoding="utf-8")
    return path


def read_in_rounds(file: Path, *acts: Callable[[], object]) -> list[str]:
    return [read for _, read in rounds(file, Hands(*acts, *[nothing] * 20))]


def test_what_is_written_in_pieces_is_read_whole(file: Path) -> None:
    def more(text: str) -> Callable[[], object]:
        return lambda: file.write_text(text, encoding="utf-8")

    acts = [nothing, nothing, more("b"), more("bc"), more("bcd")]
    assert read_in_rounds(file, *acts) == ["a", "bcd"]


def test_a_new_time_is_no_change(file: Path) -> None:
    acts = [nothing, nothing, lambda: os.utime(file, (1, 1)), nothing, nothing]
    assert read_in_rounds(file, *acts) == ["a"]


def test_a_file_that_is_gone_for_a_moment_is_not_missing(file: Path) -> None:
    few = int(GONE_S / POLL_S) - 2
    back = [file.unlink, *[nothing] * few, lambda: file.write_text("b")]
    assert read_in_rounds(file, nothing, nothing, *back) == ["a", "b"]


def test_a_file_that_stays_away_is_missing_until_it_is_back(file: Path) -> None:
    many = 2 * int(GONE_S / POLL_S)
    acts = [file.unlink, *[nothing] * many, lambda: file.write_text("a")]
    assert read_in_rounds(file, nothing, *acts) == ["a", "", "a"]


def test_what_changes_while_a_round_runs_is_seen_after_it(file: Path) -> None:
    seen = []
    for found, read in rounds(file, Hands(*[nothing] * 9)):
        seen.append((found.changed, read))
        if found.number == 1:
            file.write_text("b", encoding="utf-8")  # before the first wait
    assert seen == [((), "a"), ((str(file),), "b")]


def test_a_file_that_cannot_be_read_is_no_bug(tmp_path: Path) -> None:
    missing = tmp_path / "no.yaml"
    acts = [nothing, nothing, missing.mkdir, nothing, nothing]
    assert [read for _, read in rounds(missing, Hands(*acts))] == [""]
