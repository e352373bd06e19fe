"""What another machine's arithmetic does to scores: the example compiled on two.

The second is this machine as a processor of 2008 would run the same wheels: numpy,
OpenBLAS, OpenCV and libm are told to use no instructions newer than SSE 4.1.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.figures import Benchmark, Figure, Options
from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.evaluate import RoutineComparison
from microplan.planner.plan.compiler import compile_task
from microplan.planner.plan.options import Options as Asked
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.memo import Memo
from microplan.planner.task.read_task import load_task

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "gear_on_shaft" / "task.yaml"
OLD: Mapping[str, str] = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "OPENCV_CPU_DISABLE": "AVX512-SKX,AVX2,FP16,AVX,SSE4.2",
    "OPENCV_IPP": "disabled",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA,-FMA4,-AVX",
}
Row = dict[str, Any]
NAMES = tuple(
    f"machines.{name}"
    for name in (
        "what_differs",
        "change_of_a_cost",
        "change_of_a_need_median",
        "change_of_a_need_p90",
        "change_of_a_need",
        "nearest_to_a_limit",
    )
)


@dataclass(frozen=True, slots=True)
class Recorder(Memo):
    """Makes every call and keeps the contests."""

    def call(self, function: Any, /, *args: Any, **kwargs: Any) -> Any:
        """Return what `function` returns; print what a contest came to."""
        found = function(*args, **kwargs)
        if isinstance(found, RoutineComparison):
            for row in rows(args[0], found):
                print(json.dumps(row))
        return found


def rows(case: Any, found: RoutineComparison) -> Iterator[Row]:
    """Yield what decides on each chain of a contest, numbers in full."""
    task = Constraints(
        tolerance_um=case.tolerance_um,
        tolerance_theta_rad=case.tolerance_theta_rad,
        target=case.target,
        visible=found.visible,
    )
    chosen = found.selection.chosen
    for score in found.scores:
        use = task.use(score)
        yield {
            "look": case.key,
            "chain": " > ".join(score.chain),
            "counts": [score.trials, score.success, score.silent],
            "cost": score.cost,
            "use": use if math.isfinite(use) and not task.unreliable(score) else None,
            "need_um": score.need_um if math.isfinite(score.need_um) else None,
            "chosen": chosen is not None and score.chain == chosen.chain,
        }


def compiled(more: Mapping[str, str]) -> list[Row]:
    """Return the rows of the example, compiled in a process with this environment."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.compiling.machines"],
        cwd=ROOT,
        env={**os.environ, **more},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return [json.loads(line) for line in done.stdout.splitlines()]


def measure(_options: Options) -> Iterator[Figure]:
    """Yield how far scores of two machines differ, and how near choices come."""
    here, there = compiled({}), compiled(OLD)
    pairs = list(zip(here, there, strict=True))
    told = ("look", "chain", "counts", "chosen")
    other = [a for a, b in pairs if any(a[key] != b[key] for key in told)]
    values: list[float] = [len(other)]
    values.append(max(abs(a["cost"] - b["cost"]) for a, b in pairs))
    noise = sorted(
        abs(a["need_um"] - b["need_um"]) / a["need_um"]
        for a, b in pairs
        if a["need_um"] and b["need_um"]
    )
    last = len(noise) - 1
    values += [noise[round(share * last)] for share in (0.5, 0.9, 1.0)]
    values.append(nearest(here))
    for name, value in zip(NAMES, values, strict=True):
        yield Figure(name=name, value=value, unit="1")


def nearest(found: Sequence[Row]) -> float:
    """Return how near any use of a tolerance comes to what is decided by it.

    Relative: to all of the tolerance, to `Limits.margin_share` of it, and to being
    `Limits.better` times that of another chain of its look.
    """
    limits = Constraints(tolerance_um=1.0, tolerance_theta_rad=None).limits
    uses: dict[str, list[float]] = {}
    for row in found:
        if row["use"] is not None:
            uses.setdefault(row["look"], []).append(row["use"])
    return min(
        abs(use / limit - 1)
        for of_look in uses.values()
        for use in of_look
        for limit in (
            1.0,
            limits.margin_share,
            *(limits.better * other for other in of_look),
        )
    )


def main() -> None:
    """Compile the example and print its rows."""
    report = Report()
    task = load_task(EXAMPLE, report)
    if task is None:
        raise SystemExit(f"{EXAMPLE}: {[d.message for d in report.found]}")
    compile_task(task, report, Asked(preset="fast", memo=Recorder()))


BENCHMARK = Benchmark(names=NAMES, measure=measure)

if __name__ == "__main__":
    main()
