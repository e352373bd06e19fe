"""Renew the golden plans: python -m tests.golden."""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from tests.planner.examples import EXAMPLE, microplan

GOLDEN = Path(__file__).with_name("gear_on_shaft.fast.json")


def main() -> int:
    """Compile the example at preset fast and keep its plan."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "gear-on-shaft.plan"
        task = str(EXAMPLE / "task.yaml")
        options = ("-o", str(folder), "--preset", "fast", "--jobs", "2")
        done = microplan("compile", task, *options)
        sys.stderr.write(done.stderr + done.stdout)
        if done.returncode == 0:
            shutil.copyfile(folder / "plan.json", GOLDEN)
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
