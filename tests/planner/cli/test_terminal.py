"""Colour where a terminal shows it, and nowhere else."""

from __future__ import annotations

import io
import os
import pty
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import get_args

import pytest

from microplan.planner.cli.answering import (
    in_colour,
    painted,
    tell_findings,
    tell_progress,
)
from microplan.planner.cli.progress import Progress, columns
from microplan.planner.source.diagnostics import Diagnostic, Severity, Span, render_text
from microplan.schemas.page.console import is_terminal
from tests.planner.examples import ROOT
from tests.planner.sweep.no_looks import no_looks, readings

CODES = re.compile(r"\x1b\[[0-9;]*m")
CACHE = ("--cache", str(readings()))
NAMES = ("NO_COLOR", "FORCE_COLOR", "TERM", "PYTHON_COLORS")


class Screen(io.StringIO):
    """Says whether it is a terminal."""

    def __init__(self, *, terminal: bool) -> None:
        super().__init__()
        self.terminal = terminal

    def isatty(self) -> bool:
        return self.terminal


@pytest.mark.parametrize(
    ("environment", "terminal", "colour"),
    [
        ({}, True, True),
        ({}, False, False),
        ({"TERM": "xterm"}, True, True),
        ({"TERM": "dumb"}, True, False),
        ({"NO_COLOR": "1"}, True, False),
        ({"NO_COLOR": "0"}, True, False),  # any value but none
        ({"NO_COLOR": ""}, True, True),
        ({"FORCE_COLOR": "1"}, False, True),
        ({"FORCE_COLOR": "1", "TERM": "dumb"}, False, True),
        ({"FORCE_COLOR": ""}, False, False),
        ({"FORCE_COLOR": "1", "NO_COLOR": "1"}, True, False),
    ],
)
def test_who_gets_colour(
    environment: Mapping[str, str], terminal: bool, colour: bool
) -> None:
    assert in_colour(Screen(terminal=terminal), environment) == colour


@pytest.mark.parametrize("severity", get_args(Severity))
def test_colours_are_all_that_is_added(severity: Severity) -> None:
    where = Span(file="t.yaml", line=3, column=5, length=4, text="  x: what | ^^^")
    finding = Diagnostic(
        code="MP104", severity=severity, where=where, message="m", hint="h"
    )
    plain = render_text(finding)
    shown = painted(plain)
    assert CODES.sub("", shown) == plain
    assert len(CODES.findall(shown)) == 4  # a kind and a caret, begun and ended
    assert re.search(rf"^{CODES.pattern}{severity}\[MP104\]{CODES.pattern}: m", shown)
    assert re.search(rf"{CODES.pattern}\^\^\^\^{CODES.pattern} h$", shown)


def on_a_terminal(folder: Path, **environment: str) -> str:
    """Return what `microplan check` says of a broken task to a terminal."""
    ours, theirs = pty.openpty()
    kept = {k: v for k, v in os.environ.items() if k not in NAMES}
    done = subprocess.Popen(
        [sys.executable, "-m", "microplan.planner.cli.main", "check",
         str(folder / "task.yaml")],
        stdout=theirs, stderr=theirs, stdin=subprocess.DEVNULL, cwd=ROOT,
        env={**kept, **environment},
    )  # fmt: skip
    os.close(theirs)
    said = b""
    try:
        while more := os.read(ours, 4096):
            said += more
    except OSError:  # Linux: the last writer has closed the terminal
        pass
    os.close(ours)
    assert done.wait() == 2
    return said.decode("utf-8").replace("\r\n", "\n")


def test_a_terminal_shows_findings_in_colour_and_names_harmlessly(
    tmp_path: Path,
) -> None:
    text = 'microplan: 1\n"na\\e[31mme": x\n'
    (tmp_path / "task.yaml").write_text(text, encoding="utf-8")
    shown = on_a_terminal(tmp_path, TERM="xterm")
    plain = on_a_terminal(tmp_path, TERM="xterm", NO_COLOR="1")
    assert "\x1b" not in plain
    assert CODES.sub("", shown) == plain
    assert "\x1b[1;31merror[MP" in shown
    assert "\\u001b[31m" in shown  # the file's own code is told, not obeyed
    assert on_a_terminal(tmp_path, TERM="dumb") == plain


def test_what_is_closed_is_no_terminal_and_takes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    closed = Screen(terminal=True)
    closed.close()
    broken = io.StringIO()
    broken.close()  # its isatty raises ValueError
    for stream in (None, broken, closed):
        monkeypatch.setattr(sys, "stderr", stream)
        tell_findings("x")
        tell_progress("x")
        Progress().clear()
    assert not is_terminal(None)
    assert not is_terminal(broken)
    assert columns(None) is None
    assert columns(broken) is None
    assert is_terminal(Screen(terminal=True))


@pytest.mark.parametrize("words", [("check",), ("sweep", "--set", "seed=1")])
def test_a_command_works_with_standard_error_closed(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    task = no_looks(tmp_path / "task")
    more = ["-o", str(tmp_path / "out"), *CACHE] if words[0] == "sweep" else []
    call = [sys.executable, "-m", "microplan.planner.cli.main", *words, str(task)]
    done = subprocess.run(
        ["sh", "-c", 'exec "$@" 2>&-', "sh", *call, *more],
        cwd=ROOT, stdout=subprocess.PIPE, check=False,
    )  # fmt: skip
    assert done.returncode in (0, 1)
    assert done.stdout
