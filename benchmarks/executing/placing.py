"""Many placements of the laser die on the simulated cell, beside the plan's law."""

from __future__ import annotations

import json
import math
import multiprocessing
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.example import ROOT, compile_s, given
from benchmarks.executing.final_errors import quantile_bounds, share_bounds
from benchmarks.executing.runs import perform
from benchmarks.figures import Benchmark, Figure, Options
from microplan.executor.simulated.cameras.kinds import CameraKind

TASK = ROOT / "examples" / "laser_die" / "task.yaml"
MOST = 0.95  # the share of `placing.most_um`
NAMES = (
    "placing.compile_s",
    "placing.within",
    "placing.within_lower",
    "placing.within_upper",
    "placing.within_predicted",
    "placing.within_p_value",
    "placing.half_um",
    "placing.most_um",
    "executor.second_p95_um",
    "executor.second_p95_lower_um",
    "executor.second_p95_upper_um",
    "placing.turn_mrad",
    "placing.refused",
    "placing.false_done",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """Where one run truly left the die."""

    done: bool  # the executor says that it lies where it should
    within: bool  # it truly does, place and angle
    offset_um: float
    turn_rad: float


def place(plan: Path, folder: Path, seed: int, camera: CameraKind) -> Placed:
    """Run the plan once; return where the die truly lies against its mark.

    Raises
    ------
    RuntimeError
        As `benchmarks.executing.runs.perform`.
    """
    outcome = perform(plan, folder, seed, camera)
    summary = folder / f"seed-{seed}" / "summary.json"
    verdict = json.loads(summary.read_text(encoding="utf-8"))["cell_verdict"]
    return Placed(
        done=outcome.done,
        within=outcome.seated,
        offset_um=verdict["offset_um"],
        turn_rad=verdict["turn_rad"],
    )


def place_all(
    plan: Path, folder: Path, seeds: Sequence[int], jobs: int, camera: CameraKind
) -> list[Placed]:
    """Run the plan with every seed, `jobs` processes at a time."""
    work = partial(place, plan, folder, camera=camera)
    if jobs == 1:
        return [work(seed) for seed in seeds]
    # spawned, as a process forked from one with threads may hang
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        return pool.map(work, seeds, chunksize=4)


def figures(placed: Sequence[Placed], plan: dict[str, Any]) -> Iterator[Figure]:
    """Compare where the die truly lies with what the release's budget says.

    Quantiles and spread have the plan's beside them as `rival`. The p-value is that of
    the exact two-sided binomial test; the bounds are Clopper and Pearson's.
    """
    release = next(s for s in plan["steps"] if s.get("placing"))
    law, count = release["placing"], len(placed)
    inside = sum(one.within for one in placed)
    chance = release["budget"]["success_probability"]
    low, high = share_bounds(inside, count)
    p_value = float(binomtest(inside, count, chance).pvalue)
    yield _one("within", inside / count)
    yield _one("within_lower", low)
    yield _one("within_upper", high)
    yield _one("within_predicted", chance)
    yield _one("within_p_value", p_value)
    offsets = [one.offset_um for one in placed]
    for name, share in (("half_um", 0.5), ("most_um", MOST)):
        found = float(np.quantile(offsets, share))
        yield _one(name, found, "um", rival=law[name])
    # the last once more, by the name that all final errors have, with its bounds
    bounds = zip(("lower", "upper"), quantile_bounds(offsets, MOST), strict=True)
    yield Figure(name="executor.second_p95_um", value=found, unit="um")
    for end, bound in bounds:
        yield Figure(name=f"executor.second_p95_{end}_um", value=bound, unit="um")
    turn = math.sqrt(sum(one.turn_rad**2 for one in placed) / count)
    yield _one("turn_mrad", 1e3 * turn, "mrad", rival=1e3 * law["turn_sigma_rad"])
    yield _one("refused", sum(one.within and not one.done for one in placed), "runs")
    yield _one("false_done", sum(one.done and not one.within for one in placed), "runs")


def _one(
    name: str, value: float, unit: str = "1", rival: float | None = None
) -> Figure:
    return Figure(name=f"placing.{name}", value=value, unit=unit, rival=rival)


def _measure(options: Options) -> Iterator[Figure]:
    with TemporaryDirectory() as name:
        folder = Path(name)
        plan, taken = given(options, "laser-die"), 0.0
        if plan is None:
            plan = folder / "die.plan" / "plan.json"
            taken = compile_s(plan.parent, options.jobs, task=TASK, preset="fast")
        yield _one("compile_s", taken, "s")
        placed = place_all(plan, folder, options.seeds, options.jobs, options.camera)
        yield from figures(placed, json.loads(plan.read_text(encoding="utf-8")))


BENCHMARK = Benchmark(names=NAMES, measure=_measure)
