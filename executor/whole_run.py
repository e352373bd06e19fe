"""A whole run: the plan on a site, its run folder, and what became of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from executor.artifacts import Artifacts
from executor.asked import Call
from executor.beliefs import Beliefs
from executor.errors import ExecutorError
from executor.frames import Frames
from executor.journal import Journal
from executor.motion import Motion
from executor.operator import Operator
from executor.plan_file import PlanFile
from executor.recording import CALLS, Record
from executor.rig import Rig
from executor.run import RunResult, run_plan
from executor.run_folder import EVENTS, make_run_folder
from executor.site import Site
from executor.station import Station
from executor.summary import summary_json, table
from schemas.codec import to_data
from schemas.plan import Plan, VerifyAction

if TYPE_CHECKING:
    from executor.simulated.cell import Cell
    from executor.simulated.judging import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """How a run ended; a simulated cell knows what truly became of it."""

    folder: Path
    result: RunResult
    verdict: Verdict | None
    errors_um: dict[str, float]  # step -> true error of its last look


def perform(
    call: Call,
    file: PlanFile,
    site: Site,
    artifacts: Artifacts,
    ask: Callable[[], bool] | None,
    gate: Callable[[str], None] | None = None,
) -> Ended:
    """Run the plan and write the run folder.

    Parameters
    ----------
    call : Call
        What was asked for.
    file : PlanFile
        The plan.
    site : Site
        Where it runs.
    artifacts : Artifacts
        The plan's routines.
    ask : callable or None
        Return whether the operator goes on; None where nobody can be asked.
    gate : callable or None
        See `Rig.gate`.

    Raises
    ------
    ExecutorError
        MP804 if the run folder cannot be made; MP860 if the run is interrupted.
    """
    plan, station = file.plan, site.station
    folder = call.run_dir or call.folder.parent / f"{plan.name}.run"
    make_run_folder(folder, file.source, site.source)
    frames = Frames(folder if call.frames else None)
    with (
        (folder / EVENTS).open("w", encoding="utf-8", newline="\n") as stream,
        _recorded(folder, frames, station, _facts(file, site, artifacts)) as record,
        Operator(ask) as operator,
    ):
        rig = Rig(
            plan=plan,
            station=station if record is None else record.station(),
            beliefs=Beliefs(plan.beliefs, plan.features),
            artifacts=artifacts,
            journal=Journal(stream, station.clock),
            frames=frames,
            motion=Motion(operator.pause),
            gate=gate,
        )
        errors_um = _watch(rig, site.cell)
        result = _run(rig)
        if record is not None:
            record.close(result.code, result.message)
    verdict = None if site.cell is None else _verdict(plan, site.cell)
    ended = Ended(folder=folder, result=result, verdict=verdict, errors_um=errors_um)
    _write_summary(call, site, file, ended)
    return ended


@contextmanager
def _recorded(
    folder: Path, frames: Frames, station: Station, facts: Mapping[str, Any]
) -> Iterator[Record | None]:
    """Give the record of a run, None without frames: nothing could answer from it."""
    if not frames.wanted:
        yield None
        return
    with (folder / CALLS).open("w", encoding="utf-8", newline="\n") as stream:
        record = Record(stream, frames, station, facts)
        try:
            yield record
        except ExecutorError as error:  # an interrupt: MP860
            record.close(error.code, error.message)
            raise


def _facts(file: PlanFile, site: Site, artifacts: Artifacts) -> dict[str, Any]:
    """Return what a record says of its run beside the devices."""
    return {
        "plan": file.plan.name,
        "plan_sha256": file.sha256,
        "arrays_sha256": artifacts.sha256,
        "station": site.name,
    }


def _run(rig: Rig) -> RunResult:
    """Run the plan; whatever ends it, nothing is left in motion."""
    try:
        return run_plan(rig)
    except KeyboardInterrupt:
        left = "; ".join(rig.motion.stop(rig.station)) or "nothing moves any more"
        rig.journal.write("stopped", why=left)
        raise ExecutorError("MP860", f"stopped; {left}") from None
    except BaseException:  # a bug must not leave anything in motion either
        rig.motion.stop(rig.station)
        raise


def _watch(rig: Rig, cell: Cell | None) -> dict[str, float]:
    """Return a record, filled while the rig runs: step -> its last look's true error.

    Only a simulated cell knows the truth; a plan never sees it.
    """
    errors: dict[str, float] = {}
    if cell is None:
        return errors
    shown_um = cell.shown_um

    def note(target: str, x_um: float, y_um: float) -> None:
        owner, offset = rig.beliefs.anchor(target)
        true_x, true_y = shown_um(owner, *offset)
        errors[rig.journal.step] = math.hypot(x_um - true_x, y_um - true_y)

    rig.watch, rig.on_step = note, cell.faults.enter
    return errors


def _write_summary(call: Call, site: Site, file: PlanFile, ended: Ended) -> None:
    """Write summary.json and the table."""
    verdict, errors_um = ended.verdict, ended.errors_um
    extra: dict[str, Any] = {
        "plan_sha256": file.sha256,
        "station": site.name,
        "seed": call.seed,
        "faults": list(call.faults),
        "cell_verdict": None if verdict is None else to_data(verdict),
        "true_look_error_um": to_data(errors_um),
    }
    text = summary_json(file.plan, ended.result, extra)
    (ended.folder / "summary.json").write_text(text, encoding="utf-8")
    words = table(ended.result, errors_um) + "\n"
    (ended.folder / "summary.txt").write_text(words, encoding="utf-8")


def _verdict(plan: Plan, cell: Cell) -> Verdict | None:
    """Return what truly became of what the last verify step is about."""
    checks = [s.action for s in plan.steps if isinstance(s.action, VerifyAction)]
    if not checks or checks[-1].target.partition(".")[0] not in cell.truth.bodies:
        return None
    last = checks[-1]
    return cell.judge(last.target, last.on, last.within_um, last.within_rad)
