"""Drawings as parts that a microscope looks for: compiled, run and judged."""

from __future__ import annotations

import contextlib
import io
import json
import math
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from microplan.executor.cli.main import main as run_main
from microplan.planner.cli.main import main as plan_main
from microplan.schemas.plan import Plan, parse_plan

EXAMPLE = Path(__file__).parents[2] / "examples" / "gear_on_shaft"
SEEDS = range(1, 6)
HEAD = ("file", "layers", "read as if in", "size um", "looked at", "found by", "at",
        "sigma promised um", "errors of the runs um")  # fmt: skip

_FIELD_UM = 3600  # the height of the example's sensor
_ROOM = 2.0  # fields' heights to a part's diagonal at the lowest magnification
_ZOOM, _APERTURE = "{min: 6.9, max: 44.5}", "numerical_aperture: 0.42"  # of the example

_TASK = """microplan: 1
name: {name}
workcell: workcell.yaml
seed: 1
parts:
  part:
    drawing: {{file: parts/{file}, units: {units}, layers: {layers}{cell}}}
    thickness_um: {thickness:g}
    reflectance: 0.8
    origin: outline
start:
  stage: {{x_um: 0, y_um: 0, z_um: 0, theta_deg: 0}}
  part: {{on: stage, x_um: 0, y_um: 0, theta_deg: 0, sigma_xy_um: {sigma:g}, sigma_theta_deg: 1}}
  tweezers: {{on: robot, x_um: 0, y_um: 9000, z_um: 4000, opening_um: 130}}
goal: {{}}
benchmark: {{focus_sigma_um: 1, magnification_sigma: 0.001, pose_sigma_theta_deg: 1}}
steps:
  - {{id: find, do: locate, target: part, view_um: [0, 0]}}
"""  # noqa: E501 - lines of the file


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A drawing that is one part, and how it is read."""

    path: Path
    called: str
    units: str
    layers: Sequence[str]
    cell: str  # "" for DXF files
    extent_um: float


def located(job: Job) -> tuple[str, ...]:
    """Return what was looked at, what was promised, and what the runs gave.

    Raises
    ------
    RuntimeError
        If compiler or executor end with a status other than 0 and 1.
    """
    with TemporaryDirectory() as name:
        folder = Path(name)
        write(job, folder)
        status, said = _heard(
            plan_main,
            ["compile", str(folder / "task.yaml"), "--preset", "fast",
             "-o", str(folder / "plan")],
        )  # fmt: skip
        layers = ", ".join(job.layers)
        head = (job.called, f"{job.cell}: {layers}" if job.cell else layers, job.units)
        size = f"{job.extent_um:.4g}"
        if status:
            if status != 1:
                raise RuntimeError(f"{job.called}: status {status}\n{said}")
            why = plan_of(folder).reasons[0].message.split(": ")
            return (*head, size, "", "", "", "", ": ".join(why[1:2]))
        errors = [_run(folder, seed) for seed in SEEDS]
        plan = plan_of(folder)
    return (*head, size, *_promise(plan), _errors(errors))


def write(job: Job, folder: Path) -> None:
    """Write a task with one look, round a copy of the drawing."""
    shutil.copytree(EXAMPLE / "parts", folder / "parts")
    name = f"drawn{job.path.suffix.lower()}"
    shutil.copyfile(job.path, folder / "parts" / name)
    cell = (EXAMPLE / "workcell.yaml").read_text(encoding="utf-8")
    for stated, fitting in zip((_ZOOM, _APERTURE), _optics(job), strict=True):
        if cell.count(stated) != 1:
            raise ValueError(f"the example's workcell lacks {stated!r}")
        cell = cell.replace(stated, fitting)
    (folder / "workcell.yaml").write_text(cell, encoding="utf-8")
    text = _TASK.format(
        name="drawn", file=name, units=job.units, layers=json.dumps(list(job.layers)),
        cell=f", cell: {json.dumps(job.cell)}" if job.cell else "",
        thickness=job.extent_um / 20, sigma=job.extent_um / 50,
    )  # fmt: skip
    (folder / "task.yaml").write_text(text, encoding="utf-8")


def _optics(job: Job) -> tuple[str, str]:
    """Return the zoom range and aperture of a microscope that sees the whole part.

    The example's, if it does; else one with its ratios.
    """
    low = min(6.9, _FIELD_UM / (_ROOM * math.sqrt(2) * job.extent_um))
    share = low / 6.9
    zoom = f"{{min: {low:.4g}, max: {44.5 * share:.4g}}}"
    return zoom, f"numerical_aperture: {0.42 * share:.4g}"


def _promise(plan: Plan) -> tuple[str, str, str, str]:
    """Return what is looked at, by which routines, how large, and how well."""
    look = plan.steps[0].looks[0]
    features = [measure.feature or look.target for measure in look.measures]
    chains = [" > ".join(use.id for use in m.chain) for m in look.measures]
    return (
        ", ".join(features),
        ", ".join(dict.fromkeys(chains)),
        f"{look.view.magnification:.3g} x",
        f"{look.sigma_xy_um:.2g}",
    )


def _run(folder: Path, seed: int) -> float | None:
    """Return how far a run's look was off by the cell's truth, None if it failed."""
    out = folder / f"run-{seed}"
    words = [str(folder / "plan"), "--station", "sim", "--camera", "quick"]
    more = ["--seed", str(seed), "--no-frames", "--run-dir", str(out)]
    status, said = _heard(run_main, [*words, *more])
    if status not in (0, 1, 3):
        raise RuntimeError(f"seed {seed} ended with {status}:\n{said}")
    if status:
        return None
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    error: float = summary["true_look_error_um"]["find"]
    return error


def _errors(errors: Sequence[float | None]) -> str:
    """Return the errors of the runs, and how many failed aloud."""
    found = sorted(error for error in errors if error is not None)
    failed = len(errors) - len(found)
    said = f"{median(found):.2g}, at most {found[-1]:.2g}" if found else ""
    return said + (f"; {failed} of {len(errors)} failed aloud" if failed else "")


def plan_of(folder: Path) -> Plan:
    """Return the compiled plan."""
    return parse_plan((folder / "plan" / "plan.json").read_text(encoding="utf-8"))


def _heard(command: Any, words: Sequence[str]) -> tuple[int, str]:
    """Return the status of a command and what it said."""
    heard = io.StringIO()
    with contextlib.redirect_stdout(heard), contextlib.redirect_stderr(heard):
        status: int = command(words)
    return status, heard.getvalue()
