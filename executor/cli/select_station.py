"""Selection of the station: the simulated cell of world.json, or a station file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from inspect import getattr_static
from pathlib import Path
from typing import TYPE_CHECKING

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.station import Station
from microplan.executor.devices.station_file import read_station
from microplan.executor.simulated.cameras.kinds import JUDGE, CameraKind
from microplan.executor.simulated.faults import Faults

if TYPE_CHECKING:
    from microplan.executor.simulated.cell import Cell

SIMULATED = "sim"


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """A station, and the simulated cell behind it, if there is one."""

    name: str
    station: Station
    cell: Cell | None
    source: bytes | None = None  # of the station file, as it was read


def find_site(
    asked: str,
    plan_folder: Path,
    *,
    seed: int = 0,
    faults: Sequence[str] = (),
    camera: CameraKind | None = None,
    left: Path | None = None,
) -> Site:
    """Return the station that was asked for.

    Parameters
    ----------
    asked : str
        "sim", or the path of a station.toml.
    plan_folder : Path
        Its world.json is the simulated cell's.
    seed, faults, camera
        Of the simulated cell; a station file states its own.
    left : Path or None
        Where the simulated cell left its world; None: a new one is made.

    Raises
    ------
    ExecutorError
        MP803 and MP816 for world.json; MP804 for an unknown fault, or a seed, fault or
        camera together with a file; MP812 and MP813 for a station file.
    """
    try:
        Faults(faults)
    except ValueError as error:
        raise ExecutorError("MP804", str(error)) from error
    if asked == SIMULATED:
        return _simulated(plan_folder, seed, faults, camera or JUDGE, left)
    if faults or seed or camera:
        raise ExecutorError(
            "MP804",
            "--seed, --inject and --camera are for --station sim; a file states its "
            "own",
        )
    loaded = read_station(Path(asked), plan_folder)
    # statically: a proxy of a real hub answers to any name
    hubs = loaded.hubs.values()
    cells = [hub for hub in hubs if getattr_static(hub, "judge", None) is not None]
    return Site(
        name=loaded.name,
        station=loaded.station,
        cell=cells[0] if cells else None,
        source=loaded.source,
    )


def _simulated(
    plan_folder: Path,
    seed: int,
    faults: Sequence[str],
    camera: CameraKind,
    left: Path | None,
) -> Site:
    """Return the simulated cell of the plan's world."""
    # optics only for the simulated cell
    from microplan.executor.simulated.cell import build_cell
    from microplan.executor.simulated.hub import read_world

    world = read_world(plan_folder / "world.json")
    cell = build_cell(world, seed, faults, camera=camera)
    if left is not None:
        from microplan.executor.simulated.keeping import take

        take(cell, left)
    return Site(name=SIMULATED, station=cell.station, cell=cell)
