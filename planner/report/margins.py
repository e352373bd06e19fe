"""How much room each step of a plan has: what is needed, and what there is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from microplan.schemas.page.figures import degrees, number, um
from microplan.schemas.plan import Look, Plan, Score, Step


@dataclass(frozen=True, slots=True, kw_only=True)
class Margin:
    """One thing that must hold, and how far it is from not holding."""

    step: str
    subject: str  # what has the margin, in a few words
    has: str
    needs: str
    ratio: float  # room over need; below 1 it does not hold
    look: str = ""  # id, where it is a look's


def margins(plan: Plan) -> list[Margin]:
    """Return all margins of a plan that it has numbers for, the tightest first."""
    found = [margin for step in plan.steps for margin in _of_step(plan, step)]
    return sorted(found, key=lambda margin: margin.ratio)  # stable: else in order


def needed_probability(plan: Plan, step: Step) -> float | None:
    """Return what a step must reach for the plan's goal, the others as they are.

    The step's share of the goal where that cannot be said: the plan ends early, has no
    goal, or fails it whatever this step does. None if the step has no budget.
    """
    if step.budget.analysis is None:
        return None
    share = step.budget.analysis.required_probability
    if plan.success_goal is None or not step.budget.success_probability > 0:
        return share
    others = min(plan.success_probability / step.budget.success_probability, 1.0)
    return plan.success_goal / others if others > plan.success_goal else share


def need_um(score: Score) -> float | None:
    """Return what a chain needs of a tolerance, 2 sigma + |bias|; None if unknown."""
    if score.sigma_um is None or score.bias_um is None:
        return None
    return 2 * score.sigma_um + math.hypot(*score.bias_um)


def _of_step(plan: Plan, step: Step) -> Iterator[Margin]:
    """Yield the margins of one step."""
    for look in step.looks:
        yield from _of_look(step, look)
    analysis, missing = step.budget.analysis, 1 - step.budget.success_probability
    needed = needed_probability(plan, step)
    if analysis is not None and needed is not None:
        if analysis.miss_probability is not None:
            missing = analysis.miss_probability
        allowed = 1 - needed
        yield Margin(
            step=step.id,
            subject=f"chance that {step.verb} misses",
            has=f"{number(100 * missing)} %",
            needs=f"at most {number(100 * allowed)} %",
            ratio=allowed / missing if missing > 0 else math.inf,
        )
    if step.grasp is not None:
        yield Margin(
            step=step.id,
            subject="room beside the part for the fingers",
            has=um(step.grasp.room_um),
            needs=f"at least {um(step.grasp.needed_um)}",
            ratio=_ratio(step.grasp.room_um, step.grasp.needed_um),
        )
    if step.fit is not None and step.fit.tilt_limit_rad is not None:
        yield Margin(
            step=step.id,
            subject="tilt of the axes, 3 sigma",
            has=degrees(step.fit.tilt_rad),
            needs=f"at most {degrees(step.fit.tilt_limit_rad)}",
            ratio=_ratio(step.fit.tilt_limit_rad, step.fit.tilt_rad),
        )


def _of_look(step: Step, look: Look) -> Iterator[Margin]:
    """Yield the margin of a look: its tolerance over what the trials needed of it."""
    tolerance = look.evidence.tolerance_um
    needed = need_um(look.evidence.chosen)
    if look.together is not None:
        needed = 2 * look.together.sigma_xy_um
    if needed is not None:
        yield Margin(
            step=step.id,
            look=look.id,
            subject=f"error of the look at {look.target}",
            has=um(needed),
            needs=f"at most {um(tolerance)}",
            ratio=_ratio(tolerance, needed),
        )


def _ratio(room: float, need: float) -> float:
    return room / need if need > 0 else math.inf
