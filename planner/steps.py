"""One step compiled: its looks, action, control, conditions and budget."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from planner.checks.budget import (
    Sighted,
    blind_rows,
    empty_budget,
    fit_of,
    grasp_budget,
    release_budget,
    verify_budget,
)
from planner.checks.fit import Residual
from planner.checks.handling import report_handling, verdicts_of
from planner.checks.insert_budget import Left, insert_budget, share_of_goal
from planner.checks.mechanics import mechanical_rows
from planner.control import (
    control_of,
    insert_s,
    method_of,
    moved_by,
    residual_of,
    single_residual,
    tolerance_um,
    travel_of,
)
from planner.diagnostics import Report
from planner.inputs.task import Move, Step, Task
from planner.looks import CompiledLook, Effects, compile_look
from planner.model.assembly import Axis4, locate_place, owner_of, part_sigma_um
from planner.model.requests import insertion_after, requests
from planner.model.steps import StepState
from planner.model.sweep import ROUNDING_UM
from schemas import plan as p
from schemas.codec import to_data
from schemas.verdicts import MethodChoice

IRREVERSIBLE = ("grasp", "insert", "release")
PHYSICAL = (*IRREVERSIBLE, "move", "align")

# What a look may be tried again for, and how often: noise is new every time.
RETRIES = (
    p.OnFailure(code="MP820", do="retry", times=2),
    p.OnFailure(code="MP821", do="retry", times=2),
    p.OnFailure(code="MP822", do="retry", times=1),
    p.OnFailure(code="MP825", do="retry", times=2),
    p.OnFailure(code="MP826", do="retry", times=1),
)
# A height sweep reaches this many limits to either side of the expected height.
SWEEP_LIMITS = 3.0
# Between stops the geometrical blur grows by this many pixels (or, where pixels are
# finer, the height changes by a wave depth of field), which puts five stops and more on
# the upper half of the focus curve.
SWEEP_BLUR_PX = 2.5
LEAST_STOPS = 9


@dataclass(frozen=True, slots=True, kw_only=True)
class Memory:
    """What earlier steps leave for later ones."""

    magnification: float  # the microscope is at
    seen: Mapping[str, Sighted]  # owner -> its last look
    within_um: float  # of the last alignment
    key: str  # journal key of the step before
    choice: MethodChoice | None = None  # of the last alignment


@dataclass(frozen=True, slots=True, kw_only=True)
class CompiledStep:
    """A step as the plan has it, its looks with their files, and what it leaves."""

    step: p.Step
    looks: tuple[CompiledLook, ...]
    memory: Memory


def compile_step(
    task: Task,
    states: tuple[StepState, ...],
    index: int,
    memory: Memory,
    effects: Effects,
    report: Report,
) -> CompiledStep | None:
    """Return step `index`, None if one of its looks cannot be done."""
    here = states[index]
    goal = memory.seen.get(owner_of(here.step.to or ""))
    within: float | None = None
    if here.step.verb == "align":
        within = tolerance_um(task, states, here, goal, report)
    looks = []
    for request in requests(task, states, index, within):
        look = compile_look(task, request, effects, memory.magnification, report)
        if look is None:
            return None
        looks.append(look)
        memory = _remember(memory, look)
    if within is not None:
        choice = method_of(task, states, here, within, memory.seen, report)
        memory = replace(memory, within_um=within, choice=choice)
    step = _step(task, states, here, tuple(looks), memory)
    report_handling(here, step.grasp, step.release, report)
    step = replace(step, key=journal_key(step, memory.key))
    return CompiledStep(
        step=step, looks=tuple(looks), memory=replace(memory, key=step.key)
    )


def journal_key(step: p.Step, before: str) -> str:
    """Return the sha256 of a step's content and the key of the step before it."""
    content = json.dumps(to_data(replace(step, key="")), sort_keys=True)
    return hashlib.sha256(f"{before}\n{content}".encode()).hexdigest()


def axis_move(move: Move, speed_um_per_s: float | None = None) -> p.AxisMove:
    """Return a task's move as the plan has it."""
    return p.AxisMove(
        axes=move.axes,
        x_um=move.to.x_um,
        y_um=move.to.y_um,
        z_um=move.to.z_um,
        theta_rad=move.to.theta_rad,
        speed_um_per_s=speed_um_per_s,
    )


def _remember(memory: Memory, look: CompiledLook) -> Memory:
    """Return the memory after a look."""
    view, measure = look.look.view, look.look.measure
    seen = Sighted(
        name=look.look.target,
        sigma_um=look.look.sigma_xy_um,
        bias_um=0.0,  # the executor takes the mean error off
        magnification=view.magnification,
        focus_um=view.focus_um,
        distortion_sigma_um=look.distortion_sigma_um,
        coherence_um=look.coherence_um,
        place_um=(measure.reference.pose.x_um, measure.reference.pose.y_um),
        usable_focus_um=measure.usable_focus_um,
        usable_magnification=measure.usable_magnification,
        capture_um=measure.capture_um,
    )
    return replace(
        memory,
        magnification=view.magnification,
        seen={**memory.seen, owner_of(look.look.target): seen},
    )


def _step(
    task: Task,
    states: tuple[StepState, ...],
    here: StepState,
    looks: Sequence[CompiledLook],
    memory: Memory,
) -> p.Step:
    """Return the plan's step, without its key."""
    step = here.step
    control = None
    if step.verb == "align":
        control = control_of(task, here, memory.within_um, memory.choice)
    budget = _budget(task, states, here, memory)
    verdicts = verdicts_of(task, states, here)
    return p.Step(
        id=step.id,
        verb=step.verb,
        key="",
        physical=step.verb in PHYSICAL or bool(here.moves),
        irreversible=step.verb in IRREVERSIBLE,
        moves=tuple(axis_move(move) for move in here.moves),
        looks=tuple(look.look for look in looks),
        action=_action(task, here, looks),
        control=control,
        conditions=_conditions(here),
        budget=budget,
        fit=verdicts.fit,
        grasp=verdicts.grasp,
        release=verdicts.release,
        effects=mechanical_rows(
            here, budget, verdicts.fit, verdicts.grasp, verdicts.release
        ),
    )


def _action(task: Task, here: StepState, looks: Sequence[CompiledLook]) -> p.Action:
    """Return what the step does."""
    step, target = here.step, here.step.target or ""
    tool = step.tool or here.before.tool or ""
    if step.verb == "locate":
        return p.LocateAction(target=looks[0].look.target, look=looks[0].look.id)
    if step.verb == "align":
        return p.AlignAction(
            target=target,
            to=step.to or "",
            look=looks[0].look.id,
            axes=locate_place(task, here.before, target).carrier,
            path=here.path,
        )
    if step.verb == "grasp":
        opening = step.opening_um or 0.0
        return p.GraspAction(target=owner_of(target), tool=tool, opening_um=opening)
    if step.verb == "insert":
        moves = tuple(axis_move(m, step.speed_um_per_s) for m in step.move)
        return p.InsertAction(target=target, onto=step.onto or "", moves=moves)
    if step.verb == "release":
        opening = step.opening_um or here.before.opening_um
        return p.ReleaseAction(target=owner_of(target), tool=tool, opening_um=opening)
    if step.verb == "verify":
        return _verify(step, looks, _mating(task, step))
    return p.MoveAction()


def _mating(task: Task, verify: Step) -> str:
    """Return what must sit on the seat: the hole that was put onto it, if one was."""
    holes = [
        step.target
        for step in task.steps
        if step.verb == "insert"
        and step.onto == verify.on
        and owner_of(step.target or "") == owner_of(verify.target or "")
    ]
    return (holes[-1] if holes else verify.target) or ""


def _verify(step: Step, looks: Sequence[CompiledLook], mating: str) -> p.VerifyAction:
    """Return the verification: offset, height and an empty tool."""
    target, seat = looks[0], looks[1]
    return p.VerifyAction(
        target=mating,
        on=step.on or "",
        look=target.look.id,
        seat_look=seat.look.id,
        within_um=step.within_um or 0.0,
        height=_height_search(target, step.height_within_um),
        empty=step.empty,
    )


def _height_search(
    look: CompiledLook, within_um: float | None
) -> p.HeightSearch | None:
    """Return the focus sweep that measures the height of the target's face."""
    if within_um is None:
        return None
    middle = look.look.view.focus_um
    reach, scope = SWEEP_LIMITS * within_um, look.case.microscope
    pixels = SWEEP_BLUR_PX * scope.um_per_px / scope.blur_diameter_um(1.0)
    count = math.ceil(2 * reach / max(pixels, scope.wave_depth_um)) + 1
    stops = np.linspace(middle - reach, middle + reach, max(count, LEAST_STOPS))
    parameters = look.case.target.parameters
    return p.HeightSearch(
        look=look.look.id,
        expected_um=middle,
        within_um=within_um,
        focus_um=tuple(float(z) for z in stops),
        ring_radius_um=parameters.get("outer_um", parameters.get("radius_um", 0.0)),
    )


def _conditions(here: StepState) -> p.Conditions:
    """Return what must hold before and after, and the way back."""
    before, after = _facts(here)
    retreat = _retreat(here) if here.step.verb == "insert" else ()
    return p.Conditions(before=before, after=after, retreat=retreat, on_failure=RETRIES)


def _retreat(insert: StepState) -> tuple[p.AxisMove, ...]:
    """Return the insertion's moves backwards: each back to the reading before it."""
    at: dict[str, Axis4] = {"stage": insert.before.stage, "robot": insert.before.robot}
    back = []
    for move in insert.step.move:
        start = at[move.axes]
        held = {
            name: getattr(start, name)
            for name in ("x_um", "y_um", "z_um", "theta_rad")
            if getattr(move.to, name) is not None
        }
        back.append(p.AxisMove(axes=move.axes, **held))
        at[move.axes] = start.moved(move.to)
    return tuple(reversed(back))


def _facts(here: StepState) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what is true before and after the step, as far as sensors can tell."""
    step = here.step

    def held(name: str | None) -> str:
        return f"{name} is held" if name else "the tool holds nothing"

    before = [held(here.before.held)] if here.before.tool else []
    after = [held(here.after.held)] if here.after.tool else []
    if step.verb in ("locate", "align"):
        after.append(f"{step.target} is measured")
    if step.verb == "align":
        before.append(f"{step.target} and {step.to} are measured")
        after.append(f"{step.target} is at {step.to}")
    return tuple(before), tuple(after)


def _budget(
    task: Task, states: tuple[StepState, ...], here: StepState, memory: Memory
) -> p.Budget:
    """Return the error budget of the step's mechanical action."""
    step = here.step
    if step.verb == "grasp":
        return grasp_budget(task, here.at_look, step)
    if step.verb == "release":
        return release_budget(task, here.before.tool or "")
    if step.verb == "verify":
        seen = [memory.seen.get(owner_of(n or "")) for n in (step.target, step.on)]
        return verify_budget(task.workcell, step, seen[0], seen[1])
    if step.verb != "insert":
        return empty_budget()
    fit = fit_of(task, here)
    if fit is None:
        return empty_budget()
    hole = memory.seen.get(owner_of(step.target or ""))
    shaft = memory.seen.get(owner_of(step.onto or ""))
    return insert_budget(
        task,
        fit,
        _left(task, states, here, memory),
        blind_rows(task.workcell, travel_of(here), hole, shaft, insert_s(task, here)),
        bias_um=_off_um(task, here),
        goal=share_of_goal(task),
        seen=(hole, shaft),
        methods=_other_methods(memory),
    )


def _other_methods(memory: Memory) -> list[tuple[str, float]]:
    """Return the ways to align that were not taken, with their chances."""
    if memory.choice is None:
        return []
    return [
        (option.method, option.success_probability)
        for option in memory.choice.options
        if option.method != memory.choice.method
        and option.success_probability is not None
    ]


def _off_um(task: Task, insert: StepState) -> float:
    """Return how far hole and shaft are nominally apart once the moves are done."""
    hole, shaft = (
        locate_place(task, insert.after, name or "").pose
        for name in (insert.step.target, insert.step.onto)
    )
    off_um = math.hypot(hole.x_um - shaft.x_um, hole.y_um - shaft.y_um)
    return off_um if off_um > ROUNDING_UM else 0.0


def _left(
    task: Task, states: tuple[StepState, ...], insert: StepState, memory: Memory
) -> Left:
    """Return what the alignment before an insertion leaves.

    Without one nothing is cut off: all that is known of both parts' places is left.
    """
    aligns = [s for s in states if s.step.verb == "align"]
    align = next((s for s in aligns if insertion_after(states, s) is insert.step), None)
    if align is None:
        names = (insert.step.target, insert.step.onto)
        spread = [
            part_sigma_um(task, insert.before, owner_of(name or "")) for name in names
        ]
        return Left(
            residual=Residual(sigma_um=math.hypot(*spread), within_um=math.inf),
            term="places of both parts",
            source="no alignment since something last moved sideways",
        )
    carrier = moved_by(task, align)
    method = align.step.method if memory.choice is None else memory.choice.method
    if method == "look_then_move":
        return Left(
            residual=single_residual(task, carrier),
            term=f"{carrier} repeatability left by two moves",
            source="workcell repeatability_xy_um, nothing cut off",
        )
    return Left(
        residual=residual_of(task, memory.within_um, carrier),
        term=f"{carrier} repeatability left by the servo",
        source=f"workcell repeatability_xy_um, cut off at {memory.within_um:.3g} um",
    )
