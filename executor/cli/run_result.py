"""Results of whole runs, with the truth that only a simulated cell knows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from microplan.executor.cli.options import RunOptions
from microplan.executor.cli.select_station import Site
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.record.outcome import RunResult, injected, summary_json, table
from microplan.executor.record.plan_file import PlanFile
from microplan.executor.record.run_folder import FRESH, SUMMARY
from microplan.executor.record.write_ahead_log import ESCAPED
from microplan.executor.run.run_context import Rig
from microplan.schemas.codec import to_data
from microplan.schemas.plan import Plan, VerifyAction

if TYPE_CHECKING:
    from microplan.executor.simulated.cell import Cell
    from microplan.executor.simulated.judging import Verdict


def keep_world(cell: Cell, path: Path) -> None:
    """Have a simulated cell keep its world in the journal's folder."""
    # optics only for the simulated cell
    from microplan.executor.simulated.keeping import keep

    try:
        keep(cell, path)
    except OSError as error:
        raise ExecutorError("MP863", f"{path}: {error}") from error


def watch(
    rig: Rig, cell: Cell | None, progress: Callable[[str], None] | None
) -> dict[str, float]:
    """Return a record, filled while the rig runs: step -> its last look's true error.

    Only a simulated cell knows the truth; a plan never sees it. `progress` is called
    with every step.
    """
    errors_um: dict[str, float] = {}
    rig.on_step = progress
    if cell is None:
        return errors_um
    shown_um, enter = cell.shown_um, cell.faults.enter

    def note(target: str, x_um: float, y_um: float) -> None:
        owner, offset = rig.beliefs.anchor(target)
        true_x, true_y = shown_um(owner, *offset)
        errors_um[rig.journal.step] = math.hypot(x_um - true_x, y_um - true_y)

    def begin(step: str) -> None:
        if progress is not None:
            progress(step)
        enter(step)

    rig.watch, rig.on_step = note, begin
    return errors_um


def judged(plan: Plan, cell: Cell) -> Verdict | None:
    """Return the cell's verdict on the target of the last verify step."""
    checks = [s.action for s in plan.steps if isinstance(s.action, VerifyAction)]
    if not checks or checks[-1].target.partition(".")[0] not in cell.truth.bodies:
        return None
    last = checks[-1]
    try:
        return cell.judge(last.target, last.on, last.within_um, last.within_rad)
    except (KeyError, ValueError):  # a plan of another world: there is no verdict
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """End of a run, with the verdict of a simulated cell."""

    folder: Path
    result: RunResult
    verdict: Verdict | None
    errors_um: dict[str, float]  # step -> true error of its last look
    executors: int = 1  # that worked on it: more than one if it was resumed
    faults: tuple[str, ...] = ()  # that the cell was asked for
    idle_faults: tuple[str, ...] | None = ()  # met by nothing; None: not known


def result_text(ended: Ended) -> str:
    """Return the run's table, and the faults that were asked for."""
    words = table(ended.result, ended.errors_um)
    faults = injected(ended.faults, ended.idle_faults)
    return f"{words}\ninjected faults: {faults}" if faults else words


def write_summary(
    options: RunOptions, site: Site, file: PlanFile, ended: Ended
) -> None:
    """Write summary.json and the table; MP863 if they cannot be written."""
    verdict = ended.verdict
    extra = {
        "plan_sha256": file.sha256,
        "station": site.name,
        "seed": options.seed or 0,
        "camera": options.simulated_camera,
        "executors": ended.executors,
        "faults": list(ended.faults),
        "idle_faults": to_data(ended.idle_faults),
        "cell_verdict": None if verdict is None else to_data(verdict),
        "true_look_error_um": to_data(ended.errors_um),
    }
    try:
        words = result_text(ended) + "\n"
        (ended.folder / "summary.txt").write_text(
            words, encoding="utf-8", errors=ESCAPED
        )
        text = summary_json(file.plan, ended.result, extra)
        fresh = ended.folder / FRESH  # moved as a whole: its presence marks the end
        fresh.write_text(text, encoding="utf-8", errors=ESCAPED)
        fresh.replace(ended.folder / SUMMARY)
    except OSError as error:
        found = ended.result
        how = "done" if found.code is None else f"in {found.code}: {found.message}"
        raise ExecutorError(
            "MP863", f"the run has ended {how}; its summary: {error}"
        ) from error
