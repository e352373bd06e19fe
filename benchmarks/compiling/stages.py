"""Where the compiler's time goes: CPU time of the gear-on-shaft example by stage.

Each preset compiles in a fresh process of one thread, all tables cold, with its stages
between two readings of the process's clock. The floor is one transform pair for each
image that was rendered, of its own size. How much of the whole is rendering, in
whatever stage, is told by samples of the stack.
"""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial, wraps
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.example import TASK
from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.optics.rendering import floor_ms
from benchmarks.share import Share
from microplan import optics

PRESETS = ("fast", "balanced")
# stage -> where the function that does it is called from; none calls another, but that
# trial_images is a part of trials
STAGES: Mapping[str, tuple[str, str]] = {
    "scene": (
        "microplan.planner.looks.look_problem",
        "build_case",
    ),  # and how well it has to be rendered
    "prepare": ("microplan.featuresel.selection.evaluate", "prepare"),
    "trials": ("microplan.featuresel.selection.evaluate", "race"),
    "trial_images": ("microplan.featuresel.trials.trials", "exposed"),
    "limit": ("microplan.featuresel.selection.evaluate", "limit_um"),
    "usable_range": ("microplan.planner.looks.look_record", "usable_range"),
    "drifts": ("microplan.planner.budget.allowable_errors", "_reach"),
    "pictures": ("microplan.planner.looks.look_record", "reference_image"),
    "pairs": ("microplan.planner.looks.model_errors.chain_differences", "image_pairs"),
}
RENDERERS = ("render_lit", "occluded")  # of `microplan.featuresel.look.scenario`


@dataclass(frozen=True, slots=True, kw_only=True)
class Spent:
    """What one compile took."""

    total_s: float
    stages_s: dict[str, float]
    images: list[tuple[int, int, int]]  # rows, columns, how many
    optics_share: float  # of the time, 0..1


def spent(preset: str) -> Spent:
    """Compile the example in a process of its own; return the CPU time by stage.

    Raises
    ------
    RuntimeError
        If the compiler does not end with status 0.
    """
    with TemporaryDirectory() as folder:
        out = Path(folder) / "spent.json"
        call = [
            sys.executable,
            "-m",
            "benchmarks.compiling.stages",
            preset,
            folder,
            str(out),
        ]
        done = subprocess.run(call, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"{call} ended with {done.returncode}:\n{done.stderr}")
        return Spent(**json.loads(out.read_text(encoding="utf-8")))


def main(argv: Sequence[str]) -> int:
    """Compile with a preset into a folder, write what it took; return the status."""
    preset, folder, out = argv
    stages = dict.fromkeys(STAGES, 0.0)
    images: Counter[tuple[int, int]] = Counter()
    for stage, (module, name) in STAGES.items():
        _replace(module, name, partial(_timed, stages, stage))
    for name in RENDERERS:
        _replace("microplan.featuresel.look.scenario", name, partial(_counted, images))
    cli = importlib.import_module("microplan.planner.cli.main")
    plan = str(Path(folder) / "example.plan")
    call = ["compile", str(TASK), "-o", plan, "--preset", preset, "--no-cache"]
    share = Share(package=optics)
    status: int = share.of(lambda: cli.main(call))
    found = Spent(
        total_s=time.process_time(),
        stages_s=stages,
        images=[(*size, count) for size, count in sorted(images.items())],
        optics_share=share.value,
    )
    Path(out).write_text(json.dumps(asdict(found)), encoding="utf-8")
    return status


def _replace(
    module: str, name: str, around: Callable[[Callable[..., Any]], Callable[..., Any]]
) -> None:
    """Put something around a function of a module of this process."""
    owner = importlib.import_module(module)
    setattr(owner, name, around(getattr(owner, name)))


def _timed(
    stages: dict[str, float], stage: str, work: Callable[..., Any]
) -> Callable[..., Any]:
    """Return the function, adding its CPU time to a stage."""

    @wraps(work)
    def run(*args: Any, **options: Any) -> Any:
        start = time.process_time()
        try:
            return work(*args, **options)
        finally:
            stages[stage] += time.process_time() - start

    return run


def _counted(
    images: Counter[tuple[int, int]], work: Callable[..., Any]
) -> Callable[..., Any]:
    """Return the renderer, counting its images by size."""

    @wraps(work)
    def run(*args: Any, **options: Any) -> Any:
        image = work(*args, **options)
        images[image.shape] += 1
        return image

    return run


def _measure(_options: Options) -> Iterator[Figure]:
    for preset in PRESETS:
        found = spent(preset)
        yield from figures(preset, found, _floor_s(found))


def _floor_s(found: Spent) -> float:
    """Return the time of a transform pair for each image, s."""
    return sum(n * floor_ms(rows, columns) for rows, columns, n in found.images) / 1e3


def figures(preset: str, found: Spent, floor_s: float) -> Iterator[Figure]:
    """Yield one compile's figures; what no stage has is the total's alone."""
    name = f"compile.{preset}"
    yield Figure(name=f"{name}.cpu_s", value=found.total_s, unit="s", floor=floor_s)
    for stage in STAGES:
        yield Figure(name=f"{name}.{stage}_s", value=found.stages_s[stage], unit="s")
    images = sum(count for *_, count in found.images)
    yield Figure(name=f"{name}.images", value=images, unit="1")
    yield Figure(name=f"{name}.optics_share", value=found.optics_share, unit="1")
    if preset == "balanced":
        share = found.stages_s["pairs"] / found.total_s
        yield Figure(name="compile.judge_share", value=share, unit="1")


def _names(preset: str) -> tuple[str, ...]:
    stages = (f"{stage}_s" for stage in STAGES)
    kinds = ("cpu_s", *stages, "images", "optics_share")
    names = tuple(f"compile.{preset}.{kind}" for kind in kinds)
    return (*names, "compile.judge_share") if preset == "balanced" else names


BENCHMARK = Benchmark(
    names=tuple(name for preset in PRESETS for name in _names(preset)),
    measure=_measure,
)

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
