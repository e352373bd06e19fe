"""Changes between plans in words, as JSON, or as findings."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from planner.comparing.changes import KINDS, Change
from planner.diagnostics import Diagnostic, Severity, Span
from schemas.console import one_line

FEW = 12  # of a kind that are told, unless all are asked for


def changes_text(changes: Sequence[Change], *, tell_all: bool = False) -> str:
    """Return the changes by kind, the gravest kinds first, worse before better."""
    if not changes:
        return "the plans mean the same"
    lines = [f"{len(changes)} differences: {_counts(changes)}"]
    for kind in KINDS:
        of_kind = [change for change in changes if change.kind == kind]
        if not of_kind:
            continue
        of_kind.sort(key=lambda change: change.trend != "worse")
        shown = of_kind if tell_all else of_kind[:FEW]
        lines += ["", kind, *(_line(change) for change in shown)]
        if len(shown) < len(of_kind):
            lines.append(
                f"  ... and {len(of_kind) - len(shown)} more; --all shows them"
            )
    return "\n".join(lines)


def changes_json(changes: Sequence[Change], old: str, new: str) -> str:
    """Return the changes as one JSON document."""
    said: dict[str, Any] = {
        "old": old,
        "new": new,
        "same": not changes,
        "changes": [
            {
                "where": change.where,
                "kind": change.kind,
                "old": change.old,
                "new": change.new,
                "says": change.says,
                "trend": change.trend,
            }
            for change in changes
        ],
    }
    return json.dumps(said, indent=2, ensure_ascii=False)


def findings_of(
    changes: Sequence[Change], failing: Sequence[Change], file: str
) -> list[Diagnostic]:
    """Return one finding a change, placed in the new plan; what fails is different."""
    fails = {change.path for change in failing}
    return [
        Diagnostic(
            code="MP710",
            severity=_severity(change, failing=change.path in fails),
            where=Span(file=file),
            message=f"{change.kind}: {change.where}: {change.says}",
            hint="",
        )
        for change in changes
    ]


def _severity(change: Change, *, failing: bool) -> Severity:
    if failing:
        return "different"
    return "warning" if change.trend == "worse" else "note"


def _counts(changes: Sequence[Change]) -> str:
    """Return how many changes of each kind there are."""
    counts = {kind: sum(c.kind == kind for c in changes) for kind in KINDS}
    return ", ".join(f"{n} {kind}" for kind, n in counts.items() if n)


def _line(change: Change) -> str:
    """Return one change in a line."""
    where = change.where.removeprefix("steps/")
    told = f"{where}: {change.says}" + (f", {change.trend}" if change.trend else "")
    return "  " + one_line(told)
