"""The simulated cell as a hub of a station file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.simulated.axes import DriveError
from microplan.executor.simulated.cameras.kinds import CameraKind
from microplan.executor.simulated.cell import SHOWN_LIGHT, Cell, build_cell
from microplan.executor.simulated.keeping import keep, take
from microplan.schemas.codec import from_data
from microplan.schemas.files.world import World


def cell(
    *,
    world: str,
    seed: int = 0,
    faults: Sequence[str] = (),
    quantum_um: float = 0.0,
    backlash_um: float = 0.0,
    lag_s: float = 0.0,
    kept: str = "",
    camera: CameraKind = "quick",
) -> Cell:
    """Return the cell of a file world.json.

    Parameters
    ----------
    world : str
        The file.
    seed : int
        Root of all the cell's random numbers.
    faults : sequence of str
        Names of `microplan.executor.simulated.faults.FAULTS`, or NAME@STEP.
    quantum_um, backlash_um, lag_s : float
        Of both drives; see `microplan.executor.simulated.axes.DriveError`.
    kept : str
        A file in which the cell's world outlives the executor; deleted, the cell is new
        again. "": nothing is kept.
    camera : "solid" or "quick"
        See `microplan.executor.simulated.cell.build_cell`.

    Raises
    ------
    ExecutorError
        MP803 if a file cannot be read; MP816 for light that the cell does not show;
        MP866 if `kept` is of another world.
    ValueError
        If a fault, a seed or the camera is none.
    """
    drive = DriveError(quantum_um=quantum_um, backlash_um=backlash_um, lag_s=lag_s)
    drives = {"stage": drive, "robot": drive}
    made = build_cell(
        read_world(Path(world)), seed, faults, drives=drives, camera=camera
    )
    if kept:
        if Path(kept).exists():
            take(made, Path(kept))
        keep(made, Path(kept))
    return made


def read_world(path: Path) -> World:
    """Return the world of a file; MP803 if it cannot be read, MP816 for its light."""
    try:
        text = path.read_text(encoding="utf-8")
        data = json.loads(text)
        world = from_data(World, data)
    except (OSError, ValueError, RecursionError) as error:
        raise ExecutorError("MP803", f"{path}: {error}") from error
    kind: str = world.optics.light_kind
    key = "light_kind"
    if key not in data["optics"] and data["optics"].get("lamp_share") == 0:
        kind, key = "other", "lamp_share"  # from before kinds: 0 meant not coaxial
    if kind != SHOWN_LIGHT:
        line = 1 + text[: text.find(f'"{key}"')].count("\n")
        raise ExecutorError(
            "MP816",
            f"the plan's images are of {kind} light, the simulated cell shows "
            f"{SHOWN_LIGHT} light alone; run the plan on a station file's devices, or "
            f"compile it with light.kind: {SHOWN_LIGHT} in the workcell",
            place=f"{path}:{line}",
        )
    return world
