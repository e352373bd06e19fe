"""The import contracts: mistakes planted in a copy are found, at any depth."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from benchmarks.house import PACKAGES

ROOT = Path(__file__).parents[2]
# module -> what it must not import, even inside a function; which contract says so
PLANTED = {
    "planner/store/memo.py": ("planner.plan.options", "the compiler"),
    "executor/record/frames.py": ("executor.micromanager.drives", "the executor"),
    "featuresel/limits/crlb.py": ("featuresel.trials.score", "featuresel"),
    "optics/outline/offset.py": ("optics.render.render", "optics"),
    "schemas/page/console.py": ("schemas.files.world", "schemas"),
    "planner/drawings/pieces.py": ("planner.drawings.rings", "no folder's modules"),
    "planner/report/folder.py": ("planner.task.task", "what is made of a plan folder"),
    "executor/run/run.py": ("optics.oracle", "only the simulated cell"),
}


def test_a_planted_import_breaks_its_contract(tmp_path: Path) -> None:
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package)
    shutil.copytree(ROOT / "microplan", tmp_path / "microplan", symlinks=True)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for file, (module, _) in PLANTED.items():
        with (tmp_path / file).open("a", encoding="utf-8") as stream:
            stream.write(
                f"\n\ndef _planted() -> None:\n    import microplan.{module}\n"
            )
    done = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 1, done.stdout + done.stderr
    broken = re.findall(r"^(.*) BROKEN\b", done.stdout, re.MULTILINE)
    missed = [
        name
        for _, name in PLANTED.values()
        if not any(contract.startswith(name) for contract in broken)
    ]
    assert missed == [], done.stdout
