"""Declared moves: what they do to the state, and what they would touch."""

from __future__ import annotations

from dataclasses import replace

from microplan.planner.assembly.assembly import Carrier, State, turned_tip_um
from microplan.planner.assembly.swept_volume import sweep_hits
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Move, Reading, Task, TaskStep


def apply_reading(task: Task, state: State, axes: Carrier, to: Reading) -> State:
    """Return the state after an absolute move of one axis group."""
    if axes == "robot":
        turned = to.theta_rad is not None and to.theta_rad != state.robot.theta_rad
        tip_um = turned_tip_um(task) if turned else state.tip_sigma_um
        return replace(state, robot=state.robot.moved(to), tip_sigma_um=tip_um)
    stage = state.stage.moved(to)
    if to.x_um is None and to.y_um is None and to.theta_rad is None:
        return replace(state, stage=stage)
    sigma_um = task.workcell.stage.axes.repeatability_xy_um
    return replace(state, stage=stage, stage_sigma_um=sigma_um, pinned={})


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
            "move another axis first, or by another way",
        )
    return after
