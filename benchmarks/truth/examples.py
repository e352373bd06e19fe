"""The two examples whose looks are judged, with their plans."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from benchmarks.example import ROOT, compile_s, given
from benchmarks.figures import Options
from benchmarks.truth.compiler_side import Surface
from microplan.planner.plan.cached_compile import compile_file
from microplan.planner.plan.options import Options as CompileOptions
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.folder import write_folder
from microplan.planner.task.presets import PRESETS, Preset

# a plan's looks are the same at all: fewer trials choose its chains
PRESET: Preset = "fast"
RANDOM_TRIALS = 1024  # that sigma is judged of: it errs by 2 %
# stated in a task, and what the cell's bodies have; past black walls the post below
# the gear is too dark, and the task infeasible
STATED = Surface(wall=0.6)


@dataclass(frozen=True, slots=True, kw_only=True)
class TruthExample:
    """An example, by its short name in figures, and its looks."""

    name: str
    task: str  # as the task names itself
    file: Path
    looks: tuple[str, ...]


GEAR = TruthExample(
    name="gear",
    task="gear-on-shaft",
    file=ROOT / "examples" / "gear_on_shaft" / "task.yaml",
    looks=(
        "find_gear", "see_fingers", "bring_between", "gear_in_fingers", "find_shaft",
        "over_shaft", "check_seated.target", "check_seated.seat",
    ),
)  # fmt: skip
DIE = TruthExample(
    name="die",
    task="laser-die",
    file=ROOT / "examples" / "laser_die" / "task.yaml",
    looks=(
        "find_die", "see_fingers", "bring_between", "die_in_fingers", "find_submount",
        "over_site", "closer", "check.target", "check.seat",
    ),
)  # fmt: skip


@contextmanager
def plan_of(example: TruthExample, options: Options) -> Iterator[Path]:
    """Give the plan.json of an example: the command line's, or one compiled now."""
    asked = given(options, example.task)
    if asked is not None:
        yield asked
        return
    with TemporaryDirectory() as name:
        folder = Path(name) / "example.plan"
        compile_s(folder, options.jobs, task=example.file, preset=PRESET)
        yield folder / "plan.json"


@contextmanager
def stated_plan(
    example: TruthExample, surface: Surface, jobs: int
) -> Iterator[tuple[Path, Path]]:
    """Give the files of a task whose bodies all state one surface, and of its plan.

    Sigma and bias of its looks come from `RANDOM_TRIALS`.
    """
    with TemporaryDirectory() as name:
        folder = Path(name) / "example"
        shutil.copytree(example.file.parent, folder)
        task_file = folder / example.file.name
        state_surfaces(task_file, surface)
        plan_file = Path(name) / "plan" / "plan.json"
        _compile(task_file, plan_file.parent, jobs)
        yield task_file, plan_file


def state_surfaces(task_file: Path, surface: Surface) -> None:
    """Let all bodies of a task and of its workcell state one surface."""
    task = _read(task_file)
    workcell_file = task_file.parent / task["workcell"]
    workcell = _read(workcell_file)
    for body in (*task["parts"].values(), *workcell["tools"].values()):
        _state(body, surface)
        for post in body.get("posts", {}).values():
            _state(post, surface)
    for file, content in ((task_file, task), (workcell_file, workcell)):
        file.write_text(yaml.safe_dump(content), encoding="utf-8")


def _compile(task_file: Path, folder: Path, jobs: int) -> None:
    """Compile with so many random trials as no preset has with so few others."""
    report = Report()
    effort = replace(PRESETS[PRESET], random_trials=RANDOM_TRIALS)
    options = CompileOptions(preset=PRESET, effort=effort, jobs=jobs)
    made = compile_file(str(task_file), report, options, None, lambda _: None)
    if made is None:
        raise RuntimeError(f"{task_file}: {report.in_order}")
    write_folder(made, folder)


class _Loader(yaml.SafeLoader):
    """One for which `on` is a word, as in YAML 1.2."""


_Loader.yaml_implicit_resolvers = {
    letter: [
        (tag, form)
        for tag, form in rules
        if letter in "tTfF" or not tag.endswith(":bool")
    ]
    for letter, rules in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def _read(file: Path) -> dict[str, Any]:
    """Return what a YAML file holds."""
    found: dict[str, Any] = yaml.load(file.read_text(encoding="utf-8"), Loader=_Loader)
    return found


def _state(body: dict[str, object], surface: Surface) -> None:
    """State a body's surface, as a task or a workcell does."""
    body["finish"] = surface.finish
    body["wall"] = (
        {"kind": "mirror", "reflectance": surface.wall}
        if surface.wall
        else {"kind": "black"}
    )
