"""Comparison of runs of one plan, step by step, with its predictions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from microplan.executor.analysis.distributions import (
    LEVEL,
    Mean,
    binomial_at_most,
    mean,
    scatter,
    share,
    student_above,
    student_quantile,
)
from microplan.executor.analysis.run_summaries import RunFolderSummary
from microplan.schemas.plan import Control, Plan, Step

STOPPED = "MP860"  # a stop by the operator is no evidence on the plan
ALPHA = 0.05  # of one false alarm in the whole comparison
TIME_SHARE = 0.1  # a predicted time that is off by less is not called wrong
_DIGITS = 5e-7  # a plan's six digits: a probability of 1 may be less by it


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """Statistics of one number of a step over the runs, with its prediction."""

    step: str
    name: str
    unit: str
    runs: Mean
    sd: float | None
    p95: float
    predicted: float | None
    limit: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """Test of one prediction."""

    step: str  # "" for the plan as a whole
    name: str
    predicted: str
    found: str
    chance: float  # p-value: of what was found, or worse, if the prediction is right


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Result of comparing several runs with their plan."""

    runs: tuple[RunFolderSummary, ...]
    apart: tuple[RunFolderSummary, ...]  # with faults that were asked for, or resumed
    done: int
    counted: int  # runs that the operator did not stop
    figures: tuple[Figure, ...]
    checks: tuple[Check, ...]

    @property
    def refuted(self) -> tuple[Check, ...]:
        """Return the checks that fail, by Holm's rule over all of them."""
        found: list[Check] = []
        ordered = sorted(self.checks, key=lambda check: check.chance)
        for k, check in enumerate(ordered):
            if check.chance > ALPHA / (len(ordered) - k):
                break
            found.append(check)
        return tuple(found)


def compare(plan: Plan, runs: Sequence[RunFolderSummary]) -> Comparison:
    """Return the figures of the runs, and the plan's predictions put to the test.

    Each prediction is tested as what it is: the success as a binomial, the looks of an
    alignment as waiting times, the time of an alignment by Student's t at the looks it
    took, and a look's true error, where a simulated cell knows it, by chi-square. Runs
    with faults that were asked for, and resumed ones, are left apart.
    """
    apart = tuple(run for run in runs if run.apart)
    runs = [run for run in runs if not run.apart]
    counted = [run for run in runs if run.data["code"] != STOPPED]
    done = sum(bool(run.data["done"]) for run in counted)
    figures: list[Figure] = []
    checks: list[Check] = []
    if counted:
        checks.append(_success(plan, done, len(counted)))
    for step in plan.steps:
        figures += _figures(step, runs)
        checks += _checks(step, runs)
    return Comparison(
        runs=tuple(runs),
        apart=apart,
        done=done,
        counted=len(counted),
        figures=tuple(figures),
        checks=tuple(checks),
    )


def predicted_s(control: Control, looks: float | None = None) -> float:
    """Return the predicted time of an alignment, at `looks` looks or the expected."""
    number = control.expected_cycles if looks is None else looks
    return control.approach_s + number * control.expected_s / control.expected_cycles


def _figures(step: Step, runs: Sequence[RunFolderSummary]) -> list[Figure]:
    """Return a step's numbers over the runs that did it."""
    rows = [row for run in runs if (row := run.step(step.id)) is not None]
    sigma_um, limit_um = _first(rows, "expected_sigma_um"), _first(rows, "limit_um")
    control = step.control
    looks = None if control is None else control.expected_cycles
    time_s = None if control is None else predicted_s(control)
    wanted = (
        ("looks", "cycles", "", looks, None),
        ("time", "time_s", "s", time_s, None),
        ("error", "error_um", "um", None, limit_um),
        ("spread", "spread_um", "um", sigma_um, None),
        ("height", "height_um", "um", None, None),
    )
    found = [
        _figure(step.id, name, unit, _values(rows, key), predicted, limit)
        for name, key, unit, predicted, limit in wanted
    ]
    true_um = _true_errors(step, runs)
    found.append(_figure(step.id, "true error", "um", true_um, None, None))
    return [figure for figure in found if figure is not None]


def _figure(
    step: str,
    name: str,
    unit: str,
    values: Sequence[float],
    predicted: float | None,
    limit: float | None,
) -> Figure | None:
    """Return one number over the runs, None if no run has it."""
    if not values:
        return None
    about, count = mean(values), len(values)
    if name != "height" and about.low < 0:  # Student's interval; none of these can be
        about = replace(about, low=0.0)
    squares = sum((v - about.mean) ** 2 for v in values)
    return Figure(
        step=step,
        name=name,
        unit=unit,
        runs=about,
        sd=math.sqrt(squares / (count - 1)) if count > 1 else None,
        p95=sorted(values)[math.ceil(0.95 * count) - 1],
        predicted=predicted,
        limit=limit,
    )


def _checks(step: Step, runs: Sequence[RunFolderSummary]) -> list[Check]:
    """Return the tests of one step's predictions that the runs allow."""
    found: list[Check] = []
    rows = [row for run in runs if (row := run.step(step.id)) is not None]
    control = step.control
    if control is not None:
        looks = [int(v) for v in _values(rows, "cycles")]
        if looks and control.method == "servo":
            found.append(_looks(step.id, control, looks))
        if len(looks) > 1 and len(looks) == len(rows):
            times = _values(rows, "time_s")
            found.append(_time(step.id, control, looks, times))
    true_um = _true_errors(step, runs)
    if true_um:
        found.append(_error(step, true_um))
    return found


def _success(plan: Plan, done: int, counted: int) -> Check:
    """Test the predicted probability of success."""
    # what pages are made of is not loaded where a run begins
    from microplan.schemas.page.figures import chance as as_chance

    one = share(done, counted, min(plan.success_probability, 1 - _DIGITS))
    return Check(
        step="",
        name="success",
        predicted=as_chance(plan.success_probability),
        found=f"{done} of {counted}, {one.low:.3f}..{one.high:.3f}",
        chance=one.chance,
    )


def _looks(step: str, control: Control, looks: Sequence[int]) -> Check:
    """Test the number of looks of alignments: each look ends one with probability p.

    The sum of n waiting times is s or more if fewer than n of s - 1 looks ended one.
    """
    p = min(1 / control.expected_cycles, 1 - _DIGITS)
    count, total = len(looks), sum(looks)
    more = binomial_at_most(count - 1, total - 1, p)
    fewer = 1 - binomial_at_most(count - 1, total, p)
    about = mean([float(v) for v in looks])
    interval = f"{about.low:.3g}..{about.high:.3g}" if about.count > 1 else "one run"
    return Check(
        step=step,
        name="looks",
        predicted=f"{control.expected_cycles:.3g}",
        found=f"{about.mean:.3g}, {interval}",
        chance=min(1.0, 2 * min(more, fewer)),
    )


def _time(
    step: str, control: Control, looks: Sequence[int], times_s: Sequence[float]
) -> Check:
    """Test the time of alignments, at the looks that each took."""
    wanted = [predicted_s(control, n) for n in looks]
    off = mean([t - w for t, w in zip(times_s, wanted, strict=True)])
    per_run = sum(wanted) / len(wanted)
    slack = TIME_SHARE * per_run
    half = (off.high - off.low) / 2
    beyond = abs(off.mean) - slack
    if beyond <= 0:
        chance = 1.0
    elif half > 0:
        quantile = student_quantile((1 + LEVEL) / 2, off.count - 1)
        chance = 2 * student_above(beyond * quantile / half, off.count - 1)
    else:
        chance = 0.0
    return Check(
        step=step,
        name="time",
        predicted=f"{per_run:.3g} s at these looks",
        found=f"{per_run + off.mean:.3g} s",
        chance=min(chance, 1.0),
    )


def _error(step: Step, errors_um: Sequence[float]) -> Check:
    """Test the sigma of a step's last look by its true errors, um, two axes each."""
    look = step.looks[-1] if len(step.looks) == 1 else _last_look(step)
    upper = None if look.together else look.evidence.chosen.sigma_upper_um
    one = scatter(
        sum(e * e for e in errors_um), 2 * len(errors_um), look.sigma_xy_um, upper
    )
    return Check(
        step=step.id,
        name="true error",
        predicted=f"{one.predicted:.3g} um, at most {one.most:.3g}",
        found=f"{one.sigma:.3g} um, {one.low:.3g}..{one.high:.3g}",
        chance=one.chance,
    )


def _last_look(step: Step) -> Any:
    """Return the look that a step of several ends with: verify looks at the seat."""
    wanted = getattr(step.action, "seat_look", None) or getattr(
        step.action, "look", None
    )
    return next((x for x in step.looks if x.id == wanted), step.looks[-1])


def _true_errors(step: Step, runs: Sequence[RunFolderSummary]) -> list[float]:
    """Return the true errors of a step's last look, of runs that did the step."""
    if not step.looks:
        return []
    found = []
    for run in runs:
        value = run.data["true_look_error_um"].get(step.id)
        if run.step(step.id) is not None and value is not None:
            found.append(float(value))
    return found


def _values(rows: Iterable[Mapping[str, Any]], key: str) -> list[float]:
    """Return the numbers that are there."""
    return [float(row[key]) for row in rows if row.get(key) is not None]


def _first(rows: Iterable[Mapping[str, Any]], key: str) -> float | None:
    """Return the first number that is there."""
    return next(iter(_values(rows, key)), None)
