"""The verdicts of one step: fit, grasp and release, and what is said of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from microplan.planner.assembly.mating import fit_verdict, mating_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.placing import placing_words
from microplan.planner.mechanics.gripping import grasp_verdict
from microplan.planner.mechanics.releasing import release_verdict
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.schemas.plan.verdicts import (
    FitVerdict,
    GraspVerdict,
    PlacingVerdict,
    ReleaseVerdict,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class MechanicsVerdicts:
    """What is known of a step's mechanics; None where it has none of the kind."""

    fit: FitVerdict | None = None
    grasp: GraspVerdict | None = None
    release: ReleaseVerdict | None = None


def verdicts_of(
    task: Task, states: tuple[StepState, ...], here: StepState
) -> MechanicsVerdicts:
    """Return the verdicts of a step; only steps that need one have it worked out."""
    if here.step.verb == "insert":
        mating = mating_of(task, here.step, here.after)
        tilt_rad = task.workcell.stage.axis_tilt_sigma_rad
        return MechanicsVerdicts(
            fit=None if mating is None else fit_verdict(mating, tilt_rad)
        )
    if here.step.verb == "grasp":
        return MechanicsVerdicts(grasp=grasp_verdict(task, here))
    if here.step.verb == "release":
        return MechanicsVerdicts(release=release_verdict(task, states, here))
    return MechanicsVerdicts()


def report_handling(
    here: StepState,
    grasp: GraspVerdict | None,
    release: ReleaseVerdict | None,
    report: Report,
    placing: PlacingVerdict | None = None,
) -> None:
    """Report how a part is held, whether it stays and where, with the numbers."""
    step = here.step
    if placing is not None:
        report.note("MP615", step.where, placing_words(step.id, placing))
    if grasp is not None:
        words = f"step {step.id!r}: {grasp.verdict}: {grasp.reason}; {_stands(grasp)}"
        if grasp.verdict == "will slip":
            report.warning("MP614", step.where, words, "close the jaws further")
        elif grasp.room_um < grasp.needed_um:
            hint = "open the jaws further before, or align more finely"
            report.warning("MP614", step.where, words, hint)
        else:
            report.note("MP614", step.where, words)
    if release is None:
        return
    words = f"step {step.id!r}: {release.verdict}: {release.reason}"
    if release.verdict == "will stick":
        report.refuse("MP613", step.where, words, "lower humidity, ground, roughen")
    elif release.verified_by is None:
        hint = "add a step 'do: verify' after it"
        report.note("MP613", step.where, words + "; no later step looks", hint)
    else:
        report.note("MP613", step.where, f"{words}; {release.verified_by!r} looks")


def _stands(grasp: GraspVerdict) -> str:
    """Return how a part stands between the jaws, in words."""
    narrow, wide = grasp.width_range_um
    words = (
        f"{grasp.room_um:.3g} um beside it, {grasp.needed_um:.3g} um needed at 3 sigma;"
        f" {narrow:.4g}..{wide:.4g} um wide over all angles"
    )
    if grasp.theta_within_rad is None:
        return f"{words}, which no jaw turns"
    within = f"angle within {grasp.theta_within_rad * 1e3:.3g} mrad"
    if grasp.theta_sigma_rad >= math.pi:
        return f"{words}, {within} of one of {grasp.settles}"
    return f"{words}, {within}, sigma {grasp.theta_sigma_rad * 1e3:.3g} mrad once held"
