"""Execution of a plan: each step's moves, then its action, until done or a fault."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import Phase
from microplan.executor.record.listing import action_line, step_lines
from microplan.executor.record.outcome import RunResult, StepResult
from microplan.executor.run.grasp import grasp
from microplan.executor.run.measure_target import look_near
from microplan.executor.run.probe import look_probed
from microplan.executor.run.run_context import Rig
from microplan.executor.run.servo import align
from microplan.executor.run.verify import verify
from microplan.schemas.plan import (
    AlignAction,
    AxisMove,
    GraspAction,
    InsertAction,
    LocateAction,
    Look,
    Plan,
    ReleaseAction,
    Step,
    VerifyAction,
)

# A move that is refused before it begins, by where things are: all devices are well.
IN_THE_WAY = "MP836"


def insert(rig: Rig, action: InsertAction, retreat: Sequence[AxisMove]) -> None:
    """Make an insertion's moves; if one of them is refused, go back by the others.

    Only what keep-out refuses is gone back from, while every device does as ordered.
    After any other fault the axes stay where they are. The jaws never move.

    Parameters
    ----------
    retreat : sequence of AxisMove
        The moves back, from the last to the first; () to stay.

    Raises
    ------
    ExecutorError
        Of the move that failed; MP836 if it would collide, also after the return.
    """
    rig.phase = "insert"
    for made, move in enumerate(action.moves):
        try:
            rig.move(move, name_of(made))
        except ExecutorError as error:
            if error.code == IN_THE_WAY and len(retreat) == len(action.moves):
                _go_back(rig, retreat[len(retreat) - made :], error)
            raise


def name_of(number: int) -> str:
    """Return the journal's name of a move of an insertion, counted from 0."""
    return f"insert {number + 1}"


def _go_back(rig: Rig, moves: Sequence[AxisMove], why: ExecutorError) -> None:
    """Undo the moves that were made, until one would collide."""
    rig.journal.write("retreat", why=str(why), moves=len(moves))
    rig.phase = "retreat"
    for left, move in enumerate(moves, start=1):
        # before it is: an executor that takes over here makes that move once more
        rig.write_ahead.write("undone", name=name_of(len(moves) - left))
        try:
            rig.move(move)
        except ExecutorError as error:
            if error.code != IN_THE_WAY:
                raise
            why.append(f"the way back is blocked: {error.message}")
            return
    if moves:
        why.append("went back by the plan's retreat")


def run_plan(rig: Rig) -> RunResult:
    """Run every step of the rig's plan; a fault ends the run where it is.

    After a fault nothing moves any more: the jaws keep what they hold.
    """
    began_s = rig.worked_s()
    # of steps that an earlier executor finished
    results = list(rig.resume_state.results)
    finished, before_s = len(results), sum(result.time_s for result in results)
    rig.journal.write(
        "run",
        plan=rig.plan.name,
        steps=len(rig.plan.steps),
        devices=rig.station.devices(),
    )
    for number, step in enumerate(rig.plan.steps, start=1):
        if number <= finished:
            continue
        rig.journal.enter(step.id)
        rig.frames.enter(number, step.id)
        if rig.on_step is not None:
            rig.on_step(step.id)
        result = _run_step(rig, step)
        results.append(result)
        if result.code is not None:
            break
    rig.frames.leave()
    rig.journal.enter("")
    own_s = _since_s(rig, began_s)
    if own_s is None:  # the steps have their own
        own_s = sum(result.time_s for result in results[finished:])
    time_s = before_s + own_s
    return _noted(rig, _result(rig, results, time_s))


def _noted(rig: Rig, ended: RunResult) -> RunResult:
    """Note how the run ended; an end that cannot be noted is a fault of its own."""
    # one that fails keeps nothing from the other
    for log in (rig.journal, rig.write_ahead):
        try:
            log.write("end", code=ended.code, why=ended.message)
        except ExecutorError as error:
            if ended.code is None:
                ended = replace(ended, code=error.code, message=error.message)
    return ended


def _result(rig: Rig, results: list[StepResult], time_s: float) -> RunResult:
    """Sum up; a plan that acts and never verifies is not vouched for."""
    last = results[-1] if results else None
    code, message, step = None, "", None
    if last is not None and last.code is not None:
        code, message, step = last.code, last.message, last.id
    elif acts_unverified(rig.plan):
        code, message = "MP855", "no verify step follows the last insert or release"
    return RunResult(
        code=code, message=message, step=step, steps=tuple(results), time_s=time_s
    )


def acts_unverified(plan: Plan) -> bool:
    """Return whether the last grasp, insert or release has no verify after it."""
    verbs = [s.action.kind for s in plan.steps]
    acts = [i for i, v in enumerate(verbs) if v in ("grasp", "insert", "release")]
    return bool(acts) and "verify" not in verbs[acts[-1] :]


def _run_step(rig: Rig, step: Step) -> StepResult:
    """Run one step and return its result."""
    began_s: float | None = None
    try:
        began_s = rig.worked_s()
        rig.journal.write("begin", verb=step.verb, key=step.key)
        rig.announce("\n".join(step_lines(rig.plan, step)))
        rig.enter(step.id)
        _keep_frame(rig, step)
        rig.phase = _phase(rig, step)
        rig.go_back()
        for number, move in enumerate(step.moves, start=1):
            rig.move(move, f"move {number}")
        result = _act(rig, step)
        _keep_frame(rig, step)
        done = replace(result, time_s=rig.worked_s() - began_s)
        rig.finish(done)
        rig.journal.write("done")
        return done
    except ExecutorError as error:
        rig.motion.halt(rig.station, error)
        code, message = error.code, error.message
        with suppress(ExecutorError):  # a full disk is reported already
            rig.journal.write("failed", code=code, why=message)
        time_s = _since_s(rig, began_s) or 0.0
        return replace(_planned(rig, step), code=code, message=message, time_s=time_s)


def _since_s(rig: Rig, began_s: float | None) -> float | None:
    """Return the time since then; None where the clock fails."""
    if began_s is None:
        return None
    with suppress(ExecutorError):
        return rig.worked_s() - began_s
    return None


def _phase(rig: Rig, step: Step) -> Phase:
    """Return what a step's moves are for: after a release they lead away."""
    steps = rig.plan.steps
    after = steps[: steps.index(step)]
    away = step.verb == "move" and bool(after) and after[-1].verb == "release"
    going_on = step.verb == "move" and rig.phase == "retreat"
    return "retreat" if away or going_on else "approach"


def _keep_frame(rig: Rig, step: Step) -> None:
    """Take a frame for the record where a step looks at nothing itself."""
    if rig.frames.wanted and rig.view is not None and not step.looks:
        rig.grab(None)


def _act(rig: Rig, step: Step) -> StepResult:
    """Perform the step's own action and return what it measured, its time left out."""
    action = step.action
    if step.irreversible and step.moves:  # else it was announced a moment ago
        rig.announce(f"{step.id}: {action_line(step)}")
    match action:
        case LocateAction():
            look, retries = _look(step, action.look), step.conditions.on_failure
            seen = look_near(rig, step.looks, look, retries, look_probed)
            return replace(_planned(rig, step), spread_um=seen.spread_um)
        case AlignAction():
            return _align(rig, step, action)
        case GraspAction():
            grasp(rig, step, action)
        case InsertAction():
            insert(rig, action, step.conditions.retreat)
        case ReleaseAction():
            rig.grip(action.opening_um)
            rig.beliefs.release(action.target, rig.readings())
        case VerifyAction():
            found = verify(rig, action, step.looks, step.conditions.on_failure)
            return replace(
                _planned(rig, step),
                error_um=found.offset_um,
                height_um=found.height_um,
                turn_rad=found.turn_rad,
            )
    return _planned(rig, step)


def _align(rig: Rig, step: Step, action: AlignAction) -> StepResult:
    """Align by the step's control."""
    if step.control is None:
        raise ExecutorError("MP802", f"step {step.id} aligns without a control")
    look = _look(step, action.look)
    ended = align(rig, action, look, step.control, step.conditions.on_failure)
    return replace(
        _planned(rig, step),
        cycles=ended.cycles,
        error_um=ended.error_um,
        spread_um=ended.spread_um,
    )


def _look(step: Step, look_id: str) -> Look:
    """Return the look called `look_id`; MP802 if the step has none."""
    for look in step.looks:
        if look.id == look_id:
            return look
    raise ExecutorError("MP802", f"step {step.id} names no look {look_id!r}")


def _planned(rig: Rig, step: Step) -> StepResult:
    """Return the step's result with what was predicted, before anything is known."""
    control, action = step.control, step.action
    limit_um = None if control is None else control.tolerance_xy_um
    if isinstance(action, VerifyAction):
        limit_um = action.within_um
    return StepResult(
        id=step.id,
        verb=step.verb,
        code=None,
        message="",
        time_s=0.0,
        expected_s=rig.planned_s.get(step.id),
        cycles=None,
        expected_cycles=None if control is None else control.expected_cycles,
        error_um=None,
        limit_um=limit_um,
        spread_um=None,
        expected_sigma_um=_expected_sigma_um(step),
        height_um=None,
    )


def _expected_sigma_um(step: Step) -> float | None:
    """Return the standard deviation of a step's own look by the trials, um."""
    action = step.action
    if isinstance(action, LocateAction | AlignAction | VerifyAction):
        return _look(step, action.look).sigma_xy_um
    return None
