"""Changes between plans in words, as JSON, or as findings."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from microplan.planner.diff.changes import KINDS, PathName, PlanChange, causes_first
from microplan.planner.source.diagnostics import Diagnostic, Severity, Span
from microplan.planner.store.summary import outside_words, success
from microplan.schemas.page.console import one_line
from microplan.schemas.plan import Plan

FEW = 12  # lines of a kind that are shown, unless all are asked for
FEW_ALIKE = 2  # places of changes that are alike
MORE = "--all shows them"
_THREE, _TWO, _XY = ("least", "as drawn", "most"), ("least", "most"), ("x", "y")
# what the entries of a list mean, by its key
_ENTRIES: Mapping[str, Sequence[str]] = {
    "clearance_um": _THREE, "capture_um": _THREE,
    "usable_focus_um": _TWO, "usable_magnification": _TWO, "covered_um": _TWO,
    "width_range_um": _TWO, "force_un": _TWO, "lift_un": _TWO, "weight_un": _TWO,
    "pull_un": _TWO, "hold_un": _TWO, "opening_um": _TWO,
    "bias_um": _XY, "fallback_bias_um": _XY, "offset_um": _XY, "theta_axis_um": _XY,
    "field_um": ("width", "height"), "covariance_um2": ("xx", "xy", "yy"),
}  # fmt: skip
_TOLD = ("where", "kind", "old", "new", "unit", "says", "trend")  # of a change
_ELSEWHERE = "worked out for other sizes, so that its points do not compare"


def changes_text(
    changes: Sequence[PlanChange],
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
        of_kind = [c for c in changes if c.kind == kind]
        if not of_kind:
            continue
        lines += ["", kind]
        sampled = {} if tell_all else _sampled(of_kind)
        known = {id(c) for found in sampled.values() for c in found}
        groups = _groups(c for c in of_kind if id(c) not in known)
        for group in groups if tell_all else groups[:FEW]:
            shown = group if tell_all or len(group) == 1 else group[:FEW_ALIKE]
            lines += _lines(group, shown)
            left_out += len(group) - len(shown)
        left_out += 0 if tell_all else sum(map(len, groups[FEW:]))
        for curve, found in sampled.items():
            lines.append("  " + one_line(f"{curve}: {_ELSEWHERE}"))
            left_out += len(found)
    lines += [""] if changes else []
    lines += [f"{left_out} not listed; {more}"] if left_out else []
    return "\n".join([*lines, verdicts_text(old, new)])


def headline(changes: Sequence[PlanChange]) -> str:
    """Return how many changes of each kind there are."""
    if not changes:
        return "the plans mean the same"
    counts = {kind: sum(c.kind == kind for c in changes) for kind in KINDS}
    told = ", ".join(f"{n} {kind}" for kind, n in counts.items() if n)
    one = "1 difference" if len(changes) == 1 else f"{len(changes)} differences"
    return f"{one}: {told}"


def verdicts_text(old: Plan, new: Plan) -> str:
    """Return P(success) and status of two plans, also where they are the same.

    What P(success) leaves out stands beside it.
    """
    chance = _both(success(old), success(new))
    verdict = f"P(success) {chance}, {_both(old.status, new.status)}"
    words = outside_words(new)
    before = outside_words(old)
    if before != words:
        words = f"{words or 'nothing left out'} (before: {before or 'nothing'})"
    return f"{verdict}; {words}" if words else verdict


def changes_json(
    changes: Sequence[PlanChange], old: tuple[str, Plan], new: tuple[str, Plan]
) -> str:
    """Return the changes as one JSON document, causes first; plans by their names."""
    said: dict[str, Any] = {
        "old": old[0],
        "new": new[0],
        "same": not changes,
        "verdicts": {
            key: {
                "status": plan.status,
                "success_probability": None
                if plan.is_sketch
                else plan.success_probability,
            }
            for key, (_, plan) in (("old", old), ("new", new))
        },
        "changes": [
            {name: getattr(change, name) for name in _TOLD}
            for change in causes_first(changes)
        ],
    }
    return json.dumps(said, indent=2, ensure_ascii=False)


def findings_of(
    changes: Sequence[PlanChange], failing: Sequence[PlanChange], file: str
) -> list[Diagnostic]:
    """Return one finding a change, causes first; what fails is different."""
    fails = {change.path for change in failing}
    return [
        Diagnostic(
            code="MP710",
            severity=_severity(change, failing=change.path in fails),
            where=Span(file=file),
            message=f"{change.kind}: {_counted(change.path)}: {_told(change)}",
            hint="",
        )
        for change in causes_first(changes)
    ]


def _severity(change: PlanChange, *, failing: bool) -> Severity:
    if failing:
        return "different"
    return "warning" if change.trend == "worse" else "note"


def _both(old: str, new: str) -> str:
    return f"{old} in both" if old == new else f"{old} before, {new} now"


def _groups(changes: Iterable[PlanChange]) -> list[list[PlanChange]]:
    """Return the changes of a kind, those together that changed by the same."""
    found: dict[tuple[str, ...], list[PlanChange]] = {}
    for change in causes_first(changes):
        alike = (change.trend, _key(change), change.share or change.says)
        found.setdefault(alike, []).append(change)
    return list(found.values())


def _sampled(changes: Sequence[PlanChange]) -> dict[str, list[PlanChange]]:
    """Return changes of curves whose points lie elsewhere: they compare nothing."""
    found: dict[tuple[str, ...], list[PlanChange]] = {}
    for change in changes:
        if "yields" in change.path and change.path[-3:-2] == ("points",):
            found.setdefault(change.path[:-3], []).append(change)
    return {
        "/".join(curve).removeprefix("steps/"): points
        for curve, points in found.items()
        if any(point.path[-1] == "value_um" for point in points)
    }


def _key(change: PlanChange) -> str:
    """Return what a value is called, without its index in a list."""
    keys = [p for p in change.path if not (p.isdigit() or isinstance(p, PathName))]
    return keys[-1] if keys else ""


def _lines(group: Sequence[PlanChange], shown: Sequence[PlanChange]) -> Iterator[str]:
    """Yield the lines of changes that are alike: what they share, then where."""
    first = group[0]
    trend = f", {first.trend}" if first.trend else ""
    if len(group) == 1:
        yield "  " + one_line(f"{_where(first)}: {_told(first)}")
        return
    same = all(change.says == first.says for change in group)
    said = first.says if same else f"all {first.share}"
    yield "  " + one_line(f"{_key(first)}, {len(group)} times: {said}{trend}")
    for change in shown:
        told = _where(change) if same else f"{_where(change)}: {change.says}"
        yield "    " + one_line(told)


def _told(change: PlanChange) -> str:
    """Return what became what, and whether that is better or worse."""
    return f"{change.says}, {change.trend}" if change.trend else change.says


def _where(change: PlanChange) -> str:
    return _counted(change.path).removeprefix("steps/")


def _counted(path: Sequence[str]) -> str:
    """Return a path, with the meaning of a list's entry where that is known.

    The number stays: tolerances name values by it.
    """
    where, key, last = "/".join(path), "/".join(path[-2:-1]), path[-1]
    names = _ENTRIES.get(key, ())
    if not last.isdigit() or isinstance(last, PathName) or int(last) >= len(names):
        return where
    return f"{where} ({names[int(last)]})"
