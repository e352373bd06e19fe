"""The operator: what is asked and told while a plan runs, where somebody answers."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable

from microplan.executor.cli.options import RunOptions
from microplan.executor.cli.session import Asking
from microplan.executor.devices.errors import ExecutorError
from microplan.schemas.page.console import is_terminal, tell
from microplan.schemas.plan import Plan


def asking_of(options: RunOptions, plan: Plan) -> Asking:
    """Return the questions and messages that the operator gets."""
    gate = _gate() if options.stepwise else None
    # whether an operator at a terminal reads and answers
    seated = is_terminal(sys.stdin) and is_terminal(sys.stderr)
    return Asking(
        pause=_pause if seated else None,
        question=_question if seated else None,
        gate=gate,
        progress=None if gate else teller(plan),
    )


def teller(plan: Plan) -> Callable[[str], None] | None:
    """Return the progress messages for a terminal, None without a terminal."""
    if not is_terminal(sys.stderr):
        return None
    numbers = {step.id: number for number, step in enumerate(plan.steps, start=1)}

    def begun(step: str) -> None:
        tell(f"running {step} ({numbers[step]} of {len(numbers)}) ...")

    return begun


def _question(question: str) -> bool:
    """Return whether the operator lets something go on."""
    tell(f"{question} y goes on, anything else stops")
    return answer().strip() == "y"


def _pause() -> bool:
    """Return whether the operator goes on after a pause."""
    tell("paused: Enter goes on, q stops, Ctrl-C stops at once")
    return answer() == "\n"  # "" is the end of the input: no operator


def _gate() -> Callable[[str], None]:
    """Return the gate that shows the next step and waits; MP804 without an operator.

    Answers are lines of a terminal, a pipe or a file: an empty one goes on. Whatever
    else comes, the end of the input too, stops.
    """
    if sys.stdin is None or sys.stdin.closed:
        raise ExecutorError("MP804", "--step needs somebody who answers")
    mode = os.fstat(sys.stdin.fileno()).st_mode
    if not (is_terminal(sys.stdin) or stat.S_ISFIFO(mode) or stat.S_ISREG(mode)):
        raise ExecutorError(
            "MP804", "--step needs a terminal, or answers from a pipe, a line each"
        )

    def wait(what: str) -> None:
        tell(f"next: {what}\nEnter goes on, q stops")
        if answer() not in ("\n", "\r\n"):
            raise ExecutorError("MP860", "stopped by the operator before this")

    return wait


def answer() -> str:
    """Return a line of standard input; what cannot be read says no."""
    try:
        return sys.stdin.readline()
    except (OSError, ValueError):  # a terminal that is gone; bytes that are no text
        return ""
