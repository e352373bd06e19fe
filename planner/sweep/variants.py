"""The variants of a task: each combination of the values that its keys are set to."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from microplan.planner.source.changed_values import NO_SWEEP, ChangedValue
from microplan.planner.source.diagnostics import CallError, Report
from microplan.planner.source.source import parse

MOST_ROWS = 10_000  # a day of twenty workers at three minutes a row


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """A key of the task or the workcell, and the values that it takes in turn."""

    key: str
    values: tuple[Any, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """One combination of values."""

    row: int  # from 1, the first key changing last
    values: Mapping[str, Any]  # by their keys

    @property
    def said(self) -> str:
        """Return the combination as text."""
        return ", ".join(f"{key}={written(v)}" for key, v in self.values.items())


class SweepError(CallError):
    """A sweep that cannot be made as it is asked for."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(NO_SWEEP, message, "", hint)


def settings(asked: Sequence[tuple[str, str]]) -> tuple[Setting, ...]:
    """Return the settings of keys and their values as written, parted by commas.

    Raises
    ------
    SweepError
        MP730 for values that are no YAML, keys given twice, too many rows.
    """
    found: dict[str, Setting] = {}
    for key, text in asked:
        if key in found:
            raise SweepError(f"{key} is set twice", "one --set with all its values")
        found[key] = Setting(key=key, values=_values(key, text))
    count = math.prod(len(each.values) for each in found.values())
    if count > MOST_ROWS:
        by_key = " x ".join(str(len(each.values)) for each in found.values())
        said = f"{by_key} values make {count} rows; allowed: {MOST_ROWS}"
        raise SweepError(said, "fewer values, or one sweep after another")
    return tuple(found.values())


def _values(key: str, text: str) -> tuple[Any, ...]:
    """Return values as YAML reads them in a list."""
    report = Report()
    source = parse(f"[{text}]", Path(), "--set", report)
    values = None if source is None or report.failed else source.data
    if not isinstance(values, list) or not values:
        said = report.found[0].message if report.found else "no values"
        hint = f"values as in the file, between commas: --set {key}=1,2.5"
        raise SweepError(f"--set {key}={text[:80]}: {said}", hint)
    return tuple(values)


def variants(asked: Sequence[Setting]) -> list[Variant]:
    """Return every combination, the values of the last setting changing first."""
    keys = [each.key for each in asked]
    combined = product(*(each.values for each in asked))
    return [
        Variant(row=row, values=dict(zip(keys, values, strict=True)))
        for row, values in enumerate(combined, 1)
    ]


def changes(variant: Variant) -> list[ChangedValue]:
    """Return what a variant changes of the files."""
    return [
        ChangedValue(key=tuple(key.split(".")), value=value)
        for key, value in variant.values.items()
    ]


def written(value: Any) -> str:
    """Return a value as a line of text, as YAML would take it."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
