"""References by name in a task: each must lead to a thing of the right kind."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.schema import Checked, did_you_mean
from microplan.planner.source.source import Key
from microplan.planner.task.parts import CENTRE
from microplan.schemas.files import json_schema

# what a key of a step may name
_STEP_KINDS = {
    "locate": {"target": "part pattern feature post tool"},
    "align": {
        "target": "part pattern feature post tool grip",
        "to": "part pattern feature post tool grip",
    },
    "grasp": {"target": "part", "with": "tool"},
    "insert": {"target": "part feature", "onto": "post feature"},
    "release": {"target": "part"},
    "verify": {
        "target": "part feature", "on": "part pattern post feature", "empty": "tool",
    },
}  # fmt: skip
_INNER = ("features", "posts", "marks")  # what has names within a part
_STARTING = ("part", "pattern", "tool")  # a pattern: a part of separate outlines
_MATE_KINDS = {"hole": "feature", "shaft": "post", "seated_on": "part pattern"}


@dataclass(frozen=True, slots=True)
class Names:
    """Every name of a task with its kind; also those of faulty things."""

    kinds: Mapping[str, str]  # "gear.bore" -> "feature"
    whole: bool  # False if the workcell could not be read, so that tools are unknown
    refused: frozenset[str]  # names that are invalid or ambiguous

    def like(self, name: str, known: Iterable[str], own: str = "") -> str:
        """Return the hint for a name that is lost among known ones of its kind.

        One that was refused itself is no way out. Names are given without the prefix
        `own`.
        """
        near = sorted(k.removeprefix(own) for k in set(known) - self.refused)
        return did_you_mean(name, near) or f"known: {', '.join(near) or 'none'}"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Lost:
    """One use of a name that leads nowhere."""

    name: str
    at: Span
    message: str
    hint: str


def check_references(task: Checked, cell: Checked | None, report: Report) -> None:
    """Report names that lead nowhere, to the wrong kind, or are given twice."""
    names = _names(task, cell, _clashes(task, cell, report))
    lost: list[_Lost] = []
    for where, kinds in _uses(task):
        if task.good(*where):
            _check_use(task, names, where, kinds, report, lost)
    _check_starts(task, names, report, lost)
    _report_lost(names, lost, report)
    _check_ids(task, report)


def _names(task: Checked, cell: Checked | None, clashes: Iterable[str]) -> Names:
    kinds: dict[str, str] = {}
    refused = set(clashes)
    for part, raw in task.source.mapping("parts").items():
        is_one = not (isinstance(raw, Mapping) and raw.get("separate") is True)
        kinds[part] = "part" if is_one else "pattern"
        kinds[f"{part}.outline"] = "feature"
        kinds.update({f"{part}.{n}": "feature" for n in _mapping(raw, "features")})
        kinds.update({f"{part}.{n}": "mark" for n in _mapping(raw, "marks")})
        kinds.update({f"{part}.{n}": "post" for n in _mapping(raw, "posts")})
        inner = [n for key in _INNER for n in _mapping(raw, key)]
        refused |= {f"{part}.{n}" for n in inner if not _is_name(n)}
        if part in refused or not _is_name(part):
            refused |= {part, f"{part}.outline", *(f"{part}.{n}" for n in inner)}
    for tool in cell.source.mapping("tools") if cell else ():
        kinds[tool] = "tool"
        kinds[f"{tool}.grip"] = "grip"
        if not _is_name(tool):
            refused |= {tool, f"{tool}.grip"}
    return Names(kinds, whole=cell is not None, refused=frozenset(refused))


def _is_name(text: str) -> bool:
    """Return whether the schema takes a text for a name."""
    rule = _name_rule()
    fits = re.search(rule["pattern"], text) is not None
    return fits and len(text) <= rule["maxLength"]


@cache
def _name_rule() -> dict[str, Any]:
    rule: dict[str, Any] = json_schema.load("task")["$defs"]["name"]
    return rule


def _mapping(data: Any, key: str) -> Mapping[str, Any]:
    """Return the mapping under `key`, empty if there is none."""
    found = data.get(key) if isinstance(data, dict) else None
    return found if isinstance(found, dict) else {}


def _clashes(task: Checked, cell: Checked | None, report: Report) -> set[str]:
    """Report ambiguous names, and return them."""
    found: set[str] = set()
    tools = cell.source.mapping("tools") if cell else {}
    for part, raw in task.source.mapping("parts").items():
        if part in tools or part in ("stage", "robot"):
            what = "a tool" if part in tools else "an axis group"
            at = task.source.key("parts", part)
            report.error("MP117", at, f"'{part}' is also the name of {what}")
            found.add(part)
        first: dict[str, str] = {}
        for kind in _INNER:
            for name in _mapping(raw, kind):
                if name in first:
                    at = task.source.key("parts", part, kind, name)
                    message = f"'{name}' is also a {first[name]} of {part}"
                    report.error("MP117", at, message)
                    found.add(f"{part}.{name}")
                first.setdefault(name, kind.removesuffix("s"))
    return found


def _uses(task: Checked) -> Iterator[tuple[tuple[Key, ...], str]]:
    """Yield the keys of every reference, and which kinds it may name."""
    for key in task.source.mapping("goal", "mate"):
        if key in _MATE_KINDS:
            yield ("goal", "mate", key), _MATE_KINDS[key]
    for index, step in enumerate(task.source.items("steps")):
        verb = step.get("do") if isinstance(step, dict) else None
        reads = _STEP_KINDS.get(verb, {}) if isinstance(verb, str) else {}
        for key, kinds in reads.items():
            if key in step:
                yield ("steps", index, key), kinds
    for part in task.source.mapping("parts"):
        origin = task.source.get("parts", part, "origin")
        if isinstance(origin, str) and origin != CENTRE:
            yield ("parts", part, "origin"), "own feature"


def _check_use(
    task: Checked,
    names: Names,
    where: tuple[Key, ...],
    kinds: str,
    report: Report,
    lost: list[_Lost],
) -> None:
    """Report a name that leads to the wrong kind of thing; note one that is lost."""
    name = task.source.get(*where)
    at = task.source.value(*where)
    own = ""
    if kinds == "own feature":
        own, kinds = f"{where[1]}.", "feature"
        near = [known for known in names.kinds if known.startswith(own)]
    else:
        near = [known for known, kind in names.kinds.items() if kind in kinds.split()]
    full = f"{own}{name}"
    kind = names.kinds.get(full)
    if kind in kinds.split():
        return
    if kind is None and not names.whole and kinds != "feature":
        return  # it may be a tool of the workcell that could not be read
    if kind is None:
        message, hint = f"nothing is called '{name}'", names.like(name, near, own)
        lost.append(_Lost(name=full, at=at, message=message, hint=hint))
    else:
        wanted = " or ".join(kinds.split())
        message = f"'{name}' is a {kind}, a {wanted} is needed here"
        report.error("MP112", at, message, names.like("", near, own))


def _check_starts(
    task: Checked, names: Names, report: Report, lost: list[_Lost]
) -> None:
    """Report things in use that start nowhere; note starts of unknown things."""
    starts = task.source.mapping("start")
    for name, raw in starts.items():
        if name == "stage" or not task.good("start", name):
            continue
        at, kind = task.source.key("start", name), names.kinds.get(name)
        wanted = "part" if raw["on"] == "stage" else "tool"
        fits = (wanted, "pattern") if wanted == "part" else (wanted,)
        if kind is None and (wanted == "part" or names.whole):
            near = [known for known, k in names.kinds.items() if k in fits]
            hint = names.like(name, near)
            message = f"no {wanted} is called '{name}'"
            lost.append(_Lost(name=name, at=at, message=message, hint=hint))
        elif kind not in (None, *fits):
            message = f"'{name}' is a {kind}, on the {raw['on']} stands a {wanted}"
            report.error("MP112", at, message)
    reported = set(starts)
    for where, _ in _uses(task):
        name = task.source.get(*where)
        if where[0] == "parts" or not isinstance(name, str) or not task.good(*where):
            continue
        owner = name.partition(".")[0]
        if owner not in reported and names.kinds.get(owner) in _STARTING:
            reported.add(owner)  # once is enough
            message = f"'{owner}' is used here and has no entry in start"
            report.error("MP115", task.source.value(*where), message, f"add {owner}")


def _report_lost(names: Names, lost: list[_Lost], report: Report) -> None:
    """Report each lost name once, at its first use.

    Of an unknown part everything is unknown: its features are not named one by one.
    """
    groups: dict[str, list[_Lost]] = {}
    for use in sorted(lost, key=lambda use: (use.at.line, use.at.column)):
        owner = use.name.partition(".")[0]
        root = use.name if owner in names.kinds else owner
        groups.setdefault(root, []).append(use)
    for first, *rest in groups.values():
        lines = ", ".join(str(line) for line in sorted({use.at.line for use in rest}))
        more = f"; it is also used in line {lines}" if rest else ""
        report.error("MP110", first.at, f"{first.message}{more}", first.hint)


def _check_ids(task: Checked, report: Report) -> None:
    """Report step ids that are given twice."""
    seen: dict[str, int] = {}
    for index, step in enumerate(task.source.items("steps")):
        if not task.good("steps", index, "id"):
            continue
        at = task.source.value("steps", index, "id")
        if step["id"] in seen:
            message = f"step '{step['id']}' is already in line {seen[step['id']]}"
            report.error("MP111", at, message, "give each step its own id")
        seen.setdefault(step["id"], at.line)
