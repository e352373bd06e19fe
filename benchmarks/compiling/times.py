"""How long the example compiles: cold, unchanged, one step and one part changed.

Each compile is a process of its own with a cache folder of its own. Times are wall
times of the whole process; "1_job" is one worker, the others have two.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy import fft

from benchmarks.example import TASK
from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.timing import best_s, python_s

# what is changed: (file, text, other text)
STEP = ("task.yaml", "within_um: 2.9", "within_um: 2.8")
STEP_ID = "check_seated"  # of others a tolerance may decide what looks before must meet
PART = ("task.yaml", "reflectance: 0.80", "reflectance: 0.78")
_CALL = (
    "import sys; from microplan.planner.cli.main import main; "
    "sys.exit(main(sys.argv[1:]))"
)
_KIB = 1024  # `ru_maxrss` is in KiB on Linux
_REPEATS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Spent:
    """What one compile took."""

    wall_s: float
    cpu_s: float  # of all its processes
    peak_mib: float  # of the largest of them
    steps_s: dict[str, float]  # by the compiler's own clock


def compiled(task: Path, folder: Path, *, jobs: int, cache: Path) -> Spent:
    """Compile a task at `balanced` in a process of its own.

    Raises
    ------
    RuntimeError
        If the compiler does not end with status 0.
    """
    out = folder / "plan"
    shutil.rmtree(out, ignore_errors=True)
    call = [sys.executable, "-c", _CALL, "compile", str(task), "-o", str(out)]
    call += ["--preset", "balanced", "--jobs", str(jobs), "--cache", str(cache)]
    log = folder / "log"
    start = time.perf_counter()
    with log.open("w") as said:
        process = subprocess.Popen(call, stdout=said, stderr=said)
        _, status, usage = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{call} ended with {process.returncode}: {log.read_text()}")
    timings = json.loads((out / "timings.json").read_text(encoding="utf-8"))
    return Spent(
        wall_s=wall_s,
        cpu_s=usage.ru_utime + usage.ru_stime,
        peak_mib=usage.ru_maxrss / _KIB,
        steps_s={
            key.removeprefix("steps.").removesuffix("_s"): float(value)
            for key, value in timings.items()
            if key.startswith("steps.")
        },
    )


def changed(task: Path, change: tuple[str, str, str]) -> None:
    """Change one value of the copy of a task.

    Raises
    ------
    ValueError
        If the text is not there exactly once.
    """
    name, text, other = change
    file = task.with_name(name)
    found = file.read_text(encoding="utf-8")
    if found.count(text) != 1:
        raise ValueError(f"{text!r} is in {name} {found.count(text)} times, not once")
    file.write_text(found.replace(text, other), encoding="utf-8")


def _measure(_options: Options) -> Iterator[Figure]:
    with TemporaryDirectory() as name:
        folder = Path(name)
        task = Path(shutil.copytree(TASK.parent, folder / "task")) / TASK.name
        yield Figure(name="compile.pair_ms", value=1e3 * _pair_s(), unit="ms")
        for jobs, suffix in ((2, ""), (1, "_1_job")):
            cache = folder / f"cache{jobs}"
            cold = compiled(task, folder, jobs=jobs, cache=cache)
            yield Figure(name=f"compile.cold{suffix}_s", value=cold.wall_s, unit="s")
            yield Figure(name=f"compile.cold{suffix}_cpu_s", value=cold.cpu_s, unit="s")
            peak = Figure(
                name=f"compile.peak{suffix}_mib", value=cold.peak_mib, unit="MiB"
            )
            yield peak
            if jobs == 2:
                yield from _again(task, folder, cache, cold)


def _pair_s() -> float:
    """Return the time of a transform of a frame and back: how fast the machine is."""
    frame = np.random.default_rng(1).random((480, 640))
    return best_s(lambda: fft.irfft2(fft.rfft2(frame), s=frame.shape), 50)


def _again(task: Path, folder: Path, cache: Path, cold: Spent) -> Iterator[Figure]:
    """Yield what compiles cost that find a cache."""
    warm = [compiled(task, folder, jobs=2, cache=cache) for _ in range(_REPEATS)]
    numpy_s = min(python_s(["-c", "import numpy"]) for _ in range(_REPEATS))
    yield Figure(
        name="compile.unchanged_s",
        value=min(each.wall_s for each in warm),
        unit="s",
        floor=numpy_s,
    )
    original = task.read_text(encoding="utf-8")
    changed(task, STEP)
    step = compiled(task, folder, jobs=2, cache=cache)
    # its share of the cold compile, by the compiler's clock in both
    ratio = sum(step.steps_s.values()) / cold.steps_s[STEP_ID]
    yield Figure(name="compile.one_step_ratio", value=ratio, unit="1")
    task.write_text(original, encoding="utf-8")
    changed(task, PART)
    part = compiled(task, folder, jobs=2, cache=cache)
    yield Figure(name="compile.one_part_s", value=part.wall_s, unit="s")


BENCHMARK = Benchmark(
    names=(
        "compile.pair_ms",
        "compile.cold_s",
        "compile.cold_cpu_s",
        "compile.peak_mib",
        "compile.unchanged_s",
        "compile.one_step_ratio",
        "compile.one_part_s",
        "compile.cold_1_job_s",
        "compile.cold_1_job_cpu_s",
        "compile.peak_1_job_mib",
    ),
    measure=_measure,
)
