"""The assembly state machine: what each verb or declared move does to the state."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from microplan.planner.assembly.approach import approach
from microplan.planner.assembly.assembly import Carrier, State, locate_place, owner_of
from microplan.planner.assembly.certain_starts import (
    report_certain_starts,
    report_faces,
    report_unused_input,
)
from microplan.planner.assembly.holding import grasp, release
from microplan.planner.assembly.initial_state import initial, turned_tip_um
from microplan.planner.assembly.swept_volume import Hit, sweep_hits
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Move, Reading, Task, TaskStep


def apply_reading(task: Task, state: State, axes: Carrier, to: Reading) -> State:
    """Return the state after an absolute move of one axis group."""
    if axes == "robot":
        turned = to.theta_rad is not None and to.theta_rad != state.robot.theta_rad
        tip_um = turned_tip_um(task) if turned else state.tip_sigma_um
        moves = (to.x_um, to.y_um) != (None, None)
        return replace(
            state, robot=state.robot.moved(to), tip_sigma_um=tip_um,
            strayed_um=state.followed_um if moves else state.strayed_um,
        )  # fmt: skip
    stage = state.stage.moved(to)
    if to.x_um is None and to.y_um is None and to.theta_rad is None:
        return replace(state, stage=stage)
    sigma_um = task.workcell.stage.axes.repeatability_xy_um
    if state.followed_um > 0 and to.theta_rad is None:
        # one error is lost and another one got, however often it moves
        return replace(state, stage=stage, stage_moved_um=math.sqrt(2) * sigma_um)
    # about another place than planned the robot stays, if it has followed there
    strayed_um = 0.0 if state.strayed_um else state.followed_um
    return replace(
        state, stage=stage, stage_sigma_um=sigma_um, pinned={}, followed_um=0.0,
        strayed_um=strayed_um, stage_moved_um=0.0,
    )  # fmt: skip


def apply_move(
    task: Task,
    state: State,
    move: Move,
    step: TaskStep,
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
            _way_out(state, hit),
        )
    return after


def _way_out(state: State, hit: Hit) -> str:
    """Return what may remove a collision; what is held need not move along."""
    if state.held is not None and state.held in (
        owner_of(hit.moving),
        owner_of(hit.still),
    ):
        return (
            f"the tool still holds {state.held}: release it before, or move another "
            "axis first"
        )
    return "move another axis first, or by another way"


@dataclass(frozen=True, slots=True, kw_only=True)
class StepState:
    """One step with the world before it, while it looks, and after it."""

    step: TaskStep
    moves: tuple[Move, ...]  # the view's stage move first, then the step's own
    before: State
    at_look: State  # after the moves; for an alignment, after its approach
    after: State
    path: tuple[str, ...]  # of an alignment's approach; else ()


def unfold(task: Task, report: Report) -> tuple[StepState, ...]:
    """Return the states of every step, up to the first that cannot happen.

    Steps out of order are errors; motions that would touch something and grasps that
    cannot close are reasons why the task cannot be done. What has no effect is said.
    """
    state, found = initial(task), []
    report_faces(task, report)
    report_certain_starts(task, report)
    for tool in list(task.tool_starts.values())[1:]:
        message = (
            f"{tool.name} is a second tool on the robot; one at a time is modelled"
        )
        report.error("MP301", tool.where, message, "leave it out of start")
    for step in task.steps:
        if not _possible(task, state, step, report):
            break
        report_unused_input(task, state, step, report)
        found.append(_unfold_step(task, state, step, report))
        state = found[-1].after
    return tuple(found)


def _unfold_step(task: Task, state: State, step: TaskStep, report: Report) -> StepState:
    """Return the states of one possible step."""
    moves = () if step.verb == "insert" else (*_view(task, state, step), *step.move)
    placed = state
    for move in moves:
        placed = apply_move(task, placed, move, step, report)
    path: tuple[str, ...] = ()
    at_look = placed
    if step.verb == "align":
        at_look, path = approach(task, placed, step, report)
    act = _ACTIONS.get(step.verb)
    after = at_look if act is None else act(task, at_look, step, report)
    return StepState(
        step=step,
        moves=moves,
        before=state,
        at_look=at_look,
        after=after,
        path=path,
    )


def _possible(task: Task, state: State, step: TaskStep, report: Report) -> bool:
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


def _possible_align(task: Task, state: State, step: TaskStep, report: Report) -> bool:
    """Report an alignment of things that were not measured, or that move together."""
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
        (carrier,) = carriers
        report.error(
            "MP301",
            step.where,
            f"step {step.id!r} cannot happen: {target} and {to} are both on the "
            f"{carrier} and move together",
            "grasp one of them in an earlier step"
            if carrier == "stage"
            else "align to something on the stage",
        )
        return False
    return True


def _located(state: State, name: str) -> bool:
    """Return whether the thing, or the part or tool it belongs to, was measured."""
    owner = owner_of(name)
    return any(owner_of(seen) == owner for seen in state.located)


def _view(task: Task, state: State, step: TaskStep) -> tuple[Move, ...]:
    """Return the stage move that brings the target's nominal position to `view_um`."""
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


def _locate(task: Task, state: State, step: TaskStep, report: Report) -> State:  # noqa: ARG001
    """Return the state with the target known.

    A look at the tool, or at what it holds, sees how its angle swung the grip.
    """
    carrier = locate_place(task, state, step.target or "").carrier
    rest_um = task.workcell.robot.axes.repeatability_xy_um
    tip_um = rest_um if carrier == "robot" else state.tip_sigma_um
    located = state.located | {step.target or ""}
    return replace(state, located=located, tip_sigma_um=tip_um)


def _insert(task: Task, state: State, step: TaskStep, report: Report) -> State:
    """Return the state after the insertion's own moves."""
    exempt = frozenset(
        {frozenset((owner_of(step.target or ""), owner_of(step.onto or "")))}
    )
    for move in step.move:
        state = apply_move(task, state, move, step, report, exempt)
    return state


# a verb's effect on the state apart from its moves; others have none
_ACTIONS: Mapping[str, Callable[[Task, State, TaskStep, Report], State]] = {
    "locate": _locate,
    "grasp": grasp,
    "insert": _insert,
    "release": release,
}
