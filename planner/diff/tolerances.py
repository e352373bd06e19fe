"""Tolerances of a plan's values, field by field, with their units.

A rule's pattern is matched against the path of a value, as in
`steps/over_shaft/control/gain`, from its end: `control/gain` means every step's.
`*` matches anything, also for several parts of a path. The first rule that matches
counts; those that a user states come before the table.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import Any

from microplan.planner.diff.changes import PathName, is_number, keys_of

# ends of keys, the longer ones before those that they end in
_ENDS: tuple[tuple[str, str], ...] = (
    ("um_per_px", "um/px"), ("px_per_um", "px/um"), ("um_per_s", "um/s"),
    ("per_um", "1/um"), ("per_px", "1/px"), ("um2", "um2"), ("um", "um"),
    ("rad", "rad"), ("px", "px"), ("un", "uN"), ("s", "s"), ("e", "electrons"),
)  # fmt: skip
_KEYS: Mapping[str, str] = {
    "magnification": "x", "row": "px", "rows": "px", "column": "px", "columns": "px",
    "bits": "bits", "max_image_error": "unit contrast",
}  # fmt: skip


def unit_of(path: Sequence[str]) -> str:
    """Return the unit of the number at a path, "" if its key has none.

    An entry of a list, or one that goes by a name, has the unit of the list's key.
    """
    for part in reversed(path):
        for end, unit in _ENDS:
            if part.endswith(f"_{end}") or part == end:
                return unit
        if part in _KEYS:
            return _KEYS[part]
        if not (part.isdigit() or isinstance(part, PathName)):
            return ""
    return ""


def stated_unit(entry: Mapping[str, Any]) -> str:
    """Return the unit that an entry states for its numbers, "" if it states none."""
    unit = entry.get("unit", "")
    return unit if isinstance(unit, str) and unit != "1" else ""


_NUMBER = re.compile(r"(?:[<>] )?[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?%?")


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """How values at a path are compared."""

    pattern: str
    relative: float = 0.0
    absolute: float = 0.0
    ignored: bool = False
    words: bool = False  # a sentence, in which numbers may differ

    def __post_init__(self) -> None:
        for name in ("relative", "absolute"):
            value = getattr(self, name)
            if not (value >= 0 and math.isfinite(value)):
                raise ValueError(f"{name} must be finite and >= 0, got {value}")

    def matches(self, path: str) -> bool:
        """Return whether a value at `path` is compared by this rule."""
        return fnmatchcase(path, self.pattern) or fnmatchcase(path, f"*/{self.pattern}")

    def same(self, old: Any, new: Any) -> bool:
        """Return whether two plain values agree."""
        if self.ignored:
            return True
        if is_number(old) and is_number(new):
            return math.isclose(old, new, rel_tol=self.relative, abs_tol=self.absolute)
        if self.words and isinstance(old, str) and isinstance(new, str):
            return _NUMBER.sub("#", old) == _NUMBER.sub("#", new)
        return type(old) is type(new) and bool(old == new)


# Numbers are written with 6 digits; sums in another order may change the last ones.
EXACT = Rule(pattern="*", relative=1e-4, absolute=1e-6)

# What trials measure may move by one borderline trial of the 24 that `fast` makes.
_MEASURED = (
    "sigma_um", "sigma_xy_um", "sigma_theta_rad", "sigma_upper_um", "ratio_to_limit",
    "bias_um/*", "bias_x_um", "bias_y_um", "fallback_sigma_*", "fallback_bias_um/*",
    "worst_um", "min_score", "fallback_min_score", "success_lower", "silent_upper",
    "tolerance_xy_um", "evidence/tolerance_um", "expected_cycles", "expected_s",
    "options/*/looks", "max_spread_um", "robustness", "resolution_um",
    "slope_per_um", "largest_um", "size_um", "halvings", "floor_s",
    "ratio_to_floor", "covariance_um2/*", "miss_probability",
    "sigma_um/*", "half_width_um", "half_width_um/*", "half_width_theta_rad",
    "bias_theta_rad", "interval_um/*", "interval_theta_rad", "spread_um/*",
    "spread_theta_rad", "drawn_um/*", "drawn_theta_rad", "spared_um/*",
    "trueness_um/*", "trueness_rad",
)  # fmt: skip

TABLE: tuple[Rule, ...] = (
    # checked by their meaning, or different on every machine
    Rule(pattern="steps/*/key", ignored=True),
    Rule(pattern="scene/image", ignored=True),
    Rule(pattern="image_sha256", ignored=True),
    Rule(pattern="arrays", ignored=True),
    Rule(pattern="format_version", ignored=True),
    Rule(pattern="provenance/microplan", ignored=True),
    # sentences
    *(Rule(pattern=name, words=True)
      for name in ("reason", "message", "advice", "source", "what")),
    # counts of trials, and which of them was the worst
    Rule(pattern="evidence/*/success", absolute=1),
    Rule(pattern="evidence/*/silent", absolute=1),
    *(Rule(pattern=f"evidence/*{name}_trial", ignored=True)
      for name in ("worst", "median", "first_failing")),
    # of random trials: one far error moves the fourth moment most
    *(Rule(pattern=f"repeatability/{name}", absolute=1)
      for name in ("answered", "undetected")),
    Rule(pattern="repeatability/kurtosis*", relative=0.5),
    Rule(pattern="success_bound/undetected", absolute=1),
    Rule(pattern="success_bound/trials_needed", ignored=True),
    # chances: a sigma that moves by a fifth moves them by less
    *(Rule(pattern=name, absolute=0.01)
      for name in ("success_probability", "halved_probability", "success_low",
                   "mechanical_low", "undetected_upper", "reachable")),
    *(Rule(pattern=name, relative=0.2, absolute=2e-3) for name in _MEASURED),
)  # fmt: skip


def rule_for(path: Sequence[str], stated: Sequence[Rule] = ()) -> Rule:
    """Return the rule by which values at `path` are compared.

    Those that a user states are matched against names too, the table against keys
    alone.
    """
    where = "/".join(path)
    found = next((rule for rule in stated if rule.matches(where)), None)
    return found or _known(keys_of(path))


@lru_cache(maxsize=4096)  # a plan has some hundred keys, and ten thousand values
def _known(keys: str) -> Rule:
    """Return the rule of the table for a path of keys."""
    return next((rule for rule in TABLE if rule.matches(keys)), EXACT)


def parse_rule(text: str) -> Rule:
    """Return the rule that a user states.

    `PATTERN=0.1` is an absolute tolerance, `PATTERN=5%` one relative to the larger of
    both values, `PATTERN=ignore` leaves out everything below that path.

    Raises
    ------
    ValueError
        If it is none of these.
    """
    pattern, equals, value = text.rpartition("=")
    if not equals or not pattern:
        raise ValueError(f"{text!r} is not PATTERN=TOLERANCE")
    if value == "ignore":
        return Rule(pattern=pattern, ignored=True)
    if value.endswith("%"):
        return Rule(pattern=pattern, relative=float(value[:-1]) / 100)
    return Rule(pattern=pattern, absolute=float(value))
