"""Action of a step in the plan, with its moves, looks, sweeps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microplan.planner.assembly.assembly import locate_place, owner_of
from microplan.planner.assembly.holding import rests_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.assembly.world import axis_move
from microplan.planner.looks.look_record import CompiledLook
from microplan.planner.plan.sweep_bias import sweep_bias
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.task.task import Task, TaskStep
from microplan.planner.task.workcell import WavefrontSpec
from microplan.schemas import plan as p

# A height sweep reaches this many limits to either side of the expected height.
SWEEP_LIMITS = 3.0
# Between stops the geometrical blur grows by this many pixels (or, where pixels are
# finer, the height changes by a wave depth of field), which puts five stops and more on
# the upper half of the focus curve.
SWEEP_BLUR_PX = 2.5
LEAST_STOPS = 9


def action_of(
    task: Task,
    here: StepState,
    looks: Sequence[CompiledLook],
    memo: Memo = EVERY_TIME,
) -> p.Action:
    """Return the action of a step."""
    step, target = here.step, here.step.target or ""
    tool = step.tool or here.before.tool or ""
    if step.verb == "locate":
        last = looks[-1].look  # a coarse one may come before
        return p.LocateAction(target=last.target, look=last.id)
    if step.verb == "align":
        return p.AlignAction(
            target=target,
            to=step.to or "",
            look=looks[0].look.id,
            axes=locate_place(task, here.before, target).carrier,
            path=here.path,
        )
    if step.verb == "grasp":
        part = owner_of(target)
        return p.GraspAction(
            target=part,
            tool=tool,
            opening_um=step.opening_um or 0.0,
            across_um=here.after.parts[part].pose.x_um,
            rests=rests_of(task.parts[part].outline),
        )
    if step.verb == "insert":
        moves = tuple(axis_move(m.axes, m.to, step.speed_um_per_s) for m in step.move)
        return p.InsertAction(target=target, onto=step.onto or "", moves=moves)
    if step.verb == "release":
        opening = step.opening_um or here.before.opening_um
        return p.ReleaseAction(target=owner_of(target), tool=tool, opening_um=opening)
    if step.verb == "verify":
        return _verify(task, step, looks, memo)
    return p.MoveAction()


def _mating(task: Task, verify: TaskStep) -> str:
    """Return what must sit on the seat: the hole that was put onto it, if one was."""
    holes = [
        step.target
        for step in task.steps
        if step.verb == "insert"
        and step.onto == verify.on
        and owner_of(step.target or "") == owner_of(verify.target or "")
    ]
    return (holes[-1] if holes else verify.target) or ""


def _verify(
    task: Task, step: TaskStep, looks: Sequence[CompiledLook], memo: Memo
) -> p.VerifyAction:
    """Return the verification: offset, height and an empty tool."""
    target, seat = looks[0], looks[1]
    height = _height_search(target, step.height_within_um)
    if height is not None:
        height = _with_bias(height, target, task.workcell.optics.wavefront, memo)
    return p.VerifyAction(
        target=_mating(task, step),
        on=step.on or "",
        look=target.look.id,
        seat_look=seat.look.id,
        within_um=step.within_um or 0.0,
        within_rad=step.within_rad,
        height=height,
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


def _with_bias(
    search: p.HeightSearch, look: CompiledLook, stated: WavefrontSpec, memo: Memo
) -> p.HeightSearch:
    """Return the sweep with what the lens' wavefront moves its peak by."""
    bias = memo.call(
        sweep_bias, look.case, stated, search.focus_um, search.ring_radius_um
    )
    return replace(search, bias_um=bias.um, bias_half_width_um=bias.half_width_um)
