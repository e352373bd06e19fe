"""The gear-on-shaft example, compiled in a process of its own."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.figures import Options
from benchmarks.timing import python_s

ROOT = Path(__file__).parents[1]
TASK = ROOT / "examples" / "gear_on_shaft" / "task.yaml"
_CALL = (
    "import sys; from microplan.planner.cli.main import main; "
    "sys.exit(main(sys.argv[1:]))"
)


def compile_s(
    folder: Path, jobs: int, *, task: Path = TASK, preset: str | None = None
) -> float:
    """Compile an example into `folder`; return the wall time, s.

    Raises
    ------
    RuntimeError
        If the compiler does not end with status 0.
    """
    call = ["compile", str(task), "-o", str(folder), "--jobs", str(jobs)]
    if preset is not None:
        call += ["--preset", preset]
    return python_s(["-c", _CALL, *call])


def given(options: Options, name: str) -> Path | None:
    """Return the plan that the command line gives, if it is that of task `name`."""
    if options.plan is None:
        return None
    plan = json.loads(options.plan.read_text(encoding="utf-8"))
    return options.plan if plan["name"] == name else None
