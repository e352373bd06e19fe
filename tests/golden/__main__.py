"""Renew the golden plans: python -m tests.golden."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from tests.planner.examples import EXAMPLE, microplan
from tests.planner.few_trials import compile_example

GOLDEN = Path(__file__).with_name("gear_on_shaft.fast.json")
FEW_TRIALS = GOLDEN.with_name("gear_on_shaft.few.json")


def compile_fast(folder: Path) -> subprocess.CompletedProcess[str]:
    """Return what compiling the example at preset fast did."""
    options = ("-o", str(folder), "--preset", "fast", "--jobs", "2")
    return microplan("compile", str(EXAMPLE / "task.yaml"), *options)


def renew(
    golden: Path, compiled: Callable[[Path], subprocess.CompletedProcess[str]]
) -> int:
    """Return the exit status of a compile whose plan is kept if it is 0."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "gear-on-shaft.plan"
        done = compiled(folder)
        sys.stderr.write(done.stderr + done.stdout)
        if done.returncode == 0:
            shutil.copyfile(folder / "plan.json", golden)
    return done.returncode


def main() -> int:
    """Compile the example with few trials and at preset fast; keep both plans."""
    return renew(FEW_TRIALS, compile_example) or renew(GOLDEN, compile_fast)


if __name__ == "__main__":
    sys.exit(main())
