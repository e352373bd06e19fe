"""The import name `microplan`: what it hands on, and how it finds its folders."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import microplan

ROOT = Path(__file__).parents[2]
FOLDERS = ("planner", "executor", "featuresel", "optics", "schemas")


def _printed(code: str, folder: Path) -> str:
    """Return what a fresh interpreter prints that finds modules in a folder."""
    program = f"import sys; sys.path.insert(0, {str(folder)!r})\n{code}"
    done = subprocess.run(
        [sys.executable, "-P", "-c", program],
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


@pytest.mark.parametrize("name", microplan.__all__)
def test_every_public_name_leads_to_what_it_names(name: str) -> None:
    assert getattr(microplan, name).__name__ == name
    assert name in dir(microplan)


def test_no_other_name_is_handed_on() -> None:
    with pytest.raises(AttributeError, match="no attribute 'compile_plan'"):
        _ = microplan.compile_plan


def test_importing_the_package_loads_nothing_else() -> None:
    code = (
        "import __future__; before = set(sys.modules); import microplan\n"
        "print(sorted(set(sys.modules) - before))"
    )
    assert _printed(code, ROOT) == "['microplan']"


def test_a_compiler_is_loaded_only_where_compiled_loops_are_called() -> None:
    """In one process: what loads a compiler is found first where it is loaded."""
    modules = ("optics.light.lit_image", "featuresel.trials.trials",
               "planner.plan.compiler")  # fmt: skip
    code = "; ".join(
        f"import microplan.{name}; print('{name}' * ('numba' in sys.modules), end='')"
        for name in modules
    )
    assert _printed(code, ROOT) == ""


@pytest.mark.parametrize("links", ["none", "text"])
def test_without_links_the_folders_beside_it_are_found(
    links: str, tmp_path: Path
) -> None:
    (tmp_path / "microplan").mkdir()
    for file in (ROOT / "microplan").glob("*.py"):
        shutil.copy(file, tmp_path / "microplan")
    for name in FOLDERS:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(f"HERE = {name!r}\n")
        if links == "text":  # as git writes them where links are not allowed
            (tmp_path / "microplan" / name).write_text(f"../{name}")
    code = "".join(f"import microplan.{name}\n" for name in FOLDERS)
    code += f"print(*(getattr(microplan, n).HERE for n in {FOLDERS!r}))"
    assert _printed(code, tmp_path) == " ".join(FOLDERS)
