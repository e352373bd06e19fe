"""How a subcommand ends: its findings and its result are told, its status follows."""

from __future__ import annotations

import argparse
import os
import sys
from typing import Protocol

from microplan.planner.cli.terminal import in_colour, painted
from microplan.planner.source.diagnostics import Report, Span
from microplan.schemas.page.console import say, tell

DONE, NO, BAD_INPUT = 0, 1, 2


class Coded(Protocol):
    """An exception with the code of its finding, and the file that it is about."""

    code: str
    file: str  # "": what cannot be done is said of the task


def answer(call: argparse.Namespace, report: Report, result: str) -> int:
    """Print findings and result; return the exit status they amount to."""
    from microplan.planner.cli.findings import render_findings

    out, err = render_findings(report.in_order, result, call.format)
    tell_findings(err)
    say(out)
    if report.failed:
        return BAD_INPUT
    return NO if report.refused else DONE


def refuse(call: argparse.Namespace, report: Report, error: Coded) -> int:
    """Tell what could not be done with the call itself, beside the findings."""
    report.error(error.code, Span(file=error.file or call.task), str(error))
    return answer(call, report, "")


def tell_findings(text: str) -> None:
    """Print findings, in colour where that is wanted."""
    tell(text, painted if in_colour(sys.stderr, os.environ) else None)


def tell_progress(text: str) -> None:
    """Say what is being worked on, on a terminal only."""
    if sys.stderr.isatty():
        tell(text)
