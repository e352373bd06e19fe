"""`microplan` with less than any preset spends: python -m tests.planner.few_trials.

What it compiles keeps the name of the preset that it replaces: no cache may hold it.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

from microplan.planner.task.presets import PRESETS
from tests.planner.examples import EXAMPLE, FEW, microplan

EFFORT = FEW
# charged are what nobody predicts, as walls, faces, the lens, and layers of one look
MAX_IMAGE_ERROR = "0.1"


def compile_example(folder: Path) -> subprocess.CompletedProcess[str]:
    """Return what compiling the whole example into a plan folder did."""
    task, options = str(EXAMPLE / "task.yaml"), ("--no-cache", "--jobs", "2")
    words = ("--preset", "fast", "--max-image-error", MAX_IMAGE_ERROR)
    return microplan(
        "compile", task, "-o", str(folder), *words, *options, module=__name__
    )


def few_main(words: list[str]) -> int:
    """Return the exit status of `microplan`, whose preset `fast` spends less."""
    from microplan.planner.cli.main import main  # most tests compile nothing

    with patch.dict(PRESETS, {"fast": EFFORT}):
        return main(words)


if __name__ == "__main__":
    sys.exit(few_main(sys.argv[1:]))
