"""Looks that a step requests, with the accuracy each must have."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from microplan.planner.assembly.assembly import State, owner_of
from microplan.planner.assembly.fits.room import capture_um
from microplan.planner.assembly.mating import hole_and_shaft, mating_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.source.diagnostics import Span
from microplan.planner.task.task import Move, Task, TaskStep
from microplan.planner.views.views import SEARCH_SIGMAS

# A look may use up this share of the tolerance it serves, per axis, at two sigma.
LOOK_SHARE = 0.5
# A verification compares two looks and must not blur its own limit.
VERIFY_SHARE = 0.25
# Of the angular period of a pattern: well inside the half period where teeth swap.
PERIOD_SHARE = 0.05
ANGLE_RAD = math.radians(1.0)  # for outlines without a period


@dataclass(frozen=True, slots=True, kw_only=True)
class PriorKnowledge:
    """Accuracy with which a look just before has located a target's part."""

    about_um: tuple[float, float]  # what it measured, in the part's frame
    sigma_um: float  # of its position in the world, per axis
    sigma_theta_rad: float | None  # None: no more than the state knows


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """One look a step asks for."""

    id: str
    target: str
    state: State  # of the world while it looks
    tolerance_um: float | None  # None: a pixel of the magnification chosen
    wants_angle: bool
    needs_angle_rad: float | None  # 2 sigma + |bias| of it at most; None: no need
    where: Span
    view_where: Span | None  # of the `view_um` that brought the target there
    divisible: bool = False  # nothing but this look happens: another may come before
    known: PriorKnowledge | None = None  # None: what the state knows
    asked_by: str = ""  # where the tolerance comes from, in words
    # 2 sigma + |bias| with which the insertion after it would still have its share of
    # the goal, at the present zoom; None: no insertion follows, or none would do
    admissible_um: float | None = None
    # the same with which it would be as likely as with a faultless look at another
    # zoom, where that one's jump leaves less than the share; None: it does not
    break_even_um: float | None = None
    # how far off the nominal pose its answer is used at last; None: nothing says it
    used_within_um: float | None = None


def requests(
    task: Task, states: tuple[StepState, ...], index: int, tolerance_um: float | None
) -> tuple[Request, ...]:
    """Return the looks of step `index`.

    Parameters
    ----------
    task : Task
        The task.
    states : tuple of StepState
        All steps' states.
    index : int
        Which step.
    tolerance_um : float or None
        What the step itself must meet (an alignment's tolerance), if it has one.
    """
    here = states[index]
    step = here.step
    if step.verb == "locate":
        need, user = next_need(task, states, index)
        share = None if need is None else LOOK_SHARE * need
        angle = here.at_look.parts.get(owner_of(step.target or ""))
        turned = angle is not None and angle.sigma_theta_rad > 0
        turn = _share(LOOK_SHARE, next_turn_rad(task, states, index))
        asked = "a pixel: no later step asks for more"
        if need is not None and user is not None:
            asked = (
                f"half of the {need:.3g} um that step {user.id!r}, line "
                f"{_line(user)}, needs of it"
            )
        found = _request(here, step.target, "", share, turn, angle=turned)
        return (replace(found, asked_by=asked),)
    if step.verb == "align":
        share = LOOK_SHARE * (tolerance_um or 0.0)
        turn = _share(LOOK_SHARE, step.tolerance_theta_rad)
        found = _request(here, step.target, "", share, turn)
        asked = _asked_by(states, here, tolerance_um)
        return (replace(found, asked_by=asked, used_within_um=tolerance_um),)
    if step.verb == "verify":
        share = VERIFY_SHARE * (step.within_um or 0.0)
        turn = _share(VERIFY_SHARE, step.within_rad)
        return tuple(
            replace(
                _request(here, name, suffix, share, turn),
                asked_by=f"a quarter of the {step.within_um or 0.0:.3g} um to verify",
                used_within_um=step.within_um,
            )
            for name, suffix in ((step.target, "target"), (step.on, "seat"))
        )
    return ()


def _asked_by(
    states: tuple[StepState, ...], align: StepState, tolerance_um: float | None
) -> str:
    """Return why an alignment's look must be so good."""
    words = f"half of the {tolerance_um or 0.0:.3g} um to align to"
    insert = insertion_after(states, align)
    if align.step.tolerance_xy_um is None and insert is not None:
        words += f", which the clearance of step {insert.id!r}, line "
        words += f"{insert.where.line}, asks for"
    return words


def next_turn_rad(
    task: Task, states: tuple[StepState, ...], index: int
) -> float | None:
    """Return the angular tolerance of the next alignment to what step `index` locates.

    None if none does, or if it is a tool: its angle is the robot's.
    """
    owner = owner_of(states[index].step.target or "")
    if owner not in task.parts:
        return None
    for later in states[index + 1 :]:
        step = later.step
        if step.verb == "align" and owner == owner_of(step.to or ""):
            return step.tolerance_theta_rad
        names = {owner_of(name) for name in (step.target, step.onto) if name}
        if owner in names and step.verb in ("align", "grasp", "insert", "release"):
            return None
    return None


def next_need(
    task: Task, states: tuple[StepState, ...], index: int
) -> tuple[float | None, TaskStep | None]:
    """Return what the next mechanical step needs of what step `index` locates, and it.

    For what the next alignment moves, the range in which its own looks find it; for
    what it aligns to, the alignment's tolerance, stated or from the fit; None if
    nothing ever uses it.
    """
    owner = owner_of(states[index].step.target or "")
    for later in states[index + 1 :]:
        step = later.step
        names = {owner_of(name) for name in (step.target, step.to) if name}
        if step.verb == "align" and owner == owner_of(step.target or ""):
            # the alignment looks again: this look only has to bring it into range
            return SEARCH_SIGMAS * task.benchmark.pose_sigma_xy_um, step
        if step.verb == "align" and owner in names:
            return step.tolerance_xy_um or _fit_tolerance(task, states, later), step
        if step.verb in ("grasp", "insert") and owner in names:
            return None, None
    return None, None


def _line(step: TaskStep) -> int:
    """Return the line of a step's tolerance, of the step where it states none."""
    return step.spans.get("tolerance_xy_um", step.where).line


def insertion_after(states: tuple[StepState, ...], align: StepState) -> TaskStep | None:
    """Return the insertion that an alignment prepares, None if there is none.

    What moves sideways or rotates after the alignment undoes it, even on its return.
    """
    owners = {owner_of(n) for n in (align.step.target, align.step.to) if n}
    position = states.index(align)
    for later in states[position + 1 :]:
        step = later.step
        if step.verb == "align" or any(
            _sideways(m) for m in (*later.moves, *step.move)
        ):
            return None
        if step.verb == "insert":
            mates = {owner_of(n) for n in (step.target, step.onto) if n}
            return step if mates == owners else None
    return None


def _sideways(move: Move) -> bool:
    """Return whether a move names any axis but z."""
    to = move.to
    return not (to.x_um is None and to.y_um is None and to.theta_rad is None)


def _fit_tolerance(
    task: Task, states: tuple[StepState, ...], align: StepState
) -> float | None:
    """Return half the capture radius of the insertion that an alignment prepares."""
    step = insertion_after(states, align)
    if step is None:
        return None
    feature, post = hole_and_shaft(task, step)
    if feature is None or post is None:
        return None
    here = next(state for state in states if state.step is step)
    mating = mating_of(task, step, here.after)
    room = (feature.radius_um - post.radius_um) / 2
    if mating is not None and mating.shape is not None:
        room = capture_um(mating.shape) / 2
    return room if room > 0 else None


def _share(share: float, tolerance: float | None) -> float | None:
    """Return what a look may use up of a tolerance, if there is one."""
    return None if tolerance is None else share * tolerance


def _request(
    here: StepState,
    target: str | None,
    suffix: str,
    share: float | None,
    turn_rad: float | None,
    *,
    angle: bool = False,
) -> Request:
    """Return one request; `suffix` distinguishes the looks of one step."""
    step = here.step
    return Request(
        id=f"{step.id}.{suffix}" if suffix else step.id,
        target=target or "",
        state=here.at_look,
        tolerance_um=share,
        wants_angle=angle or turn_rad is not None,
        needs_angle_rad=turn_rad,
        where=step.spans.get("target", step.where),
        view_where=step.spans.get("view_um"),
        divisible=step.verb == "locate",
    )
