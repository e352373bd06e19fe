"""The two examples whose looks are judged, with their plans."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.example import ROOT, compile_s, given
from benchmarks.figures import Options
from microplan.planner.plan.cached_compile import compile_file
from microplan.planner.plan.options import Options as CompileOptions
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.folder import write_folder
from microplan.planner.task.presets import PRESETS, Preset

# a plan's looks are the same at all: fewer trials choose its chains
PRESET: Preset = "fast"
RANDOM_TRIALS = 1024  # that sigma is judged of: it errs by 2 %
PAIRS = PRESETS["balanced"].pairs  # of images, as by default


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
def long_plan(example: TruthExample, options: Options) -> Iterator[Path]:
    """Give the plan.json of an example, given or compiled now, that promises closely.

    By `RANDOM_TRIALS` and `PAIRS`: no preset has so many with so few others.
    """
    asked = given(options, example.task)
    if asked is not None:
        yield asked
        return
    with TemporaryDirectory() as name:
        report, folder = Report(), Path(name) / "example.plan"
        effort = replace(PRESETS[PRESET], random_trials=RANDOM_TRIALS, pairs=PAIRS)
        asks = CompileOptions(preset=PRESET, effort=effort, jobs=options.jobs)
        made = compile_file(str(example.file), report, asks, None, lambda _: None)
        if made is None:
            raise RuntimeError(f"{example.file}: {report.in_order}")
        write_folder(made, folder)
        yield folder / "plan.json"
