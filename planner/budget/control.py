"""How an alignment is run: tolerance, gain, expected looks and time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist

from microplan.planner.assembly.assembly import Carrier, axes_of, locate_place, owner_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.alignment_residual import (
    approach_um,
    gain_of,
    moved_by,
    residual_after,
    residual_of,
)
from microplan.planner.budget.budget import PastMeasurement, blind_rows, fit_of
from microplan.planner.budget.insert_budget import (
    insert_s,
    insertion_of,
    share_of_goal,
    travel_of,
)
from microplan.planner.budget.methods import choose
from microplan.planner.budget.probability.fit_probability import (
    LEAST_SIGMAS,
    Residual,
    combine,
    gain_limit,
    servo_tolerance_um,
)
from microplan.planner.budget.probability.fit_probability import (
    expected_looks as settled_looks,
)
from microplan.planner.budget.probability.servo_landing import Loop, expected_looks
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.requests import insertion_after
from microplan.planner.views.views import SEARCH_SIGMAS
from microplan.schemas.plan import Control
from microplan.schemas.plan.verdicts import MethodChoice, MethodName, MethodOption

# The chance that a servo needs more looks than this is below 1e-6.
GIVE_UP = 1e-6
MS_PER_S = 1e3
MOST_EXPECTED = 6.0  # looks on average; below LEAST_SIGMAS a place takes more, too
# Without a fit or a stated tolerance: what axes reach within two looks on average.
DEFAULT_SIGMAS = 1.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """An angle that an alignment corrects: where it starts, and how it ends."""

    within_rad: float
    start_rad: float  # spread before the first look
    sigma_rad: float  # what corrections leave, one sigma
    gain: float

    @property
    def inside(self) -> float:
        """Return the chance that a correction of a small angle ends inside."""
        if self.sigma_rad <= 0:
            return 1.0
        return math.erf(self.within_rad / self.sigma_rad / math.sqrt(2))

    @property
    def most(self) -> int:
        """Return the corrections after which all but GIVE_UP of starts are inside."""
        sigmas = NormalDist().inv_cdf(1 - GIVE_UP / 2)
        far_rad = min(sigmas * self.start_rad, math.pi)
        if far_rad <= self.within_rad:
            return 0
        if self.gain >= 1:
            return 1
        shrunk = math.log(far_rad / self.within_rad) / -math.log1p(-self.gain)
        return math.ceil(shrunk)

    @property
    def expected(self) -> float:
        """Return how many corrections a start takes on average: one for each after
        which it is still outside."""
        if self.start_rad <= 0:
            return 0.0
        left = [(1 - self.gain) ** k * self.start_rad for k in range(self.most)]
        return sum(math.erfc(self.within_rad / s / math.sqrt(2)) for s in left if s > 0)


def tolerance_um(
    task: Task,
    states: tuple[StepState, ...],
    align: StepState,
    seen: PastMeasurement | None,
    report: Report,
) -> float:
    """Return how closely to align: as stated, from the fit, or what the axes can do.

    `seen` is what the look at the goal promised, if there was one. Reports a tolerance
    that what moves can hardly meet.
    """
    step, carrier = align.step, moved_by(task, align)
    sigma = axes_of(task, carrier).repeatability_xy_um
    found = step.tolerance_xy_um or _from_fit(task, states, align, seen)
    if found is None:
        found = DEFAULT_SIGMAS * sigma
    if found < LEAST_SIGMAS * sigma:
        report.refuse(
            "MP603",
            step.spans.get("tolerance_xy_um", step.where),
            f"step {step.id!r}: a tolerance of {found:.3g} um is below {LEAST_SIGMAS} "
            f"of the {carrier}'s repeatability of {sigma:.3g} um: it would take "
            f"{settled_looks(Residual(sigma_um=sigma, within_um=found)):.0f} moves",
            f"allow at least {LEAST_SIGMAS * sigma:.3g} um, or use a finer {carrier}",
        )
    turn = turn_of(task, align)
    if turn is not None and turn.inside * MOST_EXPECTED < 1:
        report.refuse(
            "MP603",
            step.spans.get("tolerance_theta_deg", step.where),
            f"step {step.id!r}: a tolerance of {math.degrees(turn.within_rad):.3g} deg "
            f"is met by one move in {1 / turn.inside:.0f}: the {carrier}'s angle "
            f"repeats to {math.degrees(turn.sigma_rad):.3g} deg",
            f"allow more, or use a finer {carrier}",
        )
    return found


def turn_of(task: Task, align: StepState) -> Turn | None:
    """Return the turn of an alignment, None if it corrects no angle."""
    within_rad = align.step.tolerance_theta_rad
    if within_rad is None:
        return None
    sigma = axes_of(task, moved_by(task, align)).repeatability_theta_rad
    spread = [
        locate_place(task, align.before, name or "").sigma_theta_rad
        for name in (align.step.target, align.step.to)
    ]
    return Turn(
        within_rad=within_rad,
        start_rad=math.hypot(*spread, math.sqrt(2) * sigma),
        sigma_rad=sigma * math.sqrt(2 / (2 - gain_of(task))),
        gain=gain_of(task),
    )


def control_of(
    task: Task,
    align: StepState,
    within_um: float,
    choice: MethodChoice | None = None,
    *,
    setting_s: float = 0.0,
) -> Control:
    """Return how the alignment is run; as it says itself without a `choice`.

    `setting_s` is what zoom and focus take before its first look.
    """
    step, carrier = align.step, moved_by(task, align)
    method: MethodName = "servo" if choice is None else choice.method
    if choice is None and step.method == "look_then_move":
        method = "look_then_move"
    ways = () if choice is None else choice.options
    option = next(
        (way for way in ways if way.method == method),
        _option(task, align, within_um, method, None, 0.0),
    )
    approach_s = _approach_s(task, align) + setting_s
    floor_s = approach_s + option.looks * _floor_s(task, carrier)
    return Control(
        method=method,
        gain=gain_of(task),
        gain_limit=gain_limit(0),
        tolerance_xy_um=within_um,
        tolerance_theta_rad=step.tolerance_theta_rad,
        max_step_um=max_step_um(task, carrier),
        max_cycles=_most_looks(
            residual_of(task, within_um, carrier), turn_of(task, align)
        ),
        expected_cycles=option.looks,
        expected_s=option.expected_s,
        approach_s=approach_s,
        floor_s=floor_s,
        ratio_to_floor=(approach_s + option.expected_s) / floor_s,
        choice=choice,
        move_sigma_um=axes_of(task, carrier).repeatability_xy_um,
    )


def method_of(
    task: Task,
    states: tuple[StepState, ...],
    align: StepState,
    within_um: float,
    seen: Mapping[str, PastMeasurement],
    report: Report,
    before: PastMeasurement | None = None,
) -> MethodChoice:
    """Return how to run an alignment: as the task asks, else by what each way gives.

    `seen` are the looks by owner, `before` is the one that the approach goes by. What
    was chosen is reported.
    """
    step, insert = align.step, insertion_after(states, align)
    here = next((s for s in states if s.step is insert), None)
    ways: tuple[MethodName, ...] = ("servo", "look_then_move")
    options = tuple(
        _with_chance(task, states, align, here, within_um, way, seen, before)
        for way in ways
    )
    found = choose(options, share_of_goal(task), "" if insert is None else insert.id)
    if step.method != "auto":
        return replace(
            found, asked=step.method, method=step.method, reason="the task asks for it"
        )
    if insert is not None:
        report.fact(
            "MP612",
            step.spans.get("method", step.where),
            f"step {step.id!r}: aligned by {found.method}: it {found.reason}",
            "'servo' looks after every move, 'look_then_move' once: state one as "
            "'method' to decide yourself",
        )
    return found


def _with_chance(
    task: Task,
    states: tuple[StepState, ...],
    align: StepState,
    insert: StepState | None,
    within_um: float,
    method: MethodName,
    seen: Mapping[str, PastMeasurement],
    before: PastMeasurement | None,
) -> MethodOption:
    """Return one way to align, with the chance of the insertion if one follows."""
    here = seen.get(owner_of(align.step.target or ""))
    look_um = here.sigma_um if here is not None and here.step == align.step.id else 0.0
    option = _option(task, align, within_um, method, before, look_um)
    if insert is None:
        return option
    left = residual_after(task, align, method, within_um, before)
    job = insertion_of(task, states, insert, left, seen)
    return option if job is None else replace(option, success_probability=1 - job.miss)


def _option(
    task: Task,
    align: StepState,
    within_um: float,
    method: MethodName,
    before: PastMeasurement | None,
    look_um: float,
) -> MethodOption:
    """Return how many looks a way takes on average, and how long.

    `before` is what the approach goes by, `look_um` one sigma of the alignment's own
    look.
    """
    carrier, turn = moved_by(task, align), turn_of(task, align)
    cell, axes = task.workcell, axes_of(task, carrier)
    _, start_um = approach_um(task, align, before)
    loop = Loop(
        gain=gain_of(task),
        move_um=axes.repeatability_xy_um,
        look_um=look_um,
        start_um=start_um,
        within_um=within_um,
    )
    looks = expected_looks(loop)
    if turn is not None and turn.inside > 0:
        # place and angle shrink by the same corrections; the one that takes longer
        # counts, and each must be inside at one and the same look
        near = replace(loop, start_um=residual_of(task, within_um, carrier).sigma_um)
        settled = expected_looks(near)
        looks = settled / turn.inside + max(looks - settled, turn.expected)
    if method == "look_then_move":
        looks = 1.0
    cycle_s = axes.settle_s + 1 / cell.camera.rate_hz * (1 + cell.camera.latency_frames)
    return MethodOption(
        method=method,
        success_probability=None,
        looks=looks,
        expected_s=looks * cycle_s,
    )


def _floor_s(task: Task, carrier: Carrier) -> float:
    """Return what a look cannot do without: settling and the longest exposure."""
    exposure_s = task.workcell.camera.exposure_ms[1] / MS_PER_S
    return axes_of(task, carrier).settle_s + exposure_s


def _approach_s(task: Task, align: StepState) -> float:
    """Return how long the first approach moves, and settles between its legs.

    It goes by what looks found: a leg that is nominally 0 is as long as the start
    spreads of the parts make it on average.
    """
    axes = axes_of(task, moved_by(task, align))
    names = (align.step.target or "", align.step.to or "")
    here = locate_place(task, align.before, names[0]).pose
    goal = locate_place(task, align.at_look, names[0]).pose
    starts = [task.part_starts.get(owner_of(name)) for name in names]
    sigma_um = math.hypot(*(s.sigma_xy_um for s in starts if s is not None))
    nominal = (goal.x_um - here.x_um, goal.y_um - here.y_um)
    way = [folded_mean(value, sigma_um) for value in nominal]
    legs = [max(w for a, w in zip("xy", way, strict=True) if a in leg)
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


def max_step_um(task: Task, carrier: Carrier) -> float:
    """Return the largest correction that can be honest: the range of the look."""
    sigma = math.hypot(
        axes_of(task, carrier).repeatability_xy_um,
        task.benchmark.pose_sigma_xy_um,
    )
    return 2 * SEARCH_SIGMAS * sigma


def _most_looks(residual: Residual, turn: Turn | None) -> int:
    """Return how many looks fail to end inside with a chance below GIVE_UP."""
    inside, more = residual.inside, 0
    if turn is not None:
        inside, more = inside * turn.inside, turn.most
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
    rows = blind_rows(task.workcell, travel_of(here), seen, seen, insert_s(task, here))
    return servo_tolerance_um(
        fit,
        axes_of(task, moved_by(task, align)).repeatability_xy_um,
        combine([row.sigma_um or 0.0 for row in rows]),
        task.success_goal or 0.95,
    )
