"""What a change is about, by where it is; and whether it is one for the better."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Any

from planner.comparing.changes import Kind, Trend, keys_of

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
_LESS_IS_BETTER = (
    "*sigma_*", "*/bias*", "*worst_um", "*silent*", "*expected_s", "*expected_cycles",
    "*time_s", "*total_s", "*predicted_error", "*miss_probability", "*cost",
    "*ratio_to_*",
)  # fmt: skip
_MORE_IS_BETTER = (
    "*success*", "*capture_um", "*robustness", "*uniqueness", "*completeness",
    "*clearance_um/*", "*largest_um",
)  # fmt: skip


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
        return "worse" if new == "infeasible" else "better"
    if isinstance(old, bool) or isinstance(new, bool):
        return ""
    if not (isinstance(old, (int, float)) and isinstance(new, (int, float))):
        return ""
    if any(fnmatchcase(where, pattern) for pattern in _LESS_IS_BETTER):
        return "better" if abs(new) < abs(old) else "worse"
    if any(fnmatchcase(where, pattern) for pattern in _MORE_IS_BETTER):
        return "better" if new > old else "worse"
    return ""
