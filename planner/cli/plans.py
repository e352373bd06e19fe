"""Subcommands that read plans: diff, export, report."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from microplan.planner.cli.answering import (
    DONE,
    NO,
    answer,
    answered,
    asked_for,
    refuse,
)
from microplan.planner.source.diagnostics import CallError, Report
from microplan.schemas.page.console import say, tell

if TYPE_CHECKING:
    from microplan.planner.diff.diffing import Difference


def diff(call: argparse.Namespace) -> int:
    """Compare two plans: 0 for the same, 1 for different."""
    from microplan.planner.diff.change_text import findings_of, headline, verdicts_text
    from microplan.planner.diff.diffing import DiffCall
    from microplan.planner.diff.diffing import diff as compared

    report, pictures = Report(), not call.no_images
    asked = asked_for(DiffCall, call, rules=call.tolerance, pictures=pictures)
    try:
        found = compared(asked)
    except CallError as error:
        refuse(call, report, error)
        return answer(call, report, "")
    for note in found.notes:
        tell(f"note: {note}")
    if call.format in ("text", "json"):
        say(_differences(call, found))
        return NO if found.failing else DONE
    report.found += findings_of(found.changes, found.failing, str(call.new))
    said = f"{headline(found.changes)}\n{verdicts_text(found.old, found.new)}"
    return answer(call, report, said)


def _differences(call: argparse.Namespace, found: Difference) -> str:
    """Return what differs, for people or as JSON."""
    from microplan.planner.diff.change_text import changes_json, changes_text

    if call.format == "json":
        ends = (str(call.old), found.old), (str(call.new), found.new)
        return changes_json(found.changes, *ends)
    return changes_text(found.changes, found.old, found.new, tell_all=call.all)


@answered
def export(call: argparse.Namespace, report: Report) -> str:
    """Write a plan's looks in another tool's format."""
    from microplan.planner.export.export import ExportCall
    from microplan.planner.export.export import export as exported

    asked = asked_for(ExportCall, call, looks=tuple(call.look))
    return exported(asked, report)


@answered
def report_plan(call: argparse.Namespace, _report: Report) -> str:
    """Write the report of a plan folder."""
    from microplan.planner.report.report import write_report

    return f"report: {write_report(call.plan, call.out)}"
