"""Looks of a compiled example on both roads: the compiler's and the cell's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.truth.cell_side import Photographed, photographed, scenes_of
from benchmarks.truth.compiler_side import Surface, TrialCase, task_of, trial_cases
from microplan.arrays import FloatArray
from microplan.executor.record.plan_file import read_plan
from microplan.executor.simulated.imaging.imaging_view import RaySampling
from microplan.executor.simulated.imaging.photograph import photograph


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedLook:
    """One look at equal optics: pose, focus, zoom, light and surfaces are the same."""

    id: str
    surface: Surface
    trial: TrialCase  # the compiler's
    cell: Photographed


def judged_looks(
    task_file: Path, plan_file: Path, surface: Surface, only: Sequence[str] = ()
) -> tuple[JudgedLook, ...]:
    """Return an example's looks, in the order of its steps.

    Parameters
    ----------
    task_file, plan_file : Path
        The task, and the plan compiled from it.
    surface : Surface
        Of all bodies.
    only : sequence of str
        Looks that are wanted; none: all.
    """
    plan = read_plan(plan_file).plan
    looks = {
        look.id: look
        for step in plan.steps
        for look in step.looks
        if not only or look.id in only
    }
    scenes = scenes_of(plan_file)
    return tuple(
        JudgedLook(
            id=name,
            surface=surface,
            trial=trial,
            cell=photographed(plan_file, looks[name], scenes[name], surface),
        )
        for name, trial in trial_cases(task_of(task_file, surface), looks)
    )


def cell_image(cell: Photographed, sampling: RaySampling | None = None) -> FloatArray:
    """Return a look's region by the cell's rays and waves, (rows, columns)."""
    return photograph(cell.scene, cell.view, cell.window, sampling=sampling)
