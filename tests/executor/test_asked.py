"""Calls that contradict themselves, and what a run tells a terminal."""

from __future__ import annotations

import io
import sys

import pytest

from executor.asked import parse
from executor.cli import _teller
from schemas.plan import MoveAction
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
    assert _teller(plan) is None
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    told = _teller(plan)
    assert told is not None
    told("b")
    assert shown.getvalue() == "running b (2 of 2) ...\n"
