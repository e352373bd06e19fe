"""Outcomes of a run: predicted against actual, as a table or as summary.json."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from microplan.schemas.codec import to_data
from microplan.schemas.plan import Plan

_HEAD = (
    "step",
    "result",
    "looks / expected",
    "error / limit um",
    "look error / sigma um",
    "time / expected s",
)
_LOOK = 4  # the column of looks


def summary_json(plan: Plan, result: RunResult, extra: dict[str, Any]) -> str:
    """Return the run's summary; `extra` are keys of the station, e.g. its verdict."""
    data = {
        "plan": plan.name,
        "done": result.done,
        "success_probability": plan.success_probability,
        "success_low": None
        if plan.success_bound is None
        else plan.success_bound.success_low,
        **to_data(result),
        **extra,
    }
    return json.dumps(data, indent=2, ensure_ascii=False) + "\n"


def table(result: RunResult, errors_um: Mapping[str, float] | None = None) -> str:
    """Return one line a step: what happened / what the plan predicted.

    `errors_um` are the true errors of the steps' last looks, which only a simulated
    cell knows; elsewhere the routines' own estimates are shown.
    """
    known = errors_um or {}
    head = list(_HEAD)
    if not known:
        head[_LOOK] = "own estimate / sigma um"
    looks = [known.get(s.id) if known else s.spread_um for s in result.steps]
    rows = [_row(s, look) for s, look in zip(result.steps, looks, strict=True)]
    return columns([head, *rows])


def injected(faults: Sequence[str], idle: Sequence[str] | None) -> str:
    """Return the faults that were asked for in words, "" if none were.

    Nothing met the `idle` ones; None: that is not known.
    """
    if faults and idle is None:
        return f"{', '.join(faults)} (whether anything met them is not known)"
    known = idle or ()
    return ", ".join(f"{f} (met by nothing)" if f in known else f for f in faults)


def columns(rows: Sequence[Sequence[str]]) -> str:
    """Return rows of the same number of cells as lines, the cells below each other."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = (
        "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
    return "\n".join(lines)


def _row(step: StepResult, look: float | None) -> tuple[str, ...]:
    """Return the cells of one step; `look` is the error of its last look, um."""
    return (
        step.id,
        "ok" if step.code is None else step.code,
        _pair(step.cycles, step.expected_cycles),
        _pair(step.error_um, step.limit_um),
        _pair(look, step.expected_sigma_um),
        _pair(step.time_s, step.expected_s),
    )


def _pair(actual: float | None, predicted: float | None) -> str:
    """Return "actual / predicted", "-" for what is not known."""
    if actual is None and predicted is None:
        return "-"
    return " / ".join("-" if v is None else f"{v:.3g}" for v in (actual, predicted))


@dataclass(frozen=True, slots=True, kw_only=True)
class StepResult:
    """Result of one step; None where a number does not apply."""

    id: str
    verb: str
    code: str | None  # why it failed; None: done
    message: str
    time_s: float
    expected_s: float | None
    cycles: int | None
    expected_cycles: float | None
    error_um: float | None  # align: last error; verify: offset
    limit_um: float | None
    spread_um: float | None  # the routine's own sigma
    expected_sigma_um: float | None  # from the trials
    height_um: float | None
    turn_rad: float | None = None  # verify: against the seat, if it was asked for


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """Result of a run; `code` is None if everything was done and verified."""

    code: str | None
    message: str
    step: str | None  # where it failed
    steps: tuple[StepResult, ...]
    time_s: float

    @property
    def done(self) -> bool:
        """Return whether the executor vouches for the result."""
        return self.code is None
