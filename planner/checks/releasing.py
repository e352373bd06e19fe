"""Does a part stay when the jaws open: verdict, ladder of actions, verifying look."""

from __future__ import annotations

from planner.checks.adhesion import (
    Bounds,
    Face,
    Sticks,
    forces,
    total,
    verdict,
    weight_un,
)
from planner.inputs.task import Step, Task
from planner.model.assembly import owner_of
from planner.model.contact import contact_um2
from planner.model.mating import mating_of
from planner.model.steps import StepState
from schemas.verdicts import ReleaseVerdict, Rung


def release_verdict(
    task: Task, states: tuple[StepState, ...], here: StepState
) -> ReleaseVerdict:
    """Return what happens to the part of a release.

    On a shaft the fingers peel the part off once its clearance is used up; else it
    must hold by friction on what it lies on.
    """
    name = owner_of(here.step.target or "")
    part, tool = task.parts[name], task.workcell.tools[here.before.tool or ""]
    finger = Face(area_um2=contact_um2(task, here.before, name))
    pulls = forces(finger, task.environment)
    below = forces(Face(area_um2=part.outline.area_um2), task.environment)
    weight = weight_un(part.material, part.outline.area_um2 * part.thickness_um)
    hold = _hold(weight, total(below), task.environment.friction)
    opening_um = here.step.opening_um or here.before.opening_um
    away_um = (opening_um - here.before.opening_um) / 2
    play_um = _play_um(task, states, here)
    if play_um is not None and away_um > play_um:
        found: Sticks = "stays"
        reason = (
            f"the shaft holds it: each finger leaves by {away_um:.3g} um, the "
            f"clearance lets the part follow {play_um:.3g} um at most; what is left is "
            "the retreat"
        )
    else:
        found = verdict(total(pulls), hold)
        reason = (
            f"a finger pulls with {_words(total(pulls))}, friction on what lies below "
            f"holds {_words(hold)}"
        )
    return ReleaseVerdict(
        verdict=found,
        reason=reason,
        contact_um2=finger.area_um2,
        finger=pulls,
        holding=below,
        weight_un=weight,
        pull_un=total(pulls),
        hold_un=hold,
        ladder=_ladder(here, play_um, tool.opening_um[1]),
        verified_by=_verified_by(task, here.step),
    )


def _hold(weight: Bounds, below: Bounds, friction: float) -> Bounds:
    """Return the friction that keeps a part where it lies, uN."""
    return friction * (weight[0] + below[0]), friction * (weight[1] + below[1])


def _play_um(
    task: Task, states: tuple[StepState, ...], here: StepState
) -> float | None:
    """Return how far a part on a shaft can move sideways, None if on none."""
    owner = owner_of(here.step.target or "")
    for state in reversed(states[: states.index(here)]):
        same = owner_of(state.step.target or "") == owner
        if state.step.verb == "insert" and same:
            mating = mating_of(task, state.step, state.after)
            engaged = mating is not None and mating.engaged_um > 0
            return mating.clearance_um[2] if mating is not None and engaged else None
        if state.step.verb == "grasp":
            return None
    return None


def _ladder(
    here: StepState, play_um: float | None, widest_um: float
) -> tuple[Rung, ...]:
    """Return the actions to try, in order of what they risk."""
    opening = here.step.opening_um or here.before.opening_um
    rungs = [
        Rung(action=f"open to {opening:g} um", why="the step's own action"),
        Rung(action="look", why="part seen beside its place: it sticks to that finger"),
    ]
    if opening < widest_um:
        more = f"open to {widest_um:g} um"
        rungs.append(Rung(action=more, why="peels the part off against what holds it"))
    rungs.append(
        Rung(
            action="close until both fingers touch, open again",
            why="breaks menisci and centres the part",
        )
    )
    wall = "the shaft" if play_um is not None else "a fixed edge"
    rungs.append(
        Rung(
            action=f"move the tool sideways so that {wall} strips the part",
            why="shear breaks a contact at a fraction of its pull-off force",
        )
    )
    rungs.append(Rung(action="stop for the operator", why="nothing gentler is left"))
    return tuple(rungs)


def _verified_by(task: Task, release: Step) -> str | None:
    """Return the first later step that looks whether the part stayed."""
    index = task.steps.index(release)
    owner = owner_of(release.target or "")
    for step in task.steps[index + 1 :]:
        if step.verb in ("verify", "locate") and owner_of(step.target or "") == owner:
            return step.id
    return None


def _words(bounds: Bounds) -> str:
    return f"{bounds[0]:.2g}..{bounds[1]:.2g} uN"
