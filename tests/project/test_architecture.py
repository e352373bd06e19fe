"""The architecture page names the folders there are, and the executor starts light."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "architecture.md"
PACKAGES = ("planner", "executor", "featuresel", "optics", "schemas")


@pytest.mark.parametrize("package", PACKAGES)
def test_the_page_names_every_folder_of_a_package(package: str) -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert f"### `{package}/`" in text
    named = re.findall(rf"^\| `({package}/[\w/]+)/` \|", text, re.MULTILINE)
    folders = [init.parent for init in (ROOT / package).glob("**/__init__.py")]
    there = {folder.relative_to(ROOT).as_posix() for folder in folders} - {package}
    assert sorted(named) == sorted(there)


def test_starting_the_executor_loads_nothing_heavy() -> None:
    heavy = ("cv2", "scipy", "skimage", "ezdxf", "shapely", "yaml", "jsonschema",
             "microplan.optics")  # fmt: skip
    script = (
        "import sys, microplan.executor.cli.main\n"
        f"sys.exit(' '.join(m for m in {heavy!r} if m in sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.stderr.strip() == ""
