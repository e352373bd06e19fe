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

from scipy.stats import binomtest

from benchmarks.example import compile_s
from benchmarks.figures import Benchmark, Figure, Options
from executor.cli import main as run_main

NAMES = (
    "executor.success",
    "executor.success_predicted",
    "executor.success_p_value",
    "executor.false_done",
    "executor.failed_aloud",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How one run ended."""

    seed: int
    done: bool  # the executor says so
    seated: bool  # the cell's true pose and height say so


def perform(plan: Path, folder: Path, seed: int) -> Outcome:
    """Run a plan once on the simulated cell.

    Raises
    ------
    RuntimeError
        If the executor found a bug, refused the input, or the cell has no verdict.
    """
    run_dir = folder / f"seed-{seed}"
    words = ["--station", "sim", "--seed", str(seed), "--no-frames"]
    heard = io.StringIO()
    with contextlib.redirect_stdout(heard), contextlib.redirect_stderr(heard):
        status = run_main([str(plan), *words, "--run-dir", str(run_dir)])
    if status not in (0, 1, 3):
        raise RuntimeError(f"seed {seed} ended with {status}:\n{heard.getvalue()}")
    summary = json.loads((run_dir / "summary.json").read_text(encoding="utf-8"))
    verdict = summary["cell_verdict"]
    if verdict is None or summary["done"] != (status == 0):
        raise RuntimeError(f"seed {seed}: status {status} and summary disagree")
    return Outcome(seed=seed, done=summary["done"], seated=verdict["success"])


def perform_all(
    plan: Path, folder: Path, seeds: Sequence[int], jobs: int
) -> list[Outcome]:
    """Run a plan with every seed, `jobs` processes at a time."""
    work = partial(perform, plan, folder)
    if jobs == 1:
        return [work(seed) for seed in seeds]
    # spawned, as a process forked from one with threads may hang
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        return pool.map(work, seeds, chunksize=4)


def _measure(options: Options) -> Iterator[Figure]:
    with TemporaryDirectory() as name:
        folder = Path(name)
        plan = options.plan
        if plan is None:
            compile_s(folder / "example.plan", options.jobs)
            plan = folder / "example.plan" / "plan.json"
        predicted = json.loads(plan.read_text(encoding="utf-8"))["success_probability"]
        outcomes = perform_all(plan, folder, options.seeds, options.jobs)
    yield from figures(outcomes, predicted)


def figures(outcomes: Sequence[Outcome], predicted: float) -> Iterator[Figure]:
    """Compare true success with the plan's prediction.

    The p-value is that of the exact two-sided binomial test; below .01 the plan's
    success probability is refuted.
    """
    seated = sum(outcome.seated for outcome in outcomes)
    test = binomtest(seated, len(outcomes), predicted)
    false = sum(outcome.done and not outcome.seated for outcome in outcomes)
    aloud = sum(not outcome.done for outcome in outcomes)
    values = (seated / len(outcomes), predicted, float(test.pvalue), false, aloud)
    units = ("1", "1", "1", "runs", "runs")
    for name, value, unit in zip(NAMES, values, units, strict=True):
        yield Figure(name=name, value=value, unit=unit)


BENCHMARK = Benchmark(names=NAMES, measure=_measure)
