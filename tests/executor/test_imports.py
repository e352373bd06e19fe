"""What importing the executor loads: the standard library and numpy."""

from __future__ import annotations

import pkgutil
import subprocess
import sys

import pytest

from microplan import executor

OURS = {"executor", "schemas", "featuresel", "arrays"}
# what renders, or is for a core of Micro-Manager that is installed with an extra
APART = ("microplan.executor.simulated", "microplan.executor.micromanager.demo",
         "microplan.executor.micromanager.rendered_camera")  # fmt: skip


def everything() -> list[str]:
    """Return every module of the executor but those that are apart."""
    found = pkgutil.walk_packages(executor.__path__, "microplan.executor.")
    return sorted(m.name for m in found if not m.name.startswith(APART))


def loaded(code: str) -> set[str]:
    """Return the modules that a fresh interpreter has after `code`."""
    words = [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize(
    "modules", [["microplan.executor", "microplan.executor.cli.main"], everything()]
)
def test_importing_the_executor_loads_numpy_and_the_standard_library_only(
    modules: list[str],
) -> None:
    assert {"microplan.executor.cli.main"} <= set(modules)
    before = {name.partition(".")[0] for name in loaded("")}
    found = loaded("\n".join(f"import {name}" for name in modules))
    tops = {name.partition(".")[0] for name in found}
    others = tops - before - set(sys.stdlib_module_names)
    assert others == {"microplan", "numpy"}
    assert {
        name.split(".")[1] for name in found if name.startswith("microplan.")
    } <= OURS
    assert set(modules) <= found
    drawing = {
        "microplan.executor.simulated.cell",
        "microplan.executor.simulated.camera",
    }
    assert not drawing & found
