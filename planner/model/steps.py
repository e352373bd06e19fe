"""The seven verbs as a state machine: what each step does to the assembly state."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from planner.diagnostics import Report
from planner.inputs.task import Move, Reading, Step, Task
from planner.model.assembly import (
    Axis4,
    Carrier,
    PartState,
    Place,
    State,
    carrier_pose,
    initial,
    locate_place,
    owner_of,
    part_pose,
    part_sigma_um,
    stage_pose,
    with_part,
)
from planner.model.shapes import squeeze_minima_rad, squeeze_width_um
from planner.model.sweep import SIGMAS, Box, sweep_hits
from schemas.pose import Pose

# Order of the axes in the first approach of an alignment, cheapest first.
PATHS = (("xy",), ("x", "y"), ("y", "x"))


@dataclass(frozen=True, slots=True, kw_only=True)
class StepState:
    """One step with the world before it, while it looks, and after it."""

    step: Step
    moves: tuple[Move, ...]  # the view's stage move first, then the step's own
    before: State
    at_look: State  # after the moves; for an alignment, after its approach
    after: State
    path: tuple[str, ...]  # of an alignment's approach; else ()


def unfold(task: Task, report: Report) -> tuple[StepState, ...]:
    """Return the states of every step, up to the first that cannot happen.

    Steps out of order are errors; motions that would touch something and grasps that
    cannot close are reasons why the task cannot be done.
    """
    state, found = initial(task), []
    for step in task.steps:
        if not _possible(task, state, step, report):
            break
        found.append(_unfold_step(task, state, step, report))
        state = found[-1].after
    return tuple(found)


def _unfold_step(task: Task, state: State, step: Step, report: Report) -> StepState:
    """Return the states of one possible step."""
    moves = (
        step.move if step.verb == "insert" else (*_view(task, state, step), *step.move)
    )
    placed = state
    for move in moves:
        if step.verb != "insert":
            placed = _apply_move(task, placed, move, step, report)
    path: tuple[str, ...] = ()
    at_look = placed
    if step.verb == "align":
        at_look, path = _approach(task, placed, step, report)
    after = _ACTIONS[step.verb](task, at_look, step, report)
    return StepState(
        step=step,
        moves=() if step.verb == "insert" else moves,
        before=state,
        at_look=at_look,
        after=after,
        path=path,
    )


def _possible(task: Task, state: State, step: Step, report: Report) -> bool:
    """Report and return False if the step's order makes no sense."""
    owner = owner_of(step.target or "")
    needs: Mapping[str, tuple[bool, str]] = {
        "grasp": (state.held is None, f"the tool already holds {state.held}"),
        "insert": (state.held == owner, f"{owner} is not held by the tool"),
        "release": (state.held == owner, f"{owner} is not held by the tool"),
    }
    ok, why = needs.get(step.verb, (True, ""))
    if not ok:
        hint = (
            "grasp it in an earlier step" if step.verb != "grasp" else "release first"
        )
        report.error(
            "MP301", step.where, f"step {step.id!r} cannot happen: {why}", hint
        )
        return False
    if step.verb == "align" and step.to is not None:
        return _possible_align(task, state, step, report)
    return True


def _possible_align(task: Task, state: State, step: Step, report: Report) -> bool:
    """Report an alignment of things nobody has measured, or that move together."""
    target, to = step.target or "", step.to or ""
    for name in (target, to):
        if not _located(state, name):
            report.error(
                "MP302",
                step.spans.get("to" if name == to else "target", step.where),
                f"step {step.id!r} aligns {name!r}, which no earlier step has located "
                "since it last changed hands",
                f"add a step 'do: locate, target: {name}' before it",
            )
            return False
    carriers = {locate_place(task, state, name).carrier for name in (target, to)}
    if len(carriers) == 1:
        report.error(
            "MP301",
            step.where,
            f"step {step.id!r} cannot happen: {target} and {to} are both on the "
            f"{carriers.pop()} and move together",
        )
        return False
    return True


def _located(state: State, name: str) -> bool:
    """Return whether the thing, or the part or tool it belongs to, was measured."""
    owner = owner_of(name)
    return any(owner_of(seen) == owner for seen in state.located)


def _view(task: Task, state: State, step: Step) -> tuple[Move, ...]:
    """Return the stage move that brings the target's nominal place to `view_um`."""
    if step.view_um is None or step.target is None:
        return ()
    place = locate_place(task, state, step.target)
    if place.carrier != "stage":
        return ()
    to = Reading(
        x_um=state.stage.x_um + step.view_um[0] - place.pose.x_um,
        y_um=state.stage.y_um + step.view_um[1] - place.pose.y_um,
    )
    if (to.x_um, to.y_um) == (state.stage.x_um, state.stage.y_um):
        return ()
    return (Move(axes="stage", to=to, where=step.spans.get("view_um", step.where)),)


def apply_reading(task: Task, state: State, axes: Carrier, to: Reading) -> State:
    """Return the state after an absolute move of one axis group."""
    if axes == "robot":
        return replace(state, robot=state.robot.moved(to))
    stage = state.stage.moved(to)
    if to.x_um is None and to.y_um is None and to.theta_rad is None:
        return replace(state, stage=stage)
    sigma_um = task.workcell.stage.axes.repeatability_xy_um
    return replace(state, stage=stage, stage_sigma_um=sigma_um, pinned={})


def _apply_move(
    task: Task,
    state: State,
    move: Move,
    step: Step,
    report: Report,
    exempt: frozenset[frozenset[str]] = frozenset(),
) -> State:
    """Return the state after a declared move; report what it would touch."""
    after = apply_reading(task, state, move.axes, move.to)
    hits = sweep_hits(task, state, after, carrier=move.axes, exempt=exempt)
    for hit in hits:
        report.refuse(
            "MP303",
            move.where,
            f"step {step.id!r}: {hit.moving} would touch {hit.still}: "
            f"{hit.gap_um:.3g} um apart at the nominal place, "
            f"{hit.needed_um:.3g} um needed at 2 sigma",
            "move another axis first, or by another way",
        )
    return after


def _approach(
    task: Task, state: State, step: Step, report: Report
) -> tuple[State, tuple[str, ...]]:
    """Return the state with the target at its goal, and a path that touches nothing."""
    target = locate_place(task, state, step.target or "")
    goal = locate_place(task, state, step.to or "")
    shift = (goal.pose.x_um - target.pose.x_um, goal.pose.y_um - target.pose.y_um)
    after = _aligned(task, state, target, goal, shift)
    hits = {path: _path_hits(task, state, target, shift, path) for path in PATHS}
    for path in PATHS:
        if not hits[path]:
            return after, path
    moving, still = hits[PATHS[0]][0]
    report.refuse(
        "MP303",
        step.where,
        f"step {step.id!r}: {moving} would touch {still} at 2 sigma on every path to "
        f"{step.to} (straight, x then y, y then x)",
        "open the jaws further, or start from another side",
    )
    return after, PATHS[0]


def _aligned(
    task: Task, state: State, target: Place, goal: Place, shift: tuple[float, float]
) -> State:
    """Return the state after the carrier of `target` moved by `shift`."""
    spread = math.hypot(goal.sigma_xy_um, task.workcell.stage.axes.repeatability_xy_um)
    if target.carrier == "robot":
        return replace(state, robot=_shifted(state.robot, shift))
    return replace(
        state,
        stage=_shifted(state.stage, shift),
        stage_sigma_um=math.hypot(spread, target.sigma_xy_um),
        pinned={target.owner: spread},
    )


def _path_hits(
    task: Task,
    state: State,
    target: Place,
    shift: tuple[float, float],
    path: tuple[str, ...],
) -> tuple[tuple[str, str], ...]:
    """Return the pairs that would touch on the way.

    The target starts anywhere within two sigma of its nominal place and ends at the
    goal: each leg takes up the deviation along its own axes.
    """
    rest = task.workcell.stage.axes.repeatability_xy_um * SIGMAS
    left = [SIGMAS * target.sigma_xy_um] * 2
    here, found = state, []
    for leg in path:
        deviation: Box = (-left[0], -left[1], left[0], left[1])
        to = (shift[0] if "x" in leg else 0.0, shift[1] if "y" in leg else 0.0)
        there = _carried(here, target.carrier, to)
        hits = sweep_hits(
            task, here, there, carrier=target.carrier, deviation=deviation
        )
        found += [(hit.moving, hit.still) for hit in hits]
        left = [
            rest if axis in leg else value
            for axis, value in zip("xy", left, strict=True)
        ]
        here = there
    return tuple(found)


def _carried(state: State, carrier: Carrier, shift: tuple[float, float]) -> State:
    """Return the state with one carrier shifted."""
    if carrier == "robot":
        return replace(state, robot=_shifted(state.robot, shift))
    return replace(state, stage=_shifted(state.stage, shift))


def _shifted(axis: Axis4, shift: tuple[float, float]) -> Axis4:
    """Return the readings moved sideways by `shift`."""
    return replace(axis, x_um=axis.x_um + shift[0], y_um=axis.y_um + shift[1])


def _locate(task: Task, state: State, step: Step, report: Report) -> State:  # noqa: ARG001
    """Return the state with the target known."""
    return replace(state, located=state.located | {step.target or ""})


def _keep(task: Task, state: State, step: Step, report: Report) -> State:  # noqa: ARG001
    """Return the state unchanged."""
    return state


def _grasp(task: Task, state: State, step: Step, report: Report) -> State:
    """Return the state with the part between the jaws, centred and turned flat."""
    name, tool = owner_of(step.target or ""), task.workcell.tools[step.tool or ""]
    part = task.parts[name]
    grip = locate_place(task, state, f"{tool.name}.grip").pose
    world = part_pose(task, state, name)
    local = grip.inverse().compose(world)
    turn = _nearest(squeeze_minima_rad(part.outline), local.theta_rad)
    _check_grasp(task, state, step, report, local=local, turn_rad=turn)
    minima = squeeze_minima_rad(part.outline)
    sigma_theta = math.pi / max(len(minima), 1) / 2 / math.sqrt(3)
    held = PartState(
        carrier="robot",
        pose=Pose(x_um=0.0, y_um=local.y_um, theta_rad=turn),
        z_um=state.parts[name].z_um
        + state.stage.z_um
        + task.workcell.stage.datum_z_um
        - state.robot.z_um,
        sigma_xy_um=part_sigma_um(task, state, name),
        sigma_z_um=task.workcell.stage.axes.repeatability_z_um,
        sigma_theta_rad=math.pi
        if state.parts[name].sigma_theta_rad >= math.pi
        else sigma_theta,
    )
    lost = frozenset(n for n in state.located if owner_of(n) != name)
    return replace(
        with_part(state, name, held),
        held=name,
        opening_um=step.opening_um or 0.0,
        located=lost,
        pinned={k: v for k, v in state.pinned.items() if k != name},
    )


def _check_grasp(
    task: Task,
    state: State,
    step: Step,
    report: Report,
    *,
    local: Pose,
    turn_rad: float,
) -> None:
    """Report jaws that cannot close on the part."""
    name, tool = owner_of(step.target or ""), task.workcell.tools[step.tool or ""]
    where = step.spans.get("opening_um", step.where)
    width = squeeze_width_um(task.parts[name].outline, turn_rad)
    opening = step.opening_um or 0.0
    if opening >= width:
        report.refuse(
            "MP304",
            where,
            f"step {step.id!r}: jaws closed to {opening:g} um do not hold {name}, "
            f"which is {width:.4g} um wide where it is narrowest",
            f"close to less than {width:.4g} um",
        )
    room = (state.opening_um - width) / 2 - abs(local.x_um)
    spread = SIGMAS * part_sigma_um(task, state, name)
    if room < spread:
        report.refuse(
            "MP304",
            step.where,
            f"step {step.id!r}: {name} ({width:.4g} um) between jaws "
            f"{state.opening_um:g} um apart leaves {room:.3g} um a side, "
            f"{spread:.3g} um needed at 2 sigma",
            "open the jaws further before, or align more finely",
        )
    if local.y_um < -tool.grip_from_tip_um:
        report.refuse(
            "MP305",
            step.where,
            f"step {step.id!r}: {name} lies {-local.y_um:.3g} um before the grip, "
            f"beyond the tips at {tool.grip_from_tip_um:g} um",
            f"align it to {tool.name}.grip first",
        )


def _insert(task: Task, state: State, step: Step, report: Report) -> State:
    """Return the state after the insertion's own moves."""
    exempt = frozenset(
        {frozenset((owner_of(step.target or ""), owner_of(step.onto or "")))}
    )
    for move in step.move:
        state = _apply_move(task, state, move, step, report, exempt)
    return state


def _release(task: Task, state: State, step: Step, report: Report) -> State:  # noqa: ARG001
    """Return the state with the part left where it is, on the stage."""
    name = owner_of(step.target or "")
    part = state.parts[name]
    opening = step.opening_um or state.opening_um
    world = carrier_pose(task, state, "robot").compose(part.pose)
    left = replace(
        part,
        carrier="stage",
        pose=stage_pose(task, state.stage).inverse().compose(world),
        z_um=state.robot.z_um
        + part.z_um
        - state.stage.z_um
        - task.workcell.stage.datum_z_um,
    )
    pinned = {**state.pinned, name: part_sigma_um(task, state, name)}
    opened = replace(state, held=None, opening_um=opening, pinned=pinned)
    return with_part(opened, name, left)


def _nearest(turns: tuple[float, ...], theta_rad: float) -> float:
    """Return the turn (modulo pi) nearest to `theta_rad`; itself if there is none."""
    if not turns:
        return theta_rad

    def away(turn: float) -> float:
        return math.remainder(turn - theta_rad, math.pi)

    return theta_rad + min((away(t) for t in turns), key=abs)


Act = Callable[[Task, State, Step, Report], State]

_ACTIONS: Mapping[str, Act] = {
    "locate": _locate,
    "align": _keep,
    "grasp": _grasp,
    "move": _keep,
    "insert": _insert,
    "release": _release,
    "verify": _keep,
}
