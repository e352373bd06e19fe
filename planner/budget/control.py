"""The control of an alignment: tolerance, gain, expected looks, time."""

from __future__ import annotations

import math

from microplan.planner.assembly.assembly import Carrier, axes_of, locate_place, owner_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.alignment_residual import (
    angle_correction,
    residual_of,
    swing_um,
)
from microplan.planner.budget.budget import PastMeasurement, blind_rows, fit_of
from microplan.planner.budget.insert_budget import insert_s, travel_of
from microplan.planner.budget.probability.angle_budget import GIVE_UP, AngleCorrection
from microplan.planner.budget.probability.fit_probability import (
    Residual,
    combine,
    servo_tolerance_um,
)
from microplan.planner.budget.probability.outline_fit import OutlineFit
from microplan.planner.task.task import Task
from microplan.planner.views.alignments import GAIN_LIMIT, gain_of, moved_by
from microplan.planner.views.requests import insertion_after
from microplan.planner.views.views import SEARCH_SIGMAS
from microplan.schemas.plan import Control
from microplan.schemas.plan.verdicts import MethodChoice

MS_PER_S = 1e3
# Without a fit or a stated tolerance: what axes reach within two looks on average.
DEFAULT_SIGMAS = 1.2


def tolerance_um(
    task: Task,
    states: tuple[StepState, ...],
    align: StepState,
    seen: PastMeasurement | None,
) -> float:
    """Return the tolerance of an alignment: stated, from the fit, or of the axes.

    `seen` is what the look at the goal promised, if there was one.
    """
    found = align.step.tolerance_xy_um or _from_fit(task, states, align, seen)
    if found is not None:
        return found
    return DEFAULT_SIGMAS * axes_of(task, moved_by(task, align)).repeatability_xy_um


def control_of(
    task: Task,
    align: StepState,
    within_um: float,
    choice: MethodChoice,
    *,
    setting_s: float = 0.0,
) -> Control:
    """Return the control of an alignment by the method of `choice`.

    `setting_s` is what zoom and focus take before its first look.
    """
    carrier = moved_by(task, align)
    axes, camera = axes_of(task, carrier), task.workcell.camera
    option = next(o for o in choice.options if o.method == choice.method)
    approach_s = _approach_s(task, align) + setting_s
    # a look cannot do without settling and the longest exposure
    floor_s = approach_s + option.looks * (
        axes.settle_s + camera.exposure_ms[1] / MS_PER_S
    )
    return Control(
        method=choice.method,
        gain=gain_of(task),
        gain_limit=GAIN_LIMIT,
        tolerance_xy_um=within_um,
        tolerance_theta_rad=align.step.tolerance_theta_rad,
        max_step_um=max_step_um(task, carrier, swing_um(task, align)),
        max_cycles=_most_looks(
            residual_of(task, within_um, carrier), angle_correction(task, align, None)
        ),
        expected_cycles=option.looks,
        expected_s=option.expected_s,
        approach_s=approach_s,
        floor_s=floor_s,
        ratio_to_floor=(approach_s + option.expected_s) / floor_s,
        choice=choice,
        move_sigma_um=axes.repeatability_xy_um,
    )


def _approach_s(task: Task, align: StepState) -> float:
    """Return the time of the first approach, s: its legs and the pauses between.

    A leg that is nominally 0 is as long as the parts' standard deviations at the start
    make it on average.
    """
    axes = axes_of(task, moved_by(task, align))
    target = align.step.target or ""
    here = locate_place(task, align.before, target).pose
    goal = locate_place(task, align.at_look, target).pose
    names = (owner_of(target), owner_of(align.step.to or ""))
    starts = [task.part_starts.get(name) for name in names]
    sigma_um = math.hypot(*(s.sigma_xy_um for s in starts if s is not None))
    nominal = (goal.x_um - here.x_um, goal.y_um - here.y_um)
    means = [folded_mean(value, sigma_um) for value in nominal]
    legs = [max(m for a, m in zip("xy", means, strict=True) if a in leg)
            for leg in align.path]  # fmt: skip
    moves = [leg for leg in legs if leg > 0]
    pauses = max(len(moves) - 1, 0) * axes.settle_s
    return sum(moves) / axes.speed_xy_um_per_s + pauses


def folded_mean(mean: float, sigma: float) -> float:
    """Return the mean of |x| for a normal x."""
    if sigma <= 0:
        return abs(mean)
    ratio = mean / sigma
    tail = math.sqrt(2 / math.pi) * sigma * math.exp(-(ratio**2) / 2)
    return tail + mean * math.erf(ratio / math.sqrt(2))


def max_step_um(task: Task, carrier: Carrier, swing_um: float = 0.0) -> float:
    """Return the largest correction that can be honest: the range of the look."""
    sigma = math.hypot(
        axes_of(task, carrier).repeatability_xy_um,
        task.benchmark.pose_sigma_xy_um,
        swing_um,
    )
    return 2 * SEARCH_SIGMAS * sigma


def _most_looks(residual: Residual, angle: AngleCorrection | None) -> int:
    """Return the looks after which a servo ends inside but for GIVE_UP."""
    inside, more = residual.inside, 0
    if angle is not None:
        inside, more = inside * angle.inside, angle.most
    if inside >= 1:
        return 2 + more
    return max(2, math.ceil(math.log(GIVE_UP) / math.log1p(-inside)) + 1) + more


def _from_fit(
    task: Task,
    states: tuple[StepState, ...],
    align: StepState,
    seen: PastMeasurement | None,
) -> float | None:
    """Return the tolerance that the insertion after the alignment asks for."""
    step = insertion_after(states, align)
    if step is None:
        return None
    here = next(s for s in states if s.step is step)
    fit = fit_of(task, here)
    if fit is None or fit.capture_um <= 0:
        return None
    if isinstance(fit, OutlineFit):
        fit = fit.inscribed
    rows = blind_rows(task.workcell, travel_of(here), seen, seen, insert_s(task, here))
    return servo_tolerance_um(
        fit,
        axes_of(task, moved_by(task, align)).repeatability_xy_um,
        combine([row.sigma_um or 0.0 for row in rows]),
        task.success_goal or 0.95,
    )
