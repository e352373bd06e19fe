"""How a whole run ended, and the summary that says so."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from microplan.executor.cli.options import RunOptions
from microplan.executor.cli.select_station import Site
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.record.journal import ESCAPED
from microplan.executor.record.outcome import RunResult
from microplan.executor.record.plan_file import PlanFile
from microplan.executor.record.run_folder import FRESH, SUMMARY
from microplan.executor.record.summary import injected, summary_json, table
from microplan.schemas.codec import to_data

if TYPE_CHECKING:
    from microplan.executor.simulated.judging import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """How a run ended; a simulated cell knows what truly became of it."""

    folder: Path
    result: RunResult
    verdict: Verdict | None
    errors_um: dict[str, float]  # step -> true error of its last look
    executors: int = 1  # that worked on it: more than one if it was resumed
    faults: tuple[str, ...] = ()  # that the cell was asked for
    idle_faults: tuple[str, ...] | None = ()  # met by nothing; None: not known


def told(ended: Ended) -> str:
    """Return the run's table, and the faults that were asked for."""
    words = table(ended.result, ended.errors_um)
    faults = injected(ended.faults, ended.idle_faults)
    return f"{words}\ninjected faults: {faults}" if faults else words


def write_summary(call: RunOptions, site: Site, file: PlanFile, ended: Ended) -> None:
    """Write summary.json and the table; MP863 if they cannot be written."""
    try:
        words = told(ended) + "\n"
        (ended.folder / "summary.txt").write_text(
            words, encoding="utf-8", errors=ESCAPED
        )
        text = summary_json(file.plan, ended.result, _extra(call, site, file, ended))
        fresh = ended.folder / FRESH  # as a whole or not at all: it says that it ended
        fresh.write_text(text, encoding="utf-8", errors=ESCAPED)
        fresh.replace(ended.folder / SUMMARY)
    except OSError as error:
        found = ended.result
        how = "done" if found.code is None else f"in {found.code}: {found.message}"
        raise ExecutorError(
            "MP863", f"the run has ended {how}; its summary: {error}"
        ) from error


def _extra(
    call: RunOptions, site: Site, file: PlanFile, ended: Ended
) -> dict[str, Any]:
    """Return what summary.json says beside the result."""
    verdict = ended.verdict
    return {
        "plan_sha256": file.sha256,
        "station": site.name,
        "seed": call.seed or 0,
        "executors": ended.executors,
        "faults": list(ended.faults),
        "idle_faults": to_data(ended.idle_faults),
        "cell_verdict": None if verdict is None else to_data(verdict),
        "true_look_error_um": to_data(ended.errors_um),
    }
