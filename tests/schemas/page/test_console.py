"""What a command prints where nobody takes it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import IO

import pytest

from microplan.schemas.page.console import say, tell

FULL = Path("/dev/full")
# as a user has it: what is printed goes through a buffer
ENVIRONMENT = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
TALKS = """
import sys
from microplan.schemas.page.console import OutputLostError, flush, say, tell
print("by others", end="")
try:
    say("result " * 50_000)
    tell("finding")
    say("more")
    flush()
except OutputLostError as error:
    tell(f"lost: {error}")
    sys.exit(3)
"""


def ended(code: list[str], out: int | IO[bytes], err: int | IO[bytes]) -> int:
    call = [sys.executable, *code]
    return subprocess.run(call, stdout=out, stderr=err, env=ENVIRONMENT).returncode


def unread() -> int:
    """Return the end of a pipe that nobody reads."""
    read, write = os.pipe()
    os.close(read)
    return write


def heard(code: list[str], out: int | IO[bytes]) -> tuple[int, str]:
    """Return the status of a process and what it says on standard error."""
    done = subprocess.run(
        [sys.executable, *code],
        stdout=out,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    )
    return done.returncode, done.stderr


def test_a_reader_that_has_left_is_no_fault() -> None:
    assert heard(["-c", TALKS], unread()) == (0, "finding\n")
    assert ended(["-c", TALKS], unread(), unread()) == 0


@pytest.mark.skipif(not FULL.exists(), reason=f"no {FULL}")
def test_a_full_disk_is_told_once() -> None:
    with FULL.open("wb") as full:
        status, said = heard(["-c", TALKS], full)
        assert status == 3
        assert said == "lost: standard output: No space left on device\n"
        assert ended(["-c", TALKS], subprocess.DEVNULL, full) == 0


@pytest.mark.skipif(not FULL.exists(), reason=f"no {FULL}")
@pytest.mark.parametrize(
    ("command", "status"),
    [("microplan.planner.cli.main", 2), ("microplan.executor.cli.main", 3)],
)
def test_a_command_ends_as_others_do(command: str, status: int) -> None:
    """Argparse writes the help, and what it writes may be lost at the very end."""
    asked = ["-m", command, "--help"]
    with FULL.open("wb") as full:
        told = "error: standard output: No space left on device\n"
        assert heard(asked, full) == (status, told)
    assert heard(asked, unread()) == (0, "")


def test_streams_that_are_closed_take_nothing() -> None:
    call = f'exec {sys.executable} -c "$CODE" >&- 2>&-'
    done = subprocess.run(["/bin/sh", "-c", call], env={**ENVIRONMENT, "CODE": TALKS})
    assert done.returncode == 0


def test_what_a_terminal_obeys_is_escaped(capsys: pytest.CaptureFixture[str]) -> None:
    say("a\x1b[31mb\tc\u202ed\udc80")
    tell("\x07")
    heard_now = capsys.readouterr()
    assert heard_now.out == "a\\u001b[31mb\tc\\u202ed\\udc80\n"
    assert heard_now.err == "\\u0007\n"
