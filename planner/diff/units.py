"""The units of a plan's numbers, by the keys that they stand under."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from microplan.planner.diff.changes import PathName

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
    """Return the unit of the number at a path, "" if its key tells none.

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
    """Return the unit that an entry states beside its numbers, "" if it states none."""
    unit = entry.get("unit", "")
    return unit if isinstance(unit, str) and unit != "1" else ""
