"""Differences between plans: their kind, and their trend for better or worse."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any, Literal, TypeGuard, get_args

# patterns of paths, the first that matches counts
_KINDS: tuple[tuple[str, Kind], ...] = (
    ("status", "feasibility"),
    ("reasons*", "feasibility"),
    ("success_*", "feasibility"),
    ("*/budget/success_probability", "feasibility"),
    ("provenance*", "inputs"),
    ("features*", "feature"),
    ("*/evidence*", "evidence"),
    ("*/measure/feature", "feature"),
    ("*/looks/*/others*", "feature"),
    ("*/parameters*", "learnt"),
    ("*/chain*", "choice"),
    ("*/fallback", "choice"),
    ("*/fallback/*", "choice"),
    ("*/looks/*/view*", "choice"),
    ("*/control/method", "choice"),
    ("*/control/choice*", "choice"),
    ("*/control/gain*", "choice"),
    ("*/control/tolerance_*", "choice"),
    ("*/together*", "choice"),
    ("*/coarse*", "choice"),
    ("*/effects*", "effects"),
    ("*/scene*", "effects"),
    ("*/moves*", "motion"),
    ("*/action*", "motion"),
    ("*/retreat*", "motion"),
    ("*/region*", "motion"),
    ("*/reference*", "motion"),
    ("beliefs*", "motion"),
    ("stage_start*", "motion"),
    ("robot_start*", "motion"),
    ("requirements*", "motion"),
    ("parts*", "motion"),
    ("fingers*", "motion"),
    ("steps", "steps"),
    ("steps/*/verb", "steps"),
    ("steps/*/looks/*/target", "steps"),
    ("steps/*/looks", "steps"),
    ("steps/*", "prediction"),
)

# `[0-2]` are entries of a list: least, as drawn, most
_LESS_IS_BETTER = (
    "*sigma_*", "*bias_um/[01]", "*/bias_[xy]_um", "*worst_um", "*silent*",
    "*expected_s", "*expected_cycles", "*time_s", "*total_s", "*approach_s",
    "*/looks/*/effects/*/predicted_error", "*miss_probability", "*cost",
    "*ratio_to_*", "*/taper_um", "*/tilt_rad", "*/tilt_takes_um",
    "*/grasp/needed_um", "*/usable_focus_um/0", "*/usable_magnification/0",
    "*/placing/half_um", "*/placing/most_um", "*/allowed/*/least",
    "*half_width*", "*undetected*", "*/trials_needed",
)  # fmt: skip
_MORE_IS_BETTER = (
    "*success", "*success_lower", "*_probability", "*capture_um", "*capture_um/[0-2]",
    "*clearance_um/[0-2]", "*robustness", "*uniqueness", "*completeness",
    "*largest_um", "*/allowed/*/most", "*/tilt_limit_rad", "*/wedging_rad",
    "*/grasp/room_um", "*/focus/margin_um", "*/usable_focus_um/1",
    "*/usable_magnification/1", "*success_low", "*mechanical_low", "*/reachable",
)  # fmt: skip
# what is asked for or assumed, and no more than a sample of a curve
_NEITHER = (
    "success_goal", "*/required_probability", "*/stick_probability", "*/yields/*",
    "provenance*",
)  # fmt: skip
# of a step's own effects few are errors: the rest are forces and ranges
_STEP_EFFECT = "steps/:/effects/:/predicted_error"
_EFFECTS: Mapping[str, Trend] = {"taper": "worse", "wedging": "better"}  # if it grows
_OTHER: Mapping[Trend, Trend] = {"better": "worse", "worse": "better"}


def kind_of(path: Sequence[str]) -> Kind:
    """Return what a change at `path` is about."""
    where = keys_of(path)
    for pattern, kind in _KINDS:
        if fnmatchcase(where, pattern):
            return kind
    return "other"


def trend_of(path: Sequence[str], old: Any, new: Any) -> Trend:
    """Return whether a value got better or worse, "" if it cannot be said."""
    where = keys_of(path)
    if where == "status":
        if "sketch" in (old, new):
            return ""  # nobody has tried it
        return "worse" if new == "infeasible" else "better"
    if isinstance(old, bool) or isinstance(new, bool):
        return ""
    if not (isinstance(old, (int, float)) and isinstance(new, (int, float))):
        return ""
    grown = _if_it_grows(path, where)
    size = abs if any("bias" in key for key in where.split("/")[-2:]) else float
    if grown == "" or size(new) == size(old):
        return ""
    return grown if size(new) > size(old) else _OTHER[grown]


def _if_it_grows(path: Sequence[str], where: str) -> Trend:
    """Return whether a number that grows gets better or worse, "" if neither."""
    if fnmatchcase(where, _STEP_EFFECT):
        return _EFFECTS.get(path[-2], "")
    if any(fnmatchcase(where, pattern) for pattern in _NEITHER):
        return ""
    if any(fnmatchcase(where, pattern) for pattern in _LESS_IS_BETTER):
        return "worse"
    if any(fnmatchcase(where, pattern) for pattern in _MORE_IS_BETTER):
        return "better"
    return ""


# causes before what follows from them: the order in which they are shown
Kind = Literal[
    "inputs", "steps", "feature", "motion", "choice", "learnt", "feasibility",
    "prediction", "effects", "picture", "evidence", "other",
]  # fmt: skip
Trend = Literal["better", "worse", ""]

KINDS: tuple[Kind, ...] = get_args(Kind)


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
