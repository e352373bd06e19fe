"""What only a simulated cell can tell of a run: its world, true errors, a verdict."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.run.run_context import Rig
from microplan.schemas.plan import Plan, VerifyAction

if TYPE_CHECKING:
    from microplan.executor.simulated.cell import Cell
    from microplan.executor.simulated.judging import Verdict


def keep_world(cell: Cell, path: Path) -> None:
    """Have a simulated cell keep its world beside the journal."""
    from microplan.executor.simulated.keeping import (
        keep,  # optics only for the simulated cell
    )

    try:
        keep(cell, path)
    except OSError as error:
        raise ExecutorError("MP863", f"{path}: {error}") from error


def watch(
    rig: Rig, cell: Cell | None, progress: Callable[[str], None] | None
) -> dict[str, float]:
    """Return a record, filled while the rig runs: step -> its last look's true error.

    Only a simulated cell knows the truth; a plan never sees it. `progress` is told of
    every step.
    """
    errors: dict[str, float] = {}
    rig.on_step = progress
    if cell is not None:
        rig.watch = _noting(rig, cell, errors)
        rig.on_step = _beginning(cell, progress)
    return errors


def _noting(
    rig: Rig, cell: Cell, errors_um: dict[str, float]
) -> Callable[[str, float, float], None]:
    """Return what notes how far a sighting is from the truth, by step."""
    shown_um = cell.shown_um

    def note(target: str, x_um: float, y_um: float) -> None:
        owner, offset = rig.beliefs.anchor(target)
        true_x, true_y = shown_um(owner, *offset)
        errors_um[rig.journal.step] = math.hypot(x_um - true_x, y_um - true_y)

    return note


def _beginning(
    cell: Cell, progress: Callable[[str], None] | None
) -> Callable[[str], None]:
    """Return what begins and ends the cell's faults as steps begin."""
    enter = cell.faults.enter

    def begin(step: str) -> None:
        if progress is not None:
            progress(step)
        enter(step)

    return begin


def judged(plan: Plan, cell: Cell) -> Verdict | None:
    """Return what truly became of what the last verify step is about."""
    checks = [s.action for s in plan.steps if isinstance(s.action, VerifyAction)]
    if not checks or checks[-1].target.partition(".")[0] not in cell.truth.bodies:
        return None
    last = checks[-1]
    try:
        return cell.judge(last.target, last.on, last.within_um, last.within_rad)
    except (KeyError, ValueError):  # a plan of another world: nothing can be told
        return None
