"""Release of a part: adhesion against hold, ladder of actions, verifying look."""

from __future__ import annotations

import math
from dataclasses import dataclass

from microplan.planner.assembly.assembly import (
    bodies,
    height_sigma_um,
    owner_of,
    part_z_um,
)
from microplan.planner.assembly.mating import contact_um2, mating_of
from microplan.planner.assembly.shapes import polygon, squeeze_width_um
from microplan.planner.assembly.step_states import StepState
from microplan.planner.assembly.swept_volume import ROUNDING_UM, SIGMAS, jaw_hits
from microplan.planner.mechanics.adhesion import (
    Bounds,
    Sticks,
    in_liquid,
    part_forces,
    part_weight_un,
    total,
    verdict,
)
from microplan.planner.mechanics.gripping import stiffness_un_per_um
from microplan.planner.task.task import Part, Task, TaskStep
from microplan.schemas.plan.verdicts import Force, ReleaseVerdict, Rung


@dataclass(frozen=True, slots=True, kw_only=True)
class _Grip:
    """What pulls on a released part, and what might keep it, uN."""

    finger: tuple[Force, ...]
    below: tuple[Force, ...]  # () where nothing lies below
    weight_un: Bounds
    friction: float

    @property
    def pull_un(self) -> Bounds:
        """Return the pull of a finger; on a hanging part, its friction on the finger.

        A part with nothing below it slides off a finger by its weight alone.
        """
        low, high = total(self.finger)
        share = 1.0 if self.below else self.friction
        return share * low, share * high

    @property
    def hold_un(self) -> Bounds:
        """Return the friction that keeps a part where it lies; or its weight."""
        low, high = self.weight_un
        if not self.below:
            return low, high
        below = total(self.below)
        return self.friction * (low + below[0]), self.friction * (high + below[1])


def release_verdict(
    task: Task, states: tuple[StepState, ...], here: StepState
) -> ReleaseVerdict:
    """Return what happens to the part of a release.

    On a shaft the fingers peel the part off once its clearance is used up; else it
    must hold by friction on what it lies on, or fall off the finger by its weight.
    """
    name = owner_of(here.step.target or "")
    contact = contact_um2(task, here.at_look, name)
    drop_um, support = _support(task, here, name)
    grip = _grip(task, task.parts[name], contact, support)
    play_um = _play_um(task, states, here)
    found, reason = _on_shaft(task, here, grip, play_um)
    if found != "stays":
        found, lying = _lying(task, grip, drop_um)
        reason = "; ".join(words for words in (reason, lying) if words)
    return ReleaseVerdict(
        verdict=found,
        reason=reason,
        contact_um2=contact,
        finger=grip.finger,
        holding=grip.below,
        weight_un=grip.weight_un,
        pull_un=grip.pull_un,
        hold_un=grip.hold_un,
        ladder=_ladder(task, here, on_shaft=play_um is not None),
        verified_by=_verified_by(task, here.step),
    )


def _grip(
    task: Task, part: Part, contact_um2: float, support: frozenset[str] | None
) -> _Grip:
    """Return the forces on a part between a finger and what it lies on.

    `support` names the parts below, None where nothing is.
    """
    below: tuple[Force, ...] = ()
    if support is not None:
        below = part_forces(task, part.outline.area_um2, support | {part.name})
    return _Grip(
        finger=part_forces(task, contact_um2, [part.name]),
        below=below,
        weight_un=part_weight_un(task, part),
        friction=task.environment.friction,
    )


def _on_shaft(
    task: Task, here: StepState, grip: _Grip, play_um: float | None
) -> tuple[Sticks, str]:
    """Return whether a shaft strips the part off the finger that it follows.

    A finger leaves by half of what the jaws open beyond the part; it must bend back by
    its greatest pull before the part, its clearance used up, comes off.
    """
    if play_um is None:
        return "may stick", ""
    away_um = _away_um(task, here)
    per_um = stiffness_un_per_um(task.workcell.tools[here.at_look.tool or ""])
    said = (
        f"each finger leaves by {away_um:.3g} um, the clearance lets the part follow "
    )
    said += f"{play_um:.3g} um at most"
    if per_um is None:
        return "may stick", f"{said}; how far fingers bend is not stated"
    most = total(grip.finger)[1]
    said += f", the finger bends {most / per_um:.3g} um by {most:.2g} uN"
    if in_liquid(task.workcell.optics.medium_index):
        return "may stick", f"{said} and by double layers, which are not modelled"
    if away_um > play_um + most / per_um:
        return "stays", f"the shaft holds it: {said}; what is left is the retreat"
    return "may stick", f"the shaft does not strip it: {said}"


def _away_um(task: Task, here: StepState) -> float:
    """Return how far each finger moves off the part between them, um."""
    name = owner_of(here.step.target or "")
    turn_rad = here.at_look.parts[name].pose.theta_rad
    width_um = squeeze_width_um(task.parts[name].outline, turn_rad)
    opening_um = here.step.opening_um or here.at_look.opening_um
    return max(opening_um - width_um, 0.0) / 2


def _lying(task: Task, grip: _Grip, drop_um: float) -> tuple[Sticks, str]:
    """Return whether a part stays by friction below it, or falls by its weight."""
    found = verdict(grip.pull_un, grip.hold_un)
    pull, hold = _words(grip.pull_un), _words(grip.hold_un)
    said = f"a finger pulls with {pull}, friction on what lies below holds {hold}"
    if drop_um > 0:
        said = (
            f"nothing within {drop_um:.3g} um below it: it weighs {hold}, friction on "
            f"one finger carries {pull}"
        )
    if in_liquid(task.workcell.optics.medium_index):
        return "may stick", f"{said}; double layers are not modelled"
    return found, said


def _support(
    task: Task, here: StepState, name: str
) -> tuple[float, frozenset[str] | None]:
    """Return how far a part is above what lies below it, and what parts that is.

    (0, parts) where it may rest, no parts on the bare stage; (gap, None) where not.
    """
    state, stage = here.at_look, task.workcell.stage
    low_um = part_z_um(task, state, name)
    everything = bodies(task, state)
    shape = polygon(next(b for b in everything if b.name == name).outline)
    spread_um = math.hypot(
        height_sigma_um(task, state, name), stage.axes.repeatability_z_um
    )
    within_um = SIGMAS * spread_um + ROUNDING_UM
    below = [
        body
        for body in everything
        if body.carrier == "stage"
        and body.z_high_um <= low_um + within_um
        and shape.intersects(polygon(body.outline))
    ]
    tops = [stage.datum_z_um + state.stage.z_um, *(body.z_high_um for body in below)]
    gap_um = low_um - max(tops)
    if gap_um > within_um:
        return gap_um, None
    near = (body for body in below if low_um - body.z_high_um <= within_um)
    return 0.0, frozenset(body.owner for body in near)


def _play_um(
    task: Task, states: tuple[StepState, ...], here: StepState
) -> float | None:
    """Return how far a part on a shaft can move sideways, None if on none."""
    owner = owner_of(here.step.target or "")
    for state in reversed(states[: states.index(here)]):
        same = owner_of(state.step.target or "") == owner
        if state.step.verb == "insert" and same:
            mating = mating_of(task, state.step, here.at_look)
            engaged = mating is not None and mating.engaged_um > 0
            return mating.clearance_um[2] if mating is not None and engaged else None
        if state.step.verb == "grasp":
            return None
    return None


def _ladder(task: Task, here: StepState, *, on_shaft: bool) -> tuple[Rung, ...]:
    """Return the actions to try, in order of what they risk, each with a look."""
    name = owner_of(here.step.target or "")
    opening = here.step.opening_um or here.at_look.opening_um
    widest = task.workcell.tools[here.at_look.tool or ""].opening_um[1]
    rungs = [
        Rung(action=f"open to {opening:g} um", why="the step's own action"),
        Rung(action="look", why="part seen beside its place: it sticks to that finger"),
    ]
    if opening < widest and not jaw_hits(task, here.after, widest, name):
        more = f"open to {widest:g} um, look"
        rungs.append(Rung(action=more, why="pulls it against what holds it, no touch"))
    wall = "the shaft" if on_shaft else "a fixed edge"
    rungs += [
        Rung(
            action="close until both fingers touch, open again, look",
            why="centres the part; either finger may let go first",
        ),
        Rung(
            action=f"move the tool sideways so that {wall} strips the part, look",
            why="a finger slides off by friction, a share of what it pulls",
        ),
        Rung(action="stop for the operator", why="nothing gentler is left"),
    ]
    return tuple(rungs)


def _verified_by(task: Task, release: TaskStep) -> str | None:
    """Return the first later step that looks whether the part stayed."""
    index = task.steps.index(release)
    owner = owner_of(release.target or "")
    for step in task.steps[index + 1 :]:
        if step.verb in ("verify", "locate") and owner_of(step.target or "") == owner:
            return step.id
    return None


def _words(bounds: Bounds) -> str:
    return f"{bounds[0]:.2g}..{bounds[1]:.2g} uN"
