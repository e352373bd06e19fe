"""Subcommands that read plans: diff, export, report."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from microplan.planner.cli.answering import DONE, NO, answer
from microplan.planner.source.diagnostics import Report, Span
from microplan.schemas.page.console import say, tell

if TYPE_CHECKING:
    from microplan.planner.diff.diffing import DiffCall, Difference
    from microplan.planner.export.export import ExportCall


def diff(call: argparse.Namespace) -> int:
    """Compare two plans: 0 for the same, 1 for different."""
    from microplan.planner.diff.change_text import findings_of, headline, verdicts_text
    from microplan.planner.diff.diffing import DiffError
    from microplan.planner.diff.diffing import diff as compared

    try:
        found = compared(_diff_call(call))
    except DiffError as error:
        report = Report()
        report.error(error.code, Span(file=error.file), str(error))
        return answer(call, report, "")
    for note in found.notes:
        tell(f"note: {note}")
    if call.format in ("text", "json"):
        say(_differences(call, found))
        return NO if found.failing else DONE
    report = Report(found=findings_of(found.changes, found.failing, str(call.new)))
    said = f"{headline(found.changes)}\n{verdicts_text(found.old, found.new)}"
    return answer(call, report, said)


def _diff_call(call: argparse.Namespace) -> DiffCall:
    """Return which plans are compared, and how strictly."""
    from microplan.planner.diff.diffing import DiffCall

    return DiffCall(
        old=call.old,
        new=call.new,
        rules=call.tolerance,
        fail_on=call.fail_on,
        pictures=not call.no_images,
    )


def _differences(call: argparse.Namespace, found: Difference) -> str:
    """Return what differs, for people or as JSON."""
    from microplan.planner.diff.change_text import changes_json, changes_text

    if call.format == "json":
        ends = (str(call.old), found.old), (str(call.new), found.new)
        return changes_json(found.changes, *ends)
    return changes_text(found.changes, found.old, found.new, tell_all=call.all)


def export(call: argparse.Namespace) -> int:
    """Write a plan's looks in another tool's format."""
    from microplan.planner.export.export import export as exported
    from microplan.planner.export.folder import ExportError
    from microplan.planner.store.folder import OutputError

    report, said = Report(), ""
    try:
        said = exported(_export_call(call), report)
    except ExportError as error:
        report.error(error.code, Span(file=error.file), str(error), error.hint)
    except OutputError as error:
        report.error(error.code, Span(file=error.file), str(error))
    return answer(call, report, said)


def _export_call(call: argparse.Namespace) -> ExportCall:
    """Return what is exported, and to where."""
    from microplan.planner.export.export import ExportCall

    return ExportCall(
        plan=call.plan,
        to=call.to,
        out=call.out,
        looks=tuple(call.look),
        channel=call.channel,
        overwrite=call.overwrite,
    )


def report_plan(call: argparse.Namespace) -> int:
    """Write the report of a plan folder."""
    from microplan.planner.diff.diffing import DiffError
    from microplan.planner.report.report import write_report
    from microplan.planner.store.folder import OutputError

    report, said = Report(), ""
    try:
        said = f"report: {write_report(call.plan, call.out)}"
    except (DiffError, OutputError) as error:
        report.error(error.code, Span(file=error.file), str(error))
    return answer(call, report, said)
