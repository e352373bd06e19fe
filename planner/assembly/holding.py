"""Grasp of a part by the jaws, release included: states before, after, conditions."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from microplan.optics.outline.outline import Outline, place
from microplan.optics.outline.tolerant_order import least
from microplan.planner.assembly.assembly import (
    PartState,
    State,
    carrier_pose,
    locate_place,
    owner_of,
    part_pose,
    part_sigma_um,
    part_z_um,
    stage_pose,
    with_part,
)
from microplan.planner.assembly.resting import report_resting
from microplan.planner.assembly.settling import Settling, settling
from microplan.planner.assembly.shapes import hull, squeeze_minima_rad, squeeze_width_um
from microplan.planner.assembly.swept_volume import SIGMAS, report_jaws
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task, TaskStep
from microplan.schemas.plan import RestAngle
from microplan.schemas.pose import Pose

UNSURE = 1e-3  # probability of settling at another angle that is not refused
PLACES = 6  # decimals of rest angles, um and rad: what sums leave below means nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class Between:
    """A part between open jaws, about to be squeezed."""

    local: Pose  # of the part in the tool's frame, nominal
    turn_rad: float  # of the part in the tool's frame once it lies flat
    width_um: float  # along x, at that angle
    half_room_um: float  # half of what the jaws leave open around that width
    sigma_um: float  # standard deviation of the part's position, per axis
    middle_um: tuple[float, float]  # of its extents from its origin, at that angle

    @property
    def room_um(self) -> float:
        """Return what is left on the narrower side."""
        return self.half_room_um - abs(self.offset_um)

    @property
    def offset_um(self) -> float:
        """Return how far its middle is off that of the jaws, across them."""
        return self.local.x_um + self.middle_um[0]

    @property
    def along_um(self) -> float:
        """Return how far its middle is behind the grip."""
        return self.local.y_um + self.middle_um[1]


def between_jaws(task: Task, state: State, step: TaskStep) -> Between:
    """Return the pose and clearance of a part between the jaws before they close."""
    name, tool = owner_of(step.target or ""), step.tool or ""
    outline = task.parts[name].outline
    grip = locate_place(task, state, f"{tool}.grip").pose
    local = grip.inverse().compose(part_pose(task, state, name))
    turn = _nearest(squeeze_minima_rad(outline), local.theta_rad)
    width = squeeze_width_um(outline, turn)
    return Between(
        local=local,
        turn_rad=turn,
        width_um=width,
        half_room_um=(state.opening_um - width) / 2,
        sigma_um=part_sigma_um(state, name),
        middle_um=_middle_um(outline, turn),
    )


def _middle_um(outline: Outline, turn_rad: float) -> tuple[float, float]:
    """Return the middle of an outline's extents once it is rotated, um."""
    x0, y0, x1, y1 = hull(place(outline, 0.0, 0.0, turn_rad)).bounds
    return ((x0 + x1) / 2, (y0 + y1) / 2)


def rests_of(outline: Outline) -> tuple[RestAngle, ...]:
    """Return all angles at which a part may lie flat between jaws, by rising angle."""
    found = []
    for turn in squeeze_minima_rad(outline):
        across_um = round(-_middle_um(outline, turn)[0], PLACES)
        for sign, more in ((1, 0.0), (-1, math.pi)):  # half a turn on, it is mirrored
            theta_rad = round(turn + more, PLACES) % round(math.tau, PLACES)
            rest = RestAngle(theta_rad=theta_rad, across_um=sign * across_um + 0.0)
            found.append(rest)
    return tuple(sorted(found, key=lambda rest: rest.theta_rad))


def grasp(task: Task, state: State, step: TaskStep, report: Report) -> State:
    """Return the state with the part between the jaws, centred and lying flat.

    The jaws stop at its outline, wider than what they are sent to.
    """
    name = owner_of(step.target or "")
    between = between_jaws(task, state, step)
    _check_grasp(task, state, step, report, between)
    _check_turn(task, state, step, report, between)
    report_jaws(task, state, step, step.opening_um or 0.0, report)
    held = PartState(
        carrier="robot",
        pose=Pose(
            x_um=0.0 - between.middle_um[0],
            y_um=between.local.y_um,
            theta_rad=between.turn_rad,
        ),
        z_um=state.parts[name].z_um
        + state.stage.z_um
        + task.workcell.stage.datum_z_um
        - state.robot.z_um,
        sigma_xy_um=between.sigma_um,
        sigma_z_um=task.workcell.stage.axes.repeatability_z_um,
        sigma_theta_rad=_held_sigma_rad(task, state, name, between.local.theta_rad),
    )
    lost = frozenset(n for n in state.located if owner_of(n) != name)
    return replace(
        with_part(state, name, held),
        held=name,
        opening_um=max(step.opening_um or 0.0, between.width_um),
        located=lost,
        pinned={k: v for k, v in state.pinned.items() if k != name},
    )


def _held_sigma_rad(task: Task, state: State, name: str, theta_rad: float) -> float:
    """Return the sigma of a part's angle once flat jaws have rotated it, rad.

    It lies flat as `squeeze_minima_rad` says, but one start may end in another minimum
    than the next. What no jaw rotates, and any angle, stays as uncertain as it was.
    """
    minima = squeeze_minima_rad(task.parts[name].outline)
    if state.parts[name].sigma_theta_rad >= math.pi:
        return math.pi
    before = _sigma_before_rad(task, state, name)
    if not minima:
        return min(before, math.pi)
    robot = task.workcell.robot.axes.repeatability_theta_rad
    return math.hypot(settling(minima, theta_rad, before).sigma_rad, robot)


def _sigma_before_rad(task: Task, state: State, name: str) -> float:
    """Return the sigma of a part's angle between open jaws, rad."""
    cell = task.workcell
    axes = (each.axes.repeatability_theta_rad for each in (cell.robot, cell.stage))
    return math.hypot(state.parts[name].sigma_theta_rad, *axes)


def _check_grasp(
    task: Task, state: State, step: TaskStep, report: Report, between: Between
) -> None:
    """Report jaws that cannot close on the part."""
    name = owner_of(step.target or "")
    where = step.spans.get("opening_um", step.where)
    width, room = between.width_um, between.room_um
    opening = step.opening_um or 0.0
    if opening >= width:
        report.refuse(
            "MP304",
            where,
            f"step {step.id!r}: jaws closed to {opening:g} um do not hold {name}, "
            f"which is {width:.4g} um wide where it is narrowest",
            f"close to less than {width:.4g} um",
        )
    needed_um = SIGMAS * between.sigma_um
    if room < needed_um:
        report.refuse(
            "MP304",
            step.where,
            f"step {step.id!r}: {name} ({width:.4g} um) between jaws "
            f"{state.opening_um:g} um apart leaves {room:.3g} um a side, "
            f"{needed_um:.3g} um needed at 2 sigma",
            "open the jaws further before, or align more finely",
        )
    _check_reach(task, state, step, report, between)


def _check_turn(
    task: Task, state: State, step: TaskStep, report: Report, between: Between
) -> None:
    """Report a part whose angle is needed later, and which jaws may turn either way."""
    name = owner_of(step.target or "")
    found = _needed_turn(task, state, step, between)
    if found is None or found.elsewhere[0] <= UNSURE:
        return
    chance, other_rad = found.elsewhere
    later = next(s for s in task.steps if _needs_angle(s, name))
    here, there = (math.degrees(t) for t in (found.nearest_rad, other_rad))
    report.refuse(
        "MP310",
        step.where,
        f"step {step.id!r}: closing jaws turn {name} to {here:.4g} deg, or, with "
        f"probability {chance:.2g}, to another angle, such as {there:.4g} deg; "
        f"{later.id!r} needs its angle",
        f"bring it in nearer to {here:.4g} deg, or with a smaller sigma_theta_deg",
    )


def turn_miss(task: Task, state: State, step: TaskStep) -> float | None:
    """Return P(jaws turn a part to another angle than planned).

    None if they turn it to none, or no step needs its angle.
    """
    found = _needed_turn(task, state, step, between_jaws(task, state, step))
    return None if found is None else found.elsewhere[0]


def _needed_turn(
    task: Task, state: State, step: TaskStep, between: Between
) -> Settling | None:
    """Return where jaws turn a part whose angle a step needs, None for another."""
    name = owner_of(step.target or "")
    minima = squeeze_minima_rad(task.parts[name].outline)
    if not minima or not any(_needs_angle(s, name) for s in task.steps):
        return None
    sigma_rad = min(_sigma_before_rad(task, state, name), math.pi)
    return settling(minima, between.local.theta_rad, sigma_rad)


def _needs_angle(step: TaskStep, name: str) -> bool:
    """Return whether a step aligns the angle of a part."""
    owners = (owner_of(place or "") for place in (step.target, step.to))
    return step.tolerance_theta_rad is not None and name in owners


def _check_reach(
    task: Task, state: State, step: TaskStep, report: Report, between: Between
) -> None:
    """Report fingers that close before, behind or above the part's middle.

    By what the part covers: its origin may be anywhere.
    """
    name, tool = owner_of(step.target or ""), task.workcell.tools[step.tool or ""]
    low_um = part_z_um(task, state, name)
    high_um = low_um + task.parts[name].thickness_um
    bottom_um, top_um = state.robot.z_um, state.robot.z_um + tool.thickness_um
    if high_um <= bottom_um or low_um >= top_um:
        report.refuse(
            "MP305",
            step.where,
            f"step {step.id!r}: the fingers are {bottom_um:.4g} to {top_um:.4g} um "
            f"high, {name} {low_um:.4g} to {high_um:.4g} um",
            "bring them to its height first",
        )
    behind_um = between.along_um + tool.grip_from_tip_um
    if not 0 <= behind_um <= tool.length_um:
        report.refuse(
            "MP305",
            step.where,
            f"step {step.id!r}: the middle of {name} lies {-behind_um:.3g} um before "
            f"the tips of fingers {tool.length_um:g} um long",
            f"align it to {tool.name}.grip first",
        )


def release(task: Task, state: State, step: TaskStep, report: Report) -> State:
    """Return the state with the part left where it is, on the stage."""
    name = owner_of(step.target or "")
    part = state.parts[name]
    opening = step.opening_um or state.opening_um
    report_jaws(task, state, step, opening, report)
    report_resting(task, state, step, name, report)
    world = carrier_pose(task, state, "robot").compose(part.pose)
    left = replace(
        part,
        carrier="stage",
        sigma_xy_um=math.hypot(part.sigma_xy_um, state.followed_um),
        pose=stage_pose(task, state.stage).inverse().compose(world),
        z_um=state.robot.z_um
        + part.z_um
        - state.stage.z_um
        - task.workcell.stage.datum_z_um,
    )
    pinned = {**state.pinned, name: part_sigma_um(state, name)}
    opened = replace(state, held=None, opening_um=opening, pinned=pinned)
    return with_part(opened, name, left)


def _nearest(angles_rad: tuple[float, ...], theta_rad: float) -> float:
    """Return the angle (modulo pi) nearest to `theta_rad`; itself if there is none."""
    if not angles_rad:
        return theta_rad

    def away(turn: float) -> float:
        return math.remainder(turn - theta_rad, math.pi)

    # midway between two, the one clockwise
    return theta_rad + least(sorted(map(away, angles_rad)), abs, scale=1.0)
