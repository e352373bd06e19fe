"""Looks and final error of an alignment by its gain: fixed, full, or falling as 1 / k.

python -m benchmarks.executing.servo_gain prints the table of docs/servo.md. Two stages:
one whose moves scatter about the reading, and one that scatters about where it truly
was. Both are plain recursions; `tests/executor/run/test_servo.py` holds the executor
against them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options

RUNS = 20_000
RATIOS = (0.8, 1.45, 3.0)  # tolerance over the sigma of a move; 1.45 is `over_shaft`
START = 3.0  # sigma of the first approach's error, in sigmas of a move
LOOK = 0.3  # sigma of a look, likewise; `over_shaft` has .29
MOST = 400
_SEED = 5

Gain = Callable[[int], float]  # of the k-th correction, k = 1, 2, ...

GAINS: Mapping[str, Gain] = {
    "0.8": lambda k: 0.8,  # noqa: ARG005 - the same for all
    "1": lambda k: 1.0,  # noqa: ARG005 - the same for all
    "1/k": lambda k: 1 / k,
}
STAGES = ("reading", "place")


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """How alignments with one gain went."""

    looks: float  # on average
    error: float  # true distance at the end, rms, in sigmas of a move
    unended: float  # share that was not inside after `MOST` looks


def course(stage: str, gain: Gain, ratio: float, runs: int = RUNS) -> Course:
    """Return what a gain makes of a stage, of tolerance `ratio` move sigmas."""
    rng = np.random.default_rng([_SEED, STAGES.index(stage), round(100 * ratio)])
    noise = rng.standard_normal((runs, 2))
    error = START * rng.standard_normal((runs, 2)) + noise
    looks, ended = np.zeros(runs), np.zeros(runs, dtype=bool)
    for k in range(1, MOST + 1):
        looks += ~ended
        seen = error + LOOK * rng.standard_normal((runs, 2))
        ended |= np.hypot(*seen.T) <= ratio
        if ended.all():
            break
        fresh = rng.standard_normal((runs, 2))
        carried = fresh - noise if stage == "reading" else fresh
        moved = error - gain(k) * seen + carried
        error = np.where(ended[:, None], error, moved)
        noise = fresh
    return Course(
        looks=float(looks.mean()),
        error=float(np.sqrt(np.mean(error[ended] ** 2) * 2)),
        unended=float(1 - ended.mean()),
    )


def _measure(_options: Options) -> Iterator[Figure]:
    for stage in STAGES:
        for name, gain in GAINS.items():
            found = course(stage, gain, RATIOS[1])
            yield Figure(name=_named(stage, name, "looks"), value=found.looks, unit="1")
            yield Figure(name=_named(stage, name, "error"), value=found.error, unit="1")


def _named(stage: str, gain: str, what: str) -> str:
    """Return a figure's name."""
    word = {"0.8": "fixed", "1": "full", "1/k": "falling"}[gain]
    return f"servo_gain.{stage}.{word}.{what}"


BENCHMARK = Benchmark(
    names=tuple(
        _named(stage, gain, what)
        for stage in STAGES
        for gain in GAINS
        for what in ("looks", "error")
    ),
    measure=_measure,
)


def main() -> int:
    """Print the table."""
    print("| scatter about the | tolerance / sigma | gain | looks | error / sigma |")
    print("|---|---|---|---|---|")
    for stage in STAGES:
        for ratio in RATIOS:
            for name, gain in GAINS.items():
                found = course(stage, gain, ratio)
                cells = (f"{found.looks:.2f}", f"{found.error:.2f}")
                print(f"| {stage} | {ratio} | {name} | {' | '.join(cells)} |")
                if found.unended:
                    print(f"{found.unended:.2%} did not end", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
