"""The end of a subcommand: result, findings in colour, exit status."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import wraps
from typing import TYPE_CHECKING, Any, TextIO, TypeVar

from microplan.planner.source.diagnostics import CallError, Report, Span
from microplan.schemas.page.console import is_terminal, say, tell

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")

_RESET = "\x1b[0m"
# bold red, bold yellow, bold cyan: the first eight colours, which every terminal has
_COLOURS = {
    "error": "\x1b[1;31m",
    "infeasible": "\x1b[1;31m",
    "different": "\x1b[1;31m",
    "warning": "\x1b[1;33m",
    "note": "\x1b[1;36m",
}
_CARET = "\x1b[1;36m"
_HEADLINE = re.compile(rf"^({'|'.join(_COLOURS)})(\[MP\d{{3}}\])", re.MULTILINE)
_POINTER = re.compile(r"^( +\| +)(\^+)", re.MULTILINE)


def in_colour(stream: TextIO | None, environment: Mapping[str, str]) -> bool:
    """Return whether colour may be printed to a stream.

    NO_COLOR forbids it, else FORCE_COLOR allows it, unless they are empty; else a
    terminal shows it that is not called dumb. The same order as Python's own.

    References
    ----------
    no-color.org; force-color.org; Python 3.13, "Controlling color".
    """
    if environment.get("NO_COLOR"):
        return False
    if environment.get("FORCE_COLOR"):
        return True
    return environment.get("TERM") != "dumb" and is_terminal(stream)


def painted(text: str) -> str:
    """Return findings as text with their kinds and carets in colour.

    Nothing but colours is added: without them it is the same text.
    """
    text = _HEADLINE.sub(lambda at: f"{_COLOURS[at[1]]}{at[0]}{_RESET}", text)
    return _POINTER.sub(lambda at: f"{at[1]}{_CARET}{at[2]}{_RESET}", text)


DONE, NO, BAD_INPUT = 0, 1, 2

Command = Callable[[argparse.Namespace, Report], str]


def answer(call: argparse.Namespace, report: Report, result: str) -> int:
    """Print findings and result; return the exit status they amount to."""
    from microplan.planner.cli.findings import render_findings

    found, verbose = report.in_order, call.verbose
    out, err = render_findings(found, result, call.format, verbose=verbose)
    try:
        say(out)
    finally:  # findings are not lost with a standard output that takes nothing
        tell_findings(err)
    if report.failed:
        return BAD_INPUT
    return NO if report.refused else DONE


def asked_for(kind: type[T], call: argparse.Namespace, **others: object) -> T:
    """Return what a call asks for as a dataclass, the arguments by their names."""
    names = {field.name for field in fields(kind)}
    given: dict[str, Any] = {k: v for k, v in vars(call).items() if k in names}
    return kind(**{**given, **others})


def answered(command: Command) -> Callable[[argparse.Namespace], int]:
    """Return a command that prints what it returns, or why it cannot be done."""

    @wraps(command)
    def run(call: argparse.Namespace) -> int:
        report, said = Report(), ""
        try:
            said = command(call, report)
        except CallError as error:
            refuse(call, report, error)
        return answer(call, report, said)

    return run


def refuse(call: argparse.Namespace, report: Report, error: CallError) -> None:
    """Add to the findings what could not be done with the call itself."""
    where = Span(file=error.file or call.task)
    report.error(error.code, where, str(error), error.hint)


def tell_findings(text: str) -> None:
    """Print findings, in colour where that is wanted."""
    tell(text, painted if in_colour(sys.stderr, os.environ) else None)


def tell_progress(text: str) -> None:
    """Print progress, on a terminal only."""
    if is_terminal(sys.stderr):
        tell(text)
