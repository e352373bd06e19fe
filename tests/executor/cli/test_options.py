"""Calls that contradict themselves, and what a run tells a terminal."""

from __future__ import annotations

import io
import subprocess
import sys

import pytest

from microplan.executor.cli.operator import answer, asking_of, teller
from microplan.executor.cli.options import parse
from microplan.executor.record.outcome import injected
from microplan.executor.simulated.faults import Faults
from microplan.schemas.plan import MoveAction
from tests.executor.bench import plan_of, stage_to, step


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--station", "sim", "--bits", "12"], "--bits is for --pictures"),
        (["--station", "sim", "--still"], "--still is for --pictures"),
        (["--mode", "replay", "--from", "r", "--turn-deg", "0"], "--turn-deg is for"),
        (["--mode", "replay", "--from", "r", "--marked", "m"], "--marked is for"),
        (["--station", "sim", "--anyway"], "--anyway is for --from"),
        (["--station", "sim", "--format", "json"], "a run has summary.json"),
    ],
)
def test_an_option_that_would_do_nothing_is_refused(
    words: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        parse(["p", *words])
    assert caught.value.code == 2
    assert why in capsys.readouterr().err


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_alone_is_told_which_step_begins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plan = plan_of([step(name, MoveAction(), moves=(stage_to(),)) for name in "ab"])
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert teller(plan) is None
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    told = teller(plan)
    assert told is not None
    told("b")
    assert shown.getvalue() == "running b (2 of 2) ...\n"


def test_nobody_is_asked_where_standard_streams_are_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "stdin", Terminal())
    monkeypatch.setattr(sys, "stderr", Terminal())
    call, plan = parse(["p", "--station", "sim"]), plan_of([])
    asked = asking_of(call, plan)
    assert asked.pause is not None
    assert asked.question is not None
    for stream in ("stdin", "stderr"):
        with monkeypatch.context() as closed:
            closed.setattr(sys, stream, None)  # as the interpreter has it then
            asked = asking_of(call, plan)
            assert asked.pause is None
            assert asked.question is None


def test_an_answer_that_is_no_text_says_no(monkeypatch: pytest.MonkeyPatch) -> None:
    for source, line in ((b"\n", "\n"), (b"\xff\n", ""), (b"", "")):
        stream = io.TextIOWrapper(io.BytesIO(source), encoding="utf-8")
        monkeypatch.setattr(sys, "stdin", stream)
        assert answer() == line


def test_what_lasts_the_whole_run_has_no_step() -> None:
    with pytest.raises(ValueError, match="no_part lasts the whole run"):
        Faults(["no_part@find_gear"])
    assert Faults(["no_part"]).on("no_part")


def test_what_nothing_met_is_known() -> None:
    found = Faults(["light_out", "block@insert", "block", "axis_nan@lift"])
    assert len(found.idle) == 4
    found.enter("insert")
    assert found.on("block")
    found.enter("release")
    assert not found.on("axis_nan")
    assert list(found.idle) == ["light_out", "axis_nan@lift"]


def test_whether_faults_were_met_may_be_unknown() -> None:
    asked = ("light_out", "block")
    assert injected(asked, ()) == "light_out, block"
    assert injected(asked, ["block"]) == "light_out, block (met by nothing)"
    unknown = "light_out, block (whether anything met them is not known)"
    assert injected(asked, None) == unknown
    assert injected((), None) == ""


def test_a_fault_of_no_step_is_refused() -> None:
    with pytest.raises(ValueError, match="names no step after the @"):
        Faults(["axis_nan@"])
    assert Faults(["axis_nan"]).on("axis_nan")


def test_no_file_takes_the_place_of_a_closed_stream() -> None:
    """A library that writes to standard error would write into the journal."""
    code = (
        "import os\nfrom microplan.executor.cli.main import main\nkept = os.dup(1)\n"
        "os.closerange(0, 3)\nmain(['nowhere', '--station', 'sim'])\n"
        "os.write(kept, str(os.open(os.devnull, os.O_RDONLY)).encode())"
    )
    call = [sys.executable, "-c", code]
    said = subprocess.run(call, capture_output=True, text=True, check=False)
    assert int(said.stdout) > 2
