"""The arguments of microplan-run."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from microplan.executor.simulated.cameras.kinds import CAMERAS
from microplan.executor.simulated.faults import FAULTS
from microplan.schemas.page.completion import SHELLS, Completion
from microplan.schemas.page.console import add_version

MODES = ("run", "check", "dry-run", "replay", "compare", "report")

EPILOG = (
    "Exit status: 0 done and verified; 1 the assembly failed, the plan is "
    "infeasible, or a replay or comparison says no; 2 files or call at fault; 3 "
    "trouble with the machine, or it does not fit the plan; 4 the operator "
    "stopped it, or must decide; 70 a bug."
)


def build_parser() -> argparse.ArgumentParser:
    """Return the reader of the command line."""
    parser = argparse.ArgumentParser(
        prog="microplan-run",
        description="Run an augmented plan on a station, real or simulated.",
        epilog=EPILOG,
    )
    add_version(parser)
    parser.add_argument("plan", type=Path, help="plan.json, or the folder it is in")
    _add_station(parser)
    _add_mode(parser)
    _add_run(parser)
    _add_replay(parser)
    _add_comparison(parser)
    parser.add_argument(
        "--completion",
        action=Completion,
        choices=SHELLS,
        help="print a script that completes this command, and do nothing else",
    )
    return parser


def _add_station(parser: argparse.ArgumentParser) -> None:
    """Add where the plan is run."""
    parser.add_argument(
        "--station",
        help="sim: the simulated cell; or a station.toml; for run, check and dry-run",
    )
    parser.add_argument(
        "--seed", type=seed_number, help="of the simulated cell; default: 0"
    )
    parser.add_argument(
        "--camera",
        choices=CAMERAS,
        help="of the simulated cell; solid: bodies with walls, seen by rays and waves "
        "of its own (default); quick: the compiler's renderer, which judges no image",
    )


def _add_mode(parser: argparse.ArgumentParser) -> None:
    """Add what is to be done."""
    parser.add_argument(
        "--mode",
        choices=MODES,
        default="run",
        help="run: do it (the default); check: see whether plan and station fit, "
        "nothing moves; dry-run: list what would be done, nothing moves; replay: run "
        "on a record, or measure pictures; compare: test what the plan predicted over "
        "several runs; report: write a run's report.html anew",
    )


def _add_run(parser: argparse.ArgumentParser) -> None:
    """Add how a run is kept and watched."""
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
        dest="frames",
        action="store_false",
        help="keep neither images nor calls: the run cannot be replayed",
    )
    parser.add_argument(
        "--inject",
        dest="faults",
        action="append",
        default=[],
        metavar="FAULT[@STEP]",
        help="a simulated fault, from the start on or in one step: "
        + ", ".join(FAULTS),
    )
    parser.add_argument(
        "--step",
        dest="stepwise",
        action="store_true",
        help="tell every step and what cannot be undone before it is done, and wait",
    )


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
    _add_pictures(group)


def _add_pictures(group: argparse._ArgumentGroup) -> None:
    """Add the pictures of a look that are measured instead of a run's."""
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
        dest="turn_rad",
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


def _add_comparison(parser: argparse.ArgumentParser) -> None:
    """Add which runs are compared, and how what is found is printed."""
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
    """Return a finite angle in rad, written in degrees."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError("an angle is finite")
    return math.radians(value)
