"""One difference between two plans, and what kind of thing it is about."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeGuard, get_args

# causes before what follows from them: the order in which they are told
Kind = Literal[
    "inputs", "steps", "feature", "motion", "choice", "learnt", "feasibility",
    "prediction", "effects", "picture", "evidence", "other",
]  # fmt: skip
Trend = Literal["better", "worse", ""]

KINDS: tuple[Kind, ...] = get_args(Kind)
# what a kind is about, for help and documentation
ABOUT: Mapping[Kind, str] = {
    "inputs": "task, workcell, drawings, seed, preset",
    "steps": "steps and looks added, removed, reordered, or of another verb or target",
    "feature": "features of a part or a look: added, removed, moved",
    "motion": "where axes go, where things are thought to be, what to keep out of",
    "choice": "routines, zoom, focus, light, method, tolerance of an alignment",
    "learnt": "parameters that the routines chosen learnt from predicted images",
    "feasibility": "whether the plan is feasible, and the chance of success",
    "prediction": "errors, ranges, times and chances that the plan promises",
    "effects": "what is modelled, at which level, what is left out",
    "picture": "reference images, by pixel",
    "evidence": "what trials gave, of the routines chosen and of those rejected",
    "other": "all else",
}


class PathName(str):
    """A part of a path that somebody chose, as the id of a step; the rest are keys."""

    __slots__ = ()


def keys_of(path: Sequence[str]) -> str:
    """Return a path with its names masked: a step called "reason" is no reason."""
    return "/".join(":" if isinstance(part, PathName) else part for part in path)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanChange:
    """One difference that is beyond its tolerance."""

    path: tuple[str, ...]  # ("steps", "over_shaft", "control", "gain")
    kind: Kind
    old: Any  # plain JSON data; None if there was none
    new: Any
    says: str  # in words: what became what, and by how much
    trend: Trend = ""
    unit: str = ""  # of a number; "" has none

    @property
    def where(self) -> str:
        """Return the path as tolerances name it."""
        return "/".join(self.path)

    @property
    def share(self) -> str:
        """Return by how much of itself a number changed, "" where that says nothing."""
        old, new = self.old, self.new
        if not (is_number(old) and is_number(new) and old * new > 0):
            return ""
        return f"{100 * (new - old) / abs(old):+.3g} %"


def causes_first(changes: Iterable[PlanChange]) -> list[PlanChange]:
    """Return changes by kind: causes as the plan has them, of the rest worse first."""
    rank = {kind: index for index, kind in enumerate(KINDS)}
    follows = rank["feasibility"]

    def place(change: PlanChange) -> tuple[int, bool]:
        at = rank[change.kind]
        return at, at >= follows and change.trend != "worse"

    return sorted(changes, key=place)


def is_number(value: object) -> TypeGuard[int | float]:
    """Return whether a plain value is a number: yes and no are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)
