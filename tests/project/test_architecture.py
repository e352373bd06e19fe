"""The architecture page lists the modules there are."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "architecture.md"


def test_the_list_of_modules_is_up_to_date() -> None:
    script = (
        "import sys; sys.path.insert(0, 'docs'); import modules\n"
        "text = modules.PAGE.read_text(encoding='utf-8')\n"
        "sys.exit(modules.with_listing(text) != text)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, check=False
    )
    assert done.returncode == 0, b"run: python docs/modules.py\n" + done.stderr


def test_the_page_names_every_package() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for package in ("planner", "executor", "featuresel", "optics", "schemas"):
        assert f"### `{package}/`" in text


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
