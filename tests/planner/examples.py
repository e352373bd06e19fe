"""The gear-on-shaft example, whole or cut down, changed as a test needs it."""

from __future__ import annotations

import atexit
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from microplan.planner.source.diagnostics import Diagnostic, Report
from microplan.planner.task.presets import PRESETS
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "gear_on_shaft"
ONE_LOOK = "{id: see_post, do: locate, target: shaft_plate.post, view_um: [0, 0]}"
POST_UM = 12.0  # radius of the post of one look
GRASP = "{id: grasp, do: grasp, target: gear, with: tweezers, opening_um: 96}"
_DOWN = """\
  - {id: find_shaft, do: locate, target: shaft_plate.post, view_um: [0, -215]}
  - {id: over_shaft, do: align, target: shaft_plate.post, to: gear.bore, method: auto}
"""
# Less than any preset spends on a look, where its numbers do not matter.
FEW = replace(PRESETS["fast"], trials=8, random_trials=8, range_draws=1, drift_draws=1)


def copy_example(folder: Path) -> Path:
    """Return the task file of a copy of the example."""
    return Path(shutil.copytree(EXAMPLE, folder)) / "task.yaml"


def change(file: Path, old: str, new: str) -> None:
    """Replace the only place where `old` stands in a file."""
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{file.name} holds {old!r} {text.count(old)} times"
    file.write_text(text.replace(old, new), encoding="utf-8")


def cut(file: Path, *steps: str) -> None:
    """Replace the steps of a task, each given as a YAML flow mapping."""
    text = file.read_text(encoding="utf-8")
    body = "".join(f"  - {step}\n" for step in steps)
    fresh, count = re.subn(r"(?ms)^steps:\n.*?^$", f"steps:\n{body}", text)
    assert count == 1
    file.write_text(fresh, encoding="utf-8")


def one_look(file: Path, *, post_um: float = POST_UM) -> None:
    """Cut the task down to one look at a post, small and nearly in place: fast.

    The lens is known, and images may err by so much that no error has to be charged but
    that of unknown faces.
    """
    cut(file, ONE_LOOK)
    change(file.with_name("parts") / "shaft_plate.dxf", "22.0", f"{post_um}")
    change(file, "max_image_error: 0.002", "max_image_error: 0.06")
    change(file, "sigma_xy_um: 10", "sigma_xy_um: 2")
    known_lens(file)


def known_lens(file: Path) -> None:
    """Let the lens beside a task have neither aberrations nor a halo, as is known."""
    known = "wavefront_rms: 0\n  halo: {radius_um: 2, share: 0}\n  coherence: incoh"
    change(file.with_name("workcell.yaml"), "coherence: incoh", known)


def one_zoom(file: Path) -> None:
    """Let the microscope beside a task have its lowest magnification only."""
    change(file.with_name("workcell.yaml"), "max: 44.5}", "max: 6.9}")


def read(file: Path) -> Task:
    """Return the task that a file holds, which must be in order."""
    return _read_once(file) if file.is_relative_to(EXAMPLE.parent) else _read(file)


@cache  # nobody changes an example, or a task
def _read_once(file: Path) -> Task:
    return _read(file)


def _read(file: Path) -> Task:
    report = Report()
    task = load_task(str(file), report)
    assert task is not None, [d.message for d in report.found]
    return task


def beyond_notes(report: Report) -> list[Diagnostic]:
    """Return what is more than worth knowing: warnings, refusals and errors."""
    return [finding for finding in report.in_order if finding.severity != "note"]


def between_jaws(file: Path) -> None:
    """Start with the gear between the jaws, as if found and aligned."""
    change(file, "{x_um: -600, y_um: 0, z_um: 0, theta_deg: 0}", "{x_um: -600}")
    change(
        file,
        "theta: any, sigma_xy_um: 30, face: up}",
        "theta: any, sigma_xy_um: 1, face: up}",
    )
    change(file, "y_um: 3000, z_um: 400, opening_um", "y_um: 0, z_um: 30, opening_um")


def microplan(
    *words: str,
    hash_seed: str = "0",
    folder: Path = ROOT,
    module: str = "microplan.planner.cli.main",
) -> subprocess.CompletedProcess[str]:
    """Return what `microplan` with these arguments did, in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", module, *words],
        cwd=folder,
        env={**os.environ, "PYTHONHASHSEED": hash_seed},
        capture_output=True,
        text=True,
        check=False,
    )


def look_down_the_bore(file: Path) -> None:
    """Let the post be found in the gear's bore and be brought there by the stage."""
    text = file.read_text(encoding="utf-8")
    steps = re.compile(r"(?ms)^  - \{id: aside,.*?(?=^  - \{id: insert,)")
    fresh, count = steps.subn(_DOWN, text)
    assert count == 1
    file.write_text(fresh, encoding="utf-8")


@cache
def down_the_bore() -> Path:
    """Return the task file of the example that looks down the bore."""
    folder = Path(mkdtemp())
    atexit.register(shutil.rmtree, folder)
    file = copy_example(folder / "task")
    look_down_the_bore(file)
    return file
