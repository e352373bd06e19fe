"""The folder of a run: made empty, with the plan and the station file as read."""

from __future__ import annotations

import shutil
from pathlib import Path

from executor.errors import ExecutorError

EVENTS = "events.jsonl"
PLAN = "plan.json"
STATION = "station.toml"


def make_run_folder(folder: Path, plan: bytes, station: bytes | None) -> None:
    """Make an empty run folder that holds copies of plan and station file.

    An earlier run is replaced; a folder that holds something else is not touched.

    Parameters
    ----------
    folder : Path
        Where it is to be.
    plan, station : bytes
        The files as they were read; no station file on the simulated cell.

    Raises
    ------
    ExecutorError
        MP804 if it cannot be made, or is something else.
    """
    try:
        if folder.exists():
            if any(folder.iterdir()) and not (folder / EVENTS).is_file():
                raise ExecutorError("MP804", f"{folder} exists and is no run folder")
            shutil.rmtree(folder)
        folder.mkdir(parents=True)
        (folder / PLAN).write_bytes(plan)
        if station is not None:
            (folder / STATION).write_bytes(station)
    except OSError as error:
        raise ExecutorError("MP804", f"{folder}: {error}") from error
