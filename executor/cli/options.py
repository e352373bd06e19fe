"""Options of a call of microplan-run, checked for contradictions."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from microplan.executor.cli.arguments import build_parser
from microplan.executor.cli.select_station import SIMULATED
from microplan.executor.devices.station_file import exists, is_folder
from microplan.executor.simulated.cameras.kinds import JUDGE, CameraKind

NO_STATION = ("replay", "compare", "report")  # they touch no device


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """A call of the command."""

    plan_file: Path
    station: str  # "" where the mode needs none
    seed: int | None  # None: 0, or that of the run that is resumed
    camera: CameraKind | None  # None: the judge, or that of the run that is resumed
    mode: str
    run_dir: Path | None
    frames: bool
    faults: tuple[str, ...]
    resume: bool = False
    discard: bool = False
    stepwise: bool = False
    record: Path | None = None  # replay: the run folder
    anyway: bool = False
    pictures: Path | None = None  # replay: a folder of pictures of `look`
    look: str = ""
    bits: int | None = None  # of the pictures
    still: bool = False  # nothing moved between the pictures
    turn_rad: float | None = None  # of the target in them, None: not known
    marked: Path | None = None  # where the marked pictures go
    runs: tuple[Path, ...] = ()  # compare
    format: str = "text"

    @property
    def folder(self) -> Path:
        """Return the plan folder."""
        return self.plan_file.parent

    @property
    def station_file(self) -> Path | None:
        """Return the station's file, None for the simulated cell."""
        return None if self.station == SIMULATED else Path(self.station)

    @property
    def simulated_camera(self) -> CameraKind | None:
        """Return the camera of the simulated cell, None of a station file."""
        return (self.camera or JUDGE) if self.station_file is None else None


def parse(argv: Sequence[str] | None) -> RunOptions:
    """Return the options of a command line.

    Raises
    ------
    SystemExit
        0 after --help, 2 for a call that cannot be understood.
    """
    parser = build_parser()
    found = parser.parse_args(argv)
    wrong = _contradiction(found)
    if wrong:
        parser.error(wrong)
    is_plan_folder = is_folder(found.plan)
    found.plan_file = found.plan / "plan.json" if is_plan_folder else found.plan
    given = {each.name: getattr(found, each.name) for each in fields(RunOptions)}
    given["station"] = found.station or ""
    given["faults"], given["runs"] = tuple(found.faults), tuple(found.runs)
    return RunOptions(**given)


def _contradiction(found: argparse.Namespace) -> str:
    """Return what is wrong with a call as a whole, "" if nothing is."""
    for wrong in (_station, _sources, _pictures, _beside_a_run):
        if told := wrong(found):
            return told
    return ""


def _station(found: argparse.Namespace) -> str:
    """Return whether a mode lacks its station, or has one that it does not touch."""
    mode = found.mode
    if mode not in NO_STATION and not found.station:
        told = f"--mode {mode} needs --station; --station sim is the simulated cell"
        return told if exists(found.plan) else f"there is no {found.plan}; {told}"
    if mode in NO_STATION and (found.station or found.faults or found.camera):
        return (
            f"--mode {mode} touches no device: "
            "leave --station, --inject and --camera out"
        )
    return ""


def _sources(found: argparse.Namespace) -> str:
    """Return what is wrong with what a mode reads besides the plan."""
    mode, pictures, record = found.mode, found.pictures, found.record
    if mode == "replay" and (record is None) == (pictures is None):
        return "--mode replay needs --from RUN, or --pictures FOLDER and --look LOOK"
    if mode == "report" and (record is None or pictures is not None):
        return "--mode report needs --from RUN"
    if mode not in ("replay", "report") and not (record is None and pictures is None):
        return "--from and --pictures are for --mode replay"
    if (pictures is None) != (not found.look):
        return "--pictures and --look belong together: the look that they show"
    if (mode == "compare") != bool(found.runs):
        return "--mode compare and --runs RUN ... belong together"
    return ""


def _pictures(found: argparse.Namespace) -> str:
    """Return which option lacks the pictures or the record that it is for."""
    alone = {
        "--bits": found.bits is not None, "--still": found.still,
        "--turn-deg": found.turn_rad is not None, "--marked": found.marked is not None,
    }  # fmt: skip
    if found.pictures is None and any(alone.values()):
        return f"{next(k for k, v in alone.items() if v)} is for --pictures"
    if found.anyway and found.record is None:
        return "--anyway is for --from"
    return ""


def _beside_a_run(found: argparse.Namespace) -> str:
    """Return what is wrong with the options that not every mode has."""
    mode, pictures = found.mode, found.pictures
    if found.format != "text" and pictures is None and mode != "compare":
        return "--format is for --pictures and --mode compare; a run has summary.json"
    if found.stepwise and mode != "run":
        return "--step is for --mode run"
    if found.resume and (found.discard or mode != "run"):
        return "--resume goes with neither --discard nor another --mode than run"
    return ""
