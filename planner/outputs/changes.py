"""Changes between plans in words, as JSON, or as findings."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

from planner.comparing.changes import KINDS, Change, Kind, Name, causes_first
from planner.diagnostics import Diagnostic, Severity, Span
from planner.outputs.summary import success
from schemas.console import one_line
from schemas.plan import Plan

FEW = 12  # lines of a kind that are told, unless all are asked for
FEW_ALIKE = 2  # places of changes that are alike
MORE = "--all shows them"


def changes_text(
    changes: Sequence[Change],
    old: Plan,
    new: Plan,
    *,
    tell_all: bool = False,
    more: str = MORE,
) -> str:
    """Return the changes by kind: causes first, then worse first; alike together.

    The last line is the verdict of both plans, also where nothing changed. `more` says
    what shows those that are left out.
    """
    lines, left_out = [headline(changes)], 0
    for kind in KINDS:
        groups = _groups(changes, kind)
        if not groups:
            continue
        lines += ["", kind]
        for group in groups if tell_all else groups[:FEW]:
            shown = group if tell_all or len(group) == 1 else group[:FEW_ALIKE]
            lines += _lines(group, shown)
            left_out += len(group) - len(shown)
        left_out += 0 if tell_all else sum(map(len, groups[FEW:]))
    lines += [""] if changes else []
    lines += [f"{left_out} not listed; {more}"] if left_out else []
    return "\n".join([*lines, verdicts_text(old, new)])


def headline(changes: Sequence[Change]) -> str:
    """Return how many changes of each kind there are."""
    if not changes:
        return "the plans mean the same"
    counts = {kind: sum(c.kind == kind for c in changes) for kind in KINDS}
    told = ", ".join(f"{n} {kind}" for kind, n in counts.items() if n)
    one = "1 difference" if len(changes) == 1 else f"{len(changes)} differences"
    return f"{one}: {told}"


def verdicts_text(old: Plan, new: Plan) -> str:
    """Return P(success) and status of two plans, also where they are the same."""
    chance = _both(success(old), success(new))
    return f"P(success) {chance}, {_both(old.status, new.status)}"


def changes_json(
    changes: Sequence[Change], old: tuple[str, Plan], new: tuple[str, Plan]
) -> str:
    """Return the changes as one JSON document, causes first; plans by their names."""
    said: dict[str, Any] = {
        "old": old[0],
        "new": new[0],
        "same": not changes,
        "verdicts": {
            key: {
                "status": plan.status,
                "success_probability": plan.success_probability,
            }
            for key, (_, plan) in (("old", old), ("new", new))
        },
        "changes": [
            {
                "where": change.where,
                "kind": change.kind,
                "old": change.old,
                "new": change.new,
                "unit": change.unit,
                "says": change.says,
                "trend": change.trend,
            }
            for change in causes_first(changes)
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


def _both(old: str, new: str) -> str:
    return f"{old} in both" if old == new else f"{old} before, {new} now"


def _groups(changes: Sequence[Change], kind: Kind) -> list[list[Change]]:
    """Return the changes of a kind, those together that changed by the same."""
    found: dict[tuple[str, ...], list[Change]] = {}
    for change in causes_first(c for c in changes if c.kind == kind):
        alike = (change.trend, _key(change), change.share or change.says)
        found.setdefault(alike, []).append(change)
    return list(found.values())


def _key(change: Change) -> str:
    """Return what a value is called, without where it stands in a list."""
    keys = [p for p in change.path if not (p.isdigit() or isinstance(p, Name))]
    return keys[-1] if keys else ""


def _lines(group: Sequence[Change], shown: Sequence[Change]) -> Iterator[str]:
    """Yield the lines of changes that are alike: what they share, then where."""
    first = group[0]
    trend = f", {first.trend}" if first.trend else ""
    if len(group) == 1:
        yield "  " + one_line(f"{_where(first)}: {first.says}{trend}")
        return
    same = all(change.says == first.says for change in group)
    said = first.says if same else f"all {first.share}"
    yield "  " + one_line(f"{_key(first)}, {len(group)} times: {said}{trend}")
    for change in shown:
        told = _where(change) if same else f"{_where(change)}: {change.says}"
        yield "    " + one_line(told)


def _where(change: Change) -> str:
    return change.where.removeprefix("steps/")
