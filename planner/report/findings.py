"""Findings of a compile as a table of the report, facts included."""

from __future__ import annotations

from collections.abc import Sequence

from microplan.planner.source.diagnostics import Diagnostic
from microplan.schemas.page.elements import Element, el
from microplan.schemas.page.page import Column, Row, table


def findings_section(found: Sequence[Diagnostic]) -> Element | None:
    """Return what the compiler found in the task's files, None if that is nothing."""
    if not found:
        return None
    columns = [Column(name) for name in ("finding", "where", "what", "what to do")]
    return el(
        "section",
        el("h2", "Findings"),
        table(columns, [_row(finding) for finding in found], label="Findings"),
        id="findings",
    )


def _row(finding: Diagnostic) -> Row:
    where = finding.where
    place = f"{where.file}:{where.line}" if where.line else where.file
    do = finding.hint if finding.action else f"nothing; {finding.hint}".rstrip("; ")
    return [f"{finding.severity} {finding.code}", place, finding.message, do]
