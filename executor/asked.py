"""What was asked for on the command line of microplan-run."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from executor.completion import SHELLS, Completion
from executor.paths import is_folder
from executor.simulated.faults import FAULTS
from executor.site import SIMULATED

MODES = ("run", "check", "dry-run", "replay", "compare", "report")
NO_STATION = ("replay", "compare", "report")  # they touch no device


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """A call of the command."""

    plan_file: Path
    station: str  # "" where the mode needs none
    seed: int | None  # None: 0, or that of the run that is resumed
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


def parse(argv: Sequence[str] | None) -> Call:
    """Return what the command line asks for.

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
    return Call(
        plan_file=found.plan / "plan.json" if is_folder(found.plan) else found.plan,
        station=found.station or "",
        seed=found.seed,
        mode=found.mode,
        run_dir=found.run_dir,
        frames=not found.no_frames,
        faults=tuple(found.inject),
        resume=found.resume,
        discard=found.discard,
        stepwise=found.step,
        record=found.record,
        anyway=found.anyway,
        pictures=found.pictures,
        look=found.look,
        bits=found.bits,
        still=found.still,
        turn_rad=None if found.turn_deg is None else math.radians(found.turn_deg),
        marked=found.marked,
        runs=tuple(found.runs),
        format=found.format,
    )


def _contradiction(found: argparse.Namespace) -> str:
    """Return what is wrong with a call as a whole, "" if nothing is."""
    mode, pictures, record = found.mode, found.pictures, found.record
    if mode not in NO_STATION and not found.station:
        return f"--mode {mode} needs --station"
    if mode in NO_STATION and (found.station or found.inject):
        return f"--mode {mode} touches no device: leave --station and --inject out"
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
    alone = {
        "--bits": found.bits is not None, "--still": found.still,
        "--turn-deg": found.turn_deg is not None, "--marked": found.marked is not None,
    }  # fmt: skip
    if pictures is None and any(alone.values()):
        return f"{next(k for k, v in alone.items() if v)} is for --pictures"
    if found.anyway and record is None:
        return "--anyway is for --from"
    return _beside_a_run(found)


def _beside_a_run(found: argparse.Namespace) -> str:
    """Return what is wrong with the options that not every mode has."""
    mode, pictures = found.mode, found.pictures
    if found.format != "text" and pictures is None and mode != "compare":
        return "--format is for --pictures and --mode compare; a run has summary.json"
    if found.step and mode != "run":
        return "--step is for --mode run"
    if found.resume and (found.discard or mode != "run"):
        return "--resume goes with neither --discard nor another --mode than run"
    return ""


def seed_number(text: str) -> int:
    """Return a seed, a whole number from 0 on."""
    value = int(text)
    if value < 0:
        raise ValueError("a seed is not negative")
    return value


def bit_number(text: str) -> int:
    """Return a number of bits, 1 to 16."""
    value = int(text)
    if not 1 <= value <= 16:
        raise ValueError("a picture has 1 to 16 bits")
    return value


def angle_number(text: str) -> float:
    """Return a finite angle."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError("an angle is finite")
    return value


def build_parser() -> argparse.ArgumentParser:
    """Return the reader of the command line."""
    parser = argparse.ArgumentParser(
        prog="microplan-run",
        description="Run an augmented plan on a station, real or simulated.",
        epilog="Exit status: 0 done and verified; 1 the assembly failed, the plan is "
        "infeasible, or a replay or comparison says no; 2 files or call at fault; 3 "
        "trouble with the machine, or it does not fit the plan; 4 the operator "
        "stopped it, or must decide; 70 a bug.",
    )
    parser.add_argument("plan", type=Path, help="plan.json, or the folder it is in")
    parser.add_argument(
        "--station",
        help="sim: the simulated cell; or a station.toml; for run, check and dry-run",
    )
    parser.add_argument(
        "--seed", type=seed_number, help="of the simulated cell; default: 0"
    )
    parser.add_argument(
        "--mode",
        choices=MODES,
        default="run",
        help="run: do it (the default); check: see whether plan and station fit, "
        "nothing moves; dry-run: list what would be done, nothing moves; replay: run "
        "on a record, or measure pictures; compare: test what the plan predicted over "
        "several runs; report: write a run's report.html anew",
    )
    parser.add_argument(
        "--run-dir",
        type=Path,
        help="where the run is kept; default: <plan's name>.run beside the plan folder",
    )
    parser.add_argument(
        "--resume", action="store_true", help="go on with the run in the run folder"
    )
    parser.add_argument(
        "--discard", action="store_true", help="throw away a run that did not end"
    )
    parser.add_argument(
        "--no-frames",
        action="store_true",
        help="keep neither images nor calls: the run cannot be replayed",
    )
    parser.add_argument(
        "--inject",
        action="append",
        default=[],
        metavar="FAULT[@STEP]",
        help="a simulated fault, from the start on or in one step: "
        + ", ".join(FAULTS),
    )
    parser.add_argument(
        "--step",
        action="store_true",
        help="tell every step and what cannot be undone before it is done, and wait",
    )
    _add_replay(parser)
    parser.add_argument(
        "--runs",
        type=Path,
        nargs="+",
        default=[],
        metavar="RUN",
        help="the run folders to compare; the plan stands before them",
    )
    parser.add_argument(
        "--format",
        choices=["text", "json"],
        default="text",
        help="of what --pictures and --mode compare print",
    )
    parser.add_argument(
        "--completion",
        action=Completion,
        choices=SHELLS,
        help="print a script that completes this command, and do nothing else",
    )
    return parser


def _add_replay(parser: argparse.ArgumentParser) -> None:
    """Add what the mode replay reads."""
    group = parser.add_argument_group("replay")
    group.add_argument(
        "--from", dest="record", type=Path, metavar="RUN", help="the folder of a run"
    )
    group.add_argument(
        "--anyway",
        action="store_true",
        help="go on with another plan or changed frames: tells where they part",
    )
    group.add_argument(
        "--pictures", type=Path, metavar="FOLDER", help="your own, of one look"
    )
    group.add_argument("--look", default="", help="the look that the pictures show")
    group.add_argument(
        "--bits",
        type=bit_number,
        help="of the pictures' full scale; default: the file's, or the camera's if it "
        "has more than 8",
    )
    group.add_argument(
        "--still",
        action="store_true",
        help="nothing was moved between the pictures: judge how they scatter",
    )
    group.add_argument(
        "--turn-deg",
        type=angle_number,
        metavar="A",
        help="the part's angle in the pictures, if it is known",
    )
    group.add_argument(
        "--marked",
        type=Path,
        metavar="FOLDER",
        help="for the marked pictures; default: <look>.marked beside theirs",
    )
