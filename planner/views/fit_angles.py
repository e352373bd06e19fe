"""Angular tolerances of alignments, from the fits that they prepare."""

from __future__ import annotations

import math
from dataclasses import replace

from microplan.planner.assembly.assembly import axes_of, locate_place, owner_of
from microplan.planner.assembly.fits.mates import mates_of
from microplan.planner.assembly.fits.room import free_angles_rad
from microplan.planner.assembly.mating import Mating, hole_and_shaft, mating_of
from microplan.planner.assembly.step_states import StepState, unfold
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task, TaskStep
from microplan.planner.views.requests import insertion_after

# Share of the angles that the planned place leaves free which an alignment may use up.
ANGLE_SHARE = 0.5
# An alignment is not asked for less than this many sigmas of the axes' angle, as
# `EASY_SIGMAS` of their place.
EASY_SIGMAS = 0.9


def unfold_with_angles(
    task: Task, report: Report
) -> tuple[Task, tuple[StepState, ...]]:
    """Return a task whose alignments have the angles that fits need, and its states.

    A task whose fits have no angle is the same; an angle that an alignment states
    stays.
    """
    if any(_has_outlines(task, step) for step in task.steps if step.verb == "insert"):
        scratch = Report()
        states = unfold(task, scratch)
        if not scratch.failed:
            turned = {s.step.id: _with_angle(task, states, s) for s in states}
            steps = tuple(turned.get(step.id, step) for step in task.steps)
            task = replace(task, steps=steps)
    return task, unfold(task, report)


def alignment_of(states: tuple[StepState, ...], insert: StepState) -> StepState | None:
    """Return the alignment that prepares an insertion, None if there is none."""
    aligns = (state for state in states if state.step.verb == "align")
    return next((s for s in aligns if insertion_after(states, s) is insert.step), None)


def _has_outlines(task: Task, step: TaskStep) -> bool:
    """Return whether an insertion's hole or post is no whole circle."""
    feature, post = hole_and_shaft(task, step)
    if feature is None or post is None:
        return False
    mates = mates_of(task.parts[owner_of(step.target or "")], feature, post)
    return mates.are_clear and not mates.are_round


def _with_angle(
    task: Task, states: tuple[StepState, ...], align: StepState
) -> TaskStep:
    """Return a step; an alignment without an angle gets that of its insertion."""
    step = align.step
    if step.verb != "align" or step.tolerance_theta_rad is not None:
        return step
    insert = insertion_after(states, align)
    if insert is None:
        return step
    here = next(state for state in states if state.step is insert)
    mating = mating_of(task, here.step, here.after)
    if mating is None or mating.shape is None or mating.shape.turns_freely:
        return step
    free_rad = free_angle_rad(mating)
    carrier = locate_place(task, align.before, step.target or "").carrier
    least = EASY_SIGMAS * axes_of(task, carrier).repeatability_theta_rad
    return replace(step, tolerance_theta_rad=max(ANGLE_SHARE * free_rad, least))


def free_angle_rad(mating: Mating) -> float:
    """Return the error of the angle that still goes in, both parts turned alike.

    As fabricated at the worst, else as drawn; 0 if nothing goes in.
    """
    if mating.shape is None:
        return math.pi
    aligned = replace(mating.shape, angle_rad=0.0)
    for wider_um in mating.wider_um[:2]:
        back, forth = free_angles_rad(aligned, wider_um)
        if back < 0 < forth:
            return min(-back, forth)
    return 0.0
