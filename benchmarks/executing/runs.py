"""Many runs of the compiled example on the simulated cell, judged by its truth."""

from __future__ import annotations

import contextlib
import io
import json
import multiprocessing
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.example import compile_s, given
from benchmarks.executing.final_errors import (
    predicted_um,
    quantile_bounds,
    share_bounds,
)
from benchmarks.figures import Benchmark, Figure, Options
from microplan.executor.cli.main import main as run_main
from microplan.executor.simulated.cameras.kinds import CameraKind

SHARE = 0.95
# Tamadazte, Arnould, Dembele, Lefort-Piat & Marchand (AIM 2009): 41 s an assembly and a
# control accuracy of .3 um, parts of 400 um with 3 um of play.
RIVAL_S, RIVAL_UM = 41.0, 0.3
NAMES = (
    "executor.success",
    "executor.success_lower",
    "executor.success_upper",
    "executor.success_predicted",
    "executor.success_p_value",
    "executor.false_done",
    "executor.failed_aloud",
    "executor.final_error_half_um",
    "executor.final_error_p95_um",
    "executor.final_error_p95_lower_um",
    "executor.final_error_p95_upper_um",
    "executor.final_error_p95_predicted_um",
    "executor.time_s",
    "executor.cycles",
    "executor.cycles_predicted",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How one run ended."""

    seed: int
    done: bool  # the executor says so
    seated: bool  # the cell's true pose and height say so
    put_down: bool  # the jaws let go of the part where the plan says
    offset_um: float  # of the part, truly, wherever the run ended
    time_s: float  # by the station's clock
    cycles: int  # looks of all alignments


def perform(
    plan: Path, folder: Path, seed: int, camera: CameraKind = "quick"
) -> Outcome:
    """Run a plan once on the simulated cell.

    What images have wrong in the compiler and in the `quick` camera alike shows in runs
    of the `solid` one only.

    Raises
    ------
    RuntimeError
        If the executor found a bug, refused the input, or the cell has no verdict.
    """
    run_dir = folder / f"seed-{seed}"
    words = ["--station", "sim", "--camera", camera, "--seed", str(seed), "--no-frames"]
    heard = io.StringIO()
    with contextlib.redirect_stdout(heard), contextlib.redirect_stderr(heard):
        status = run_main([str(plan), *words, "--run-dir", str(run_dir)])
    if status not in (0, 1, 3):
        raise RuntimeError(f"seed {seed} ended with {status}:\n{heard.getvalue()}")
    summary = json.loads((run_dir / "summary.json").read_text(encoding="utf-8"))
    verdict = summary["cell_verdict"]
    if verdict is None or summary["done"] != (status == 0):
        raise RuntimeError(f"seed {seed}: status {status} and summary disagree")
    steps = summary["steps"]
    released = [s for s in steps if s["verb"] == "release" and s["code"] is None]
    return Outcome(
        seed=seed,
        done=summary["done"],
        seated=verdict["success"],
        put_down=bool(released),
        offset_um=verdict["offset_um"],
        time_s=summary["time_s"],
        cycles=sum(step["cycles"] or 0 for step in steps),
    )


def perform_all(
    plan: Path,
    folder: Path,
    seeds: Sequence[int],
    jobs: int,
    camera: CameraKind = "quick",
) -> list[Outcome]:
    """Run a plan with every seed, `jobs` processes at a time."""
    work = partial(perform, plan, folder, camera=camera)
    if jobs == 1:
        return [work(seed) for seed in seeds]
    # spawned, as a process forked from one with threads may hang
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        return pool.map(work, seeds, chunksize=4)


def _measure(options: Options) -> Iterator[Figure]:
    with TemporaryDirectory() as name:
        folder = Path(name)
        path = given(options, "gear-on-shaft")
        if path is None:
            compile_s(folder / "example.plan", options.jobs)
            path = folder / "example.plan" / "plan.json"
        plan = json.loads(path.read_text(encoding="utf-8"))
        outcomes = perform_all(
            path, folder, options.seeds, options.jobs, options.camera
        )
    yield from figures(outcomes, plan)


def figures(outcomes: Sequence[Outcome], plan: dict[str, Any]) -> Iterator[Figure]:
    """Compare success, final errors, looks and time with the plan's predictions.

    The p-value is that of the exact two-sided binomial test; below .01 the plan's
    success probability is refuted. Final errors are of all parts that were let go;
    those that never came so far are among the `failed_aloud`. Bounds are two-sided,
    95 %. The rival of time and error is `RIVAL_S`, `RIVAL_UM`: another machine and
    another task, of the same play.
    """
    yield from _success(outcomes, plan["success_probability"])
    errors_um = [o.offset_um for o in outcomes if o.put_down]
    low_um, high_um = quantile_bounds(errors_um, SHARE)
    yield _one("final_error_half_um", float(np.quantile(errors_um, 0.5)), "um")
    found_um = float(np.quantile(errors_um, SHARE))
    yield _one("final_error_p95_um", found_um, "um", rival=RIVAL_UM)
    yield _one("final_error_p95_lower_um", low_um, "um")
    yield _one("final_error_p95_upper_um", high_um, "um")
    yield _one("final_error_p95_predicted_um", predicted_um(plan, SHARE), "um")
    done = [o for o in outcomes if o.done]
    time_s = float(np.mean([o.time_s for o in done]))
    yield _one("time_s", time_s, "s", rival=RIVAL_S)
    yield _one("cycles", float(np.mean([o.cycles for o in done])))
    controls = (step["control"] for step in plan["steps"])
    looks = sum(c["expected_cycles"] for c in controls if c is not None)
    yield _one("cycles_predicted", looks)


def _success(outcomes: Sequence[Outcome], predicted: float) -> Iterator[Figure]:
    """Yield how often the part truly sits, and whether the executor knew."""
    count, seated = len(outcomes), sum(outcome.seated for outcome in outcomes)
    low, high = share_bounds(seated, count)
    yield _one("success", seated / count)
    yield _one("success_lower", low)
    yield _one("success_upper", high)
    yield _one("success_predicted", predicted)
    p_value = float(binomtest(seated, count, predicted).pvalue)
    yield _one("success_p_value", p_value)
    false = sum(outcome.done and not outcome.seated for outcome in outcomes)
    yield _one("false_done", false, "runs")
    yield _one("failed_aloud", sum(not outcome.done for outcome in outcomes), "runs")


def _one(
    name: str, value: float, unit: str = "1", rival: float | None = None
) -> Figure:
    return Figure(name=f"executor.{name}", value=value, unit=unit, rival=rival)


BENCHMARK = Benchmark(names=NAMES, measure=_measure)
