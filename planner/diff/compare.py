"""Comparison of two plans: every difference beyond its tolerance."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from microplan.planner.diff.changes import (
    Kind,
    PathName,
    PlanChange,
    is_number,
    keys_of,
    kind_of,
    trend_of,
)
from microplan.planner.diff.identity import ORDERED, WHOLE, named
from microplan.planner.diff.tolerances import Rule, rule_for, stated_unit, unit_of
from microplan.schemas.codec import to_data
from microplan.schemas.plan import Plan

Path = tuple[str, ...]
_BY_NAME = frozenset({"drawings_sha256", "travel", "repeatability_um"})
_LONG = 100  # characters of a value that are shown
_DIGEST = 12  # digits of a hash that are
# hashes of what a plan was made from: what another one means
_ANOTHER: Mapping[str, str] = {
    "provenance/task_sha256": "the task says something else",
    "provenance/workcell_sha256": "the workcell says something else",
    "provenance/drawings_sha256/:": "another drawing, or the task says something else "
    "of the part",
}

# what a sketch has not, and its looks in place of it
_TRIED = (
    "success_probability", "success_bound", "requirements", "steps", "sketched",
)  # fmt: skip


def compare_plans(
    old: Plan, new: Plan, rules: Sequence[Rule] = ()
) -> tuple[PlanChange, ...]:
    """Return the differences in meaning, in the order of the plans.

    Steps, looks, features, effects and the like are matched by what they are called. A
    plan of an older minor version is compared with the defaults of its missing keys;
    of a sketch nothing that trials tell.

    Parameters
    ----------
    old, new : Plan
        What is compared.
    rules : sequence of Rule
        Tolerances that come before `tolerances.TABLE`.
    """
    before, after = to_data(old), to_data(new)
    if old.is_sketch != new.is_sketch:
        after |= {key: before[key] for key in _TRIED}
    found = [*_moved(before, after, rules)]
    for data in (before, after):
        for place in data["features"]:  # compared as positions, above
            del place["x_um"], place["y_um"]
    found += _differences(before, after, (), rules)
    return tuple(found)


def _differences(
    old: Any,
    new: Any,
    path: Path,
    rules: Sequence[Rule],
    units: tuple[str, str] = ("", ""),
) -> Iterator[PlanChange]:
    """Yield the differences below `path`; `units` of numbers whose keys have none."""
    if rule_for(path, rules).ignored:
        return
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        yield from _mappings(old, new, path, rules)
    elif isinstance(old, list) and isinstance(new, list):
        yield from _lists(old, new, path, rules)
    elif not rule_for(path, rules).same(old, new):
        yield _changed(path, old, new, units)


def _mappings(
    old: Mapping[str, Any], new: Mapping[str, Any], path: Path, rules: Sequence[Rule]
) -> Iterator[PlanChange]:
    """Yield the differences of two mappings, key by key."""
    if keys_of(path[-1:]) in _BY_NAME:
        old, new = _by_name(old), _by_name(new)
    units = stated_unit(old), stated_unit(new)
    for key in [*old, *(key for key in new if key not in old)]:
        if key in old and key in new:
            yield from _differences(old[key], new[key], (*path, key), rules, units)
        elif not rule_for((*path, key), rules).ignored:
            yield _one_sided((*path, key), old.get(key), new.get(key), added=key in new)


def _by_name(entries: Mapping[str, Any]) -> dict[str, Any]:
    """Return entries whose keys are names."""
    return {PathName(name): entry for name, entry in entries.items()}


def _lists(
    old: list[Any], new: list[Any], path: Path, rules: Sequence[Rule]
) -> Iterator[PlanChange]:
    """Yield the differences of two lists, by names where their entries have them."""
    key = path[-1] if path else ""
    before, after = named(key, old), named(key, new)
    if before is None or after is None:
        yield from _positions(old, new, path, rules)
        return
    if key in WHOLE and list(before) != list(after):
        yield _changed(path, _chain(before), _chain(after))
        after = {name: entry for name, entry in after.items() if name in before}
        before = {name: entry for name, entry in before.items() if name in after}
    if key in ORDERED:
        common = [name for name in before if name in after]
        order = [name for name in after if name in before]
        if common != order:
            words = f"order {_chain(common)} became {_chain(order)}"
            yield PlanChange(
                path=path, kind=kind_of(path), old=common, new=order, says=words
            )
    yield from _mappings(_by_name(before), _by_name(after), path, rules)


def _chain(names: Iterable[str]) -> str | None:
    """Return routines as they are written, coarse to fine."""
    return " > ".join(names) or None


def _positions(
    old: list[Any], new: list[Any], path: Path, rules: Sequence[Rule]
) -> Iterator[PlanChange]:
    """Yield the differences of two lists of numbers or words, by position."""
    if len(old) != len(new):
        yield _changed(path, old, new)
        return
    for index, (before, after) in enumerate(zip(old, new, strict=True)):
        yield from _differences(before, after, (*path, str(index)), rules)


def _changed(
    path: Path, old: Any, new: Any, units: tuple[str, str] = ("", "")
) -> PlanChange:
    """Return the change of one value."""
    before, after = (unit_of(path) or unit for unit in units)
    found = PlanChange(
        path=path, kind=kind_of(path), old=old, new=new,
        says=f"{_measured(old, before)} became {_measured(new, after)}",
        trend=trend_of(path, old, new), unit=after if _has_unit(old, new) else "",
    )  # fmt: skip
    another = _ANOTHER.get(keys_of(path))
    if another is not None:
        ends = f"{str(old)[:_DIGEST]}... became {str(new)[:_DIGEST]}..."
        return replace(found, says=f"{another} ({ends})")
    share = f" ({found.share})" if found.share else ""
    return replace(found, says=found.says + share)


def _one_sided(path: Path, old: Any, new: Any, *, added: bool) -> PlanChange:
    """Return something that only one plan has."""
    what = new if added else old
    says = "added" if added else "removed"
    if not isinstance(what, (Mapping, list)):
        says += f": {_measured(what, unit_of(path))}"
    unit = unit_of(path) if is_number(what) else ""
    return PlanChange(
        path=path, kind=_kind(path), old=old, new=new, says=says, unit=unit
    )


def _kind(path: Path) -> Kind:
    """Return what something added or removed is about."""
    is_step = len(path) == 2 and path[0] == "steps"  # steps/ID
    is_look = len(path) == 4 and path[2] == "looks"  # steps/ID/looks/ID
    return "steps" if is_step or is_look else kind_of(path)


def _moved(
    old: Mapping[str, Any], new: Mapping[str, Any], rules: Sequence[Rule]
) -> Iterator[PlanChange]:
    """Yield features that lie elsewhere in their part, in um and a look's sigmas."""
    before, after = (
        named("features", old["features"]),
        named("features", new["features"]),
    )
    sigmas = _sigmas(old)
    for name, place in (before or {}).items():
        there = (after or {}).get(name)
        if there is None:
            continue
        path: Path = ("features", PathName(name), "place_um")
        ends = [[at["x_um"], at["y_um"]] for at in (place, there)]
        far_um, rule = math.dist(*ends), rule_for(path, rules)
        if rule.ignored or far_um <= max(
            rule.absolute, rule.relative * math.hypot(*ends[0])
        ):
            continue
        says = f"moved {far_um:.4g} um, from {_shown(ends[0])} to {_shown(ends[1])} um"
        if sigmas.get(name):
            says += f": {far_um / sigmas[name]:.3g} sigma of the look at it"
        yield PlanChange(
            path=path, kind="feature", old=ends[0], new=ends[1], says=says, unit="um"
        )


def _sigmas(plan: Mapping[str, Any]) -> dict[str, float]:
    """Return the finest sigma, um, with which any look finds each feature."""
    found: dict[str, float] = {}
    for step in plan["steps"]:
        for look in step["looks"]:
            for measure in (look["measure"], *look["others"]):
                name, sigma = (
                    measure["feature"] or look["target"],
                    measure["sigma_xy_um"],
                )
                found[name] = min(sigma, found.get(name, math.inf))
    return found


def _has_unit(*values: Any) -> bool:
    """Return whether any of these is a number, or a list of numbers."""
    return any(
        is_number(value) or (isinstance(value, list) and all(map(is_number, value)))
        for value in values
    )


def _measured(value: Any, unit: str) -> str:
    """Return a value in words, numbers with their unit."""
    return f"{_shown(value)} {unit}".rstrip() if _has_unit(value) else _shown(value)


def _shown(value: Any) -> str:
    """Return a value in words, cut where it is long."""
    if value is None:
        return "nothing"
    if isinstance(value, str):
        text = value
    elif isinstance(value, list):
        text = "(" + ", ".join(map(_shown, value)) + ")"
    elif isinstance(value, Mapping):
        text = "{" + ", ".join(value) + "}"
    elif isinstance(value, bool):
        text = "yes" if value else "no"
    else:
        text = f"{value:.6g}"
    return text if len(text) <= _LONG else text[: _LONG - 3] + "..."
