"""What was asked for on the command line of microplan-run."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from executor.simulated.faults import FAULTS

MODES = ("run", "check", "dry-run")


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """A call of the command."""

    plan_file: Path
    station: str
    seed: int
    mode: str
    run_dir: Path | None
    frames: bool
    faults: tuple[str, ...]

    @property
    def folder(self) -> Path:
        """Return the plan folder."""
        return self.plan_file.parent


def parse(argv: Sequence[str] | None) -> Call:
    """Return what the command line asks for.

    Raises
    ------
    SystemExit
        0 after --help, 2 for a call that cannot be understood.
    """
    found = _parser().parse_args(argv)
    return Call(
        plan_file=found.plan / "plan.json" if found.plan.is_dir() else found.plan,
        station=found.station,
        seed=found.seed,
        mode=found.mode,
        run_dir=found.run_dir,
        frames=not found.no_frames,
        faults=tuple(found.inject),
    )


def seed_number(text: str) -> int:
    """Return a seed, a whole number from 0 on."""
    value = int(text)
    if value < 0:
        raise ValueError("a seed is not negative")
    return value


def _parser() -> argparse.ArgumentParser:
    """Return the reader of the command line."""
    parser = argparse.ArgumentParser(
        prog="microplan-run",
        description="Run an augmented plan on a station.",
        epilog="Exit status: 0 done, 1 the answer is no, 2 input or call at fault, "
        "3 machine trouble, 4 stopped, 70 a bug.",
    )
    parser.add_argument("plan", type=Path, help="plan.json, or the folder it is in")
    parser.add_argument(
        "--station", required=True, help="sim: the simulated cell; or a station.toml"
    )
    parser.add_argument(
        "--seed", type=seed_number, default=0, help="of the simulated cell"
    )
    parser.add_argument(
        "--mode",
        choices=MODES,
        default="run",
        help="check: read and compare only; dry-run: list what would be done",
    )
    parser.add_argument("--run-dir", type=Path, help="default: <plan name>.run beside")
    parser.add_argument("--no-frames", action="store_true", help="keep no images")
    parser.add_argument(
        "--inject",
        action="append",
        default=[],
        metavar="FAULT[@STEP]",
        help="a simulated fault, from the start on or in one step: "
        + ", ".join(FAULTS),
    )
    return parser
