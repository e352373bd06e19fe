"""Lower bound of a run's probability of success, from all its steps and looks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.lower_bound.sample_bounds import Level, undetected_upper
from microplan.planner.budget.lower_bound.step_bounds import (
    MeasuredStep,
    biases,
    measured_terms,
    success_share,
)
from microplan.planner.budget.measurement_history import MeasurementHistory
from microplan.schemas.plan import (
    BiasRow,
    Repeatability,
    Step,
    StepBound,
    SuccessBound,
)

CONFIDENCE = 0.95  # unless the user asks for another
MOST_DOUBLINGS = 14  # of the trials, in the search for how many would show a goal


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundedRun:
    """The steps of a plan, with the history that each has its budget by."""

    steps: tuple[tuple[Step, MeasuredStep], ...]
    confidence: float

    @property
    def measured(self) -> tuple[MeasuredStep, ...]:
        """Return the insertions and placements."""
        return tuple(told for _, told in self.steps if told.is_measured)

    @property
    def level(self) -> Level:
        """Return how the doubt is split."""
        terms = max(1, measured_terms(self.measured))
        return Level(confidence=self.confidence, terms=terms)

    @property
    def looks(self) -> tuple[tuple[float, Repeatability], ...]:
        """Return how often each look is made on average, and its random trials."""
        return tuple(
            (_repeats(step), known)
            for step, _ in self.steps
            for look in step.looks
            if (known := look.repeatability) is not None
        )

    def lows(self) -> tuple[StepBound, ...]:
        """Return what each step's probability is at least, where it is not 1."""
        doubt = self.level.term_doubt
        return tuple(
            StepBound(
                step=step.id,
                success_low=step.budget.success_probability
                * (success_share(told, doubt) if told.is_measured else 1.0),
            )
            for step, told in self.steps
            if told.is_measured or step.budget.success_probability < 1
        )

    def with_trials(self, times: float) -> BoundedRun:
        """Return the run as if each look had so many times its random trials.

        They say the same: as large a share fails, with the same sigmas and means.
        """
        return replace(
            self,
            steps=tuple(
                (_step_with(step, times), replace(told, history=_more(told, times)))
                for step, told in self.steps
            ),
        )


def success_bound(
    run: BoundedRun, goal: float | None, left_out: Sequence[str] = ()
) -> SuccessBound:
    """Return the lower bound of the probability of success.

    Parameters
    ----------
    run : BoundedRun
        All steps of a plan.
    goal : float, optional
        What the task asks for: how many trials would show it is searched for.
    left_out : sequence of str
        What the probability has no number for.
    """
    lows, doubt = run.lows(), run.level.rate_doubt
    undetected, outside = undetected_upper(run.looks, doubt), 0.0
    mechanical = math.prod(low.success_low for low in lows)
    low = max(0.0, mechanical - undetected - outside)
    point = math.prod(step.budget.success_probability for step, _ in run.steps)
    none = [(many, replace(r, undetected=0)) for many, r in run.looks]
    return SuccessBound(
        confidence=run.confidence,
        success_low=min(low, point),
        mechanical_low=mechanical,
        undetected_upper=undetected,
        outside=outside,
        terms=measured_terms(run.measured),
        trials=min((known.trials for _, known in run.looks), default=0),
        undetected=sum(known.undetected for _, known in run.looks),
        reachable=max(0.0, 1 - undetected_upper(none, doubt)),
        trials_needed=_needed(run, goal, low, point),
        steps=lows,
        biases=_box(run),
        left_out=tuple(left_out),
    )


def _box(run: BoundedRun) -> tuple[BiasRow, ...]:
    """Return the sides of all steps' boxes, but those of which nothing is known."""
    doubt = run.level.term_doubt
    rows = (row for told in run.measured for row in biases(told, doubt))
    return tuple(row for row in rows if math.isfinite(row.half_width_um))


def _needed(
    run: BoundedRun, goal: float | None, low: float, point: float
) -> int | None:
    """Return the trials of each look that would show the goal, None if none would."""
    had = min((known.trials for _, known in run.looks), default=0)
    if goal is None or low >= goal:
        return had
    if point < goal or had < 1:
        return None
    doubt = run.level.rate_doubt
    for doubling in range(1, MOST_DOUBLINGS + 1):
        more = run.with_trials(2.0**doubling)
        wanted = goal + undetected_upper(more.looks, doubt)
        if wanted > point:  # steps need not be looked at
            continue
        if math.prod(each.success_low for each in more.lows()) >= wanted:
            return had << doubling
    return None


def _repeats(step: Step) -> float:
    """Return how often a run looks, on average."""
    return 1.0 if step.control is None else max(1.0, step.control.expected_cycles)


def _step_with(step: Step, times: float) -> Step:
    """Return a step whose looks had more trials."""
    looks = []
    for look in step.looks:
        measure, together = look.measure, look.together
        if together is not None:
            together = replace(together, repeatability=_scaled(
                together.repeatability, times))  # fmt: skip
        measure = replace(measure, repeatability=_scaled(measure.repeatability, times))
        looks.append(replace(look, measure=measure, together=together))
    return replace(step, looks=tuple(looks))


def _more(told: MeasuredStep, times: float) -> MeasurementHistory:
    """Return a history whose looks had more trials."""

    def more(seen: PastMeasurement) -> PastMeasurement:
        return replace(seen, repeatability=_scaled(seen.repeatability, times))

    history = told.history
    return replace(
        history,
        seen={name: more(seen) for name, seen in history.seen.items()},
        angles={name: more(seen) for name, seen in history.angles.items()},
        before=None if history.before is None else more(history.before),
    )


def _scaled(known: Repeatability | None, times: float) -> Repeatability | None:
    """Return what so many times the trials would say."""
    if known is None:
        return None
    half_x, half_y = known.half_width_um
    turn, narrower = known.half_width_theta_rad, 1 / math.sqrt(times)
    return replace(
        known,
        trials=round(known.trials * times),
        answered=round(known.answered * times),
        undetected=round(known.undetected * times),
        half_width_um=(half_x * narrower, half_y * narrower),
        half_width_theta_rad=None if turn is None else turn * narrower,
    )
