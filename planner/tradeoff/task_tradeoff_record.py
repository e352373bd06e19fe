"""Record of a task tradeoff: points, times, their table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

from microplan.planner.tradeoff.tradeoff_record import aligned, csv_rows
from microplan.schemas.page.figures import chance


@dataclass(frozen=True, slots=True, kw_only=True)
class TradeoffPoint:
    """One method of compiling the task, and what the plan then predicts."""

    varied: str  # "preset fast", "zoom 13.8"; "as the task says" is compared with
    preset: str
    trials: int
    frames: int  # averaged for each look
    zoom: float | None  # that all looks have; None: as chosen
    status: str  # of the plan, or "error"
    reason: str  # "" if feasible
    error_um: float | None  # one sigma per axis at the last part's goal; None: no part
    success_probability: float | None  # None: the plan ends before it is known
    success_lower: float | None  # its lower bound, 95 %
    run_s: float | None  # looks and alignments, no moves between
    choices: tuple[str, ...] | None  # that are others than in the first point
    on_front: bool  # no other is both quicker to run and finer


@dataclass(frozen=True, slots=True, kw_only=True)
class Spent:
    """What compiling a point took, nothing kept from before: of this machine."""

    varied: str
    cpu_s: float  # of all processes
    wall_s: float
    on_front: bool  # no other compiles in less and is finer


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskTradeoff:
    """All points; the first is the task as it says itself."""

    format_version: str
    task: str
    note: str
    points: tuple[TradeoffPoint, ...]


def points_csv(found: TaskTradeoff) -> str:
    """Return one row for every point; no value where there is none."""
    names = [f.name for f in fields(TradeoffPoint)]
    return csv_rows(names, ([getattr(p, n) for n in names] for p in found.points))


def points_table(found: TaskTradeoff, spent: Sequence[Spent]) -> str:
    """Return the points as lines of text: `*` is on the front of compile time."""
    rows = [("", "point", "trials", "frames", "zoom", "error um", "P", "P at least",
             "run s", "compile s", "choices")]  # fmt: skip
    for point, took in zip(found.points, spent, strict=True):
        rows.append(
            (
                "*" if took.on_front else "",
                point.varied,
                str(point.trials),
                str(point.frames),
                "-" if point.zoom is None else f"{point.zoom:.4g}",
                _number(point.error_um, ".3f"),
                _chance(point.success_probability),
                _chance(point.success_lower),
                _number(point.run_s, ".3g"),
                f"{took.cpu_s:.3g}",
                _choices(point),
            )
        )
    numbers = aligned([row[:-1] for row in rows], words=2)
    lines = [
        f"{line}  {row[-1]}".rstrip() for line, row in zip(numbers, rows, strict=True)
    ]
    return "\n".join([f"{found.task}: error and chance over what it takes", *lines])


def _choices(point: TradeoffPoint) -> str:
    """Return what changed, or why there is nothing to compare."""
    if point.reason:
        first = point.reason.partition(";")[0]
        return f"{point.status}: {first[:100]}{'...' if len(first) > 100 else ''}"
    if point.choices is None:
        return ""
    return "; ".join(point.choices) or "the same"


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _chance(value: float | None) -> str:
    return "-" if value is None else chance(value)
