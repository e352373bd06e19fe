"""Do scores keep what they promise? Random problems, tried again with fresh trials.

Of every problem the chain that is chosen, or where none is, the most successful one, is
scored on some trials and then tried on others, of another root seed. A bound is broken
where the value of the fresh trials lies beyond it; that of a rate or spread from 256
fresh trials is itself uncertain, and this is charged to the bound. Races are compared
with trials of all chains to the end: what they save, and how often they choose another.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import binom

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.selection.problems import draw
from microplan.arrays import FloatArray
from microplan.featuresel.look.design import design
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.race import race
from microplan.featuresel.selection.select import select
from microplan.featuresel.trials.bounds import CONFIDENCE
from microplan.featuresel.trials.calibration import SigmaCalibration
from microplan.featuresel.trials.gates import Gate, choose_gate
from microplan.featuresel.trials.outcomes import Outcome, Outcomes
from microplan.featuresel.trials.score import ChainScore, score
from microplan.featuresel.trials.trials import PreparedRoutines, is_wrong, prepare, run

PROBLEMS = 200
TRIALS = 64  # what the preset `balanced` spends
FRESH = 256
RACES = 16  # of the problems, with and without dropping chains
LONG = 256  # trials of those
GATED = "gated"  # the failure of an answer that a gate refuses
SILENT = 0.05  # the limit that gates are chosen for: 64 trials show no less
PROMISES = ("success", "silent", "sigma", "need", "theta", "gate")
AXES = ("x", "y", "theta")
_ROOT, _FRESH_ROOT = 1, 2
# Errors of a trial in units of the spread that was promised, and of half an interval.
Claims = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What came of one problem."""

    decided: bool  # a chain was chosen
    broken: tuple[str, ...]  # promises that fresh trials did not keep
    claims: tuple[Claims, ...]  # along `AXES`
    need: float | None  # promised at most / fresh


def judge(index: int) -> Judged:
    """Return what a problem's score promised and what fresh trials showed."""
    problem = draw(index)
    case, ready = problem.case, prepare(problem.case, problem.chains)
    outcomes = run(case, ready, design(case, TRIALS, _ROOT))
    scores = score(case, ready, outcomes)
    chosen = select(
        scores,
        Constraints(
            tolerance_um=case.tolerance_um, tolerance_theta_rad=case.tolerance_theta_rad
        ),
    ).chosen
    judged = chosen or max(scores, key=lambda s: s.success)
    alone = replace(ready, chains=(judged.chain,))
    fresh = run(case, alone, design(case, FRESH, _FRESH_ROOT))
    (truth,) = score(case, alone, fresh)
    mine = outcomes.by(judged.chain)
    # corners are in no statistic of errors
    drawn = [o for o in fresh if o.failure is None and not o.corner]
    right = [o for o in drawn if not is_wrong(case, o)]
    return Judged(
        decided=chosen is not None,
        broken=(*_broken(judged, truth), *_gate_broken(case, alone, mine, fresh)),
        claims=_claims(judged, right),
        need=judged.need_upper_um / truth.need_um if truth.sigma_um else None,
    )


def _broken(said: ChainScore, truth: ChainScore) -> Iterator[str]:
    """Yield the promises of a score that fresh trials do not keep."""
    if truth.success / truth.trials < said.success_lower:
        yield "success"
    if truth.silent / truth.trials > said.silent_upper:
        yield "silent"
    pairs = [(said.x, truth.x), (said.y, truth.y)]
    known = [(a, b) for a, b in pairs if a is not None and b is not None]
    if any(b.sigma > a.sigma_upper for a, b in known):
        yield "sigma"
    if known and truth.need_um > said.need_upper_um:
        yield "need"
    if said.theta is not None and truth.theta is not None:
        turn = said.theta
        if truth.theta.sigma > turn.sigma_upper or truth.theta.need > turn.need_upper:
            yield "theta"


def gated(outcome: Outcome, gate: Gate) -> Outcome:
    """Return the outcome, an answer that the gate refuses turned into a failure."""
    if outcome.score is None or outcome.spread_um is None:
        return outcome
    if gate.passes(outcome.score, outcome.spread_um):
        return outcome
    return Outcome(
        chain=outcome.chain, trial=outcome.trial, failure=GATED, corner=outcome.corner
    )


def _gate_broken(
    case: LookCase, alone: PreparedRoutines, seen: Outcomes, fresh: Outcomes
) -> Iterator[str]:
    """Yield "gate" if it lets more wrong answers pass than its bound says."""
    gate = choose_gate(case, seen, silent_limit=SILENT)
    if gate is None:
        return
    (after,) = score(case, alone, [gated(o, gate) for o in fresh])
    if after.silent / after.trials > gate.silent_upper:
        yield "gate"


def _claims(said: ChainScore, right: list[Outcome]) -> tuple[Claims, ...]:
    """Return how fresh errors compare with what each answer may now claim."""
    rows = [
        (*o.target_um, o.theta_rad, o.spread_um, o.spread_theta_rad or 1.0)
        for o in right
        if o.target_um is not None
    ]
    values = np.array(rows, dtype=np.float64).reshape(-1, 5)  # no angle: nan
    calibrations = (said.spread_x, said.spread_y, said.spread_theta)
    return tuple(
        _claim(calibration, values[:, axis], values[:, 3 if axis < 2 else 4])
        for axis, calibration in enumerate(calibrations)
    )


def _claim(
    calibration: SigmaCalibration | None, errors: FloatArray, spreads: FloatArray
) -> Claims:
    known = np.isfinite(errors)
    if calibration is None or not known.any():
        return (np.zeros(0), np.zeros(0))
    off = np.abs(errors[known] - calibration.bias)
    return (
        off / calibration.factor / spreads[known],
        off / calibration.reach / spreads[known],
    )


def judge_race(index: int) -> tuple[float, bool]:
    """Return a race's share of the measurements, and whether it chose otherwise."""
    problem = draw(index)
    case, ready = problem.case, prepare(problem.case, problem.chains)
    raced = race(case, ready, root_seed=_ROOT, most=LONG)
    whole = run(case, ready, design(case, LONG, _ROOT))
    peeked = score(case, ready, whole, interim_tests=raced.interim_tests)
    choices = [
        select(
            scores,
            Constraints(
                tolerance_um=case.tolerance_um,
                tolerance_theta_rad=case.tolerance_theta_rad,
            ),
        ).chosen
        for scores in (raced.scores, peeked)
    ]
    first, second = (None if choice is None else choice.chain for choice in choices)
    return len(raced.outcomes) / len(whole), first != second


def _measure(options: Options) -> Iterator[Figure]:
    """Yield how often promises are broken, and how tight they are."""
    with ProcessPoolExecutor(options.jobs) as pool:
        found = list(pool.map(judge, range(PROBLEMS), chunksize=4))
        raced = list(pool.map(judge_race, range(RACES)))
    chance = float(binom.ppf(0.99, PROBLEMS, 1 - CONFIDENCE))
    counts = {name: sum(name in f.broken for f in found) for name in PROMISES}
    excess = sum(max(0.0, count - chance) for count in counts.values())
    yield Figure(name="selection.coverage_excess", value=excess, unit="1")
    for name, count in counts.items():
        yield Figure(name=f"selection.broken_{name}", value=count, unit="1")
    for axis, name in enumerate(AXES):
        squares = np.concatenate([f.claims[axis][0] for f in found]) ** 2
        inside = np.concatenate([f.claims[axis][1] for f in found]) <= 1
        yield Figure(name=f"selection.nees_{name}", value=squares.mean(), unit="1")
        yield Figure(name=f"selection.covered_{name}", value=inside.mean(), unit="1")
    needs = [f.need for f in found if f.need is not None]
    decided = float(np.mean([f.decided for f in found]))
    yield Figure(
        name="selection.need_overestimate", value=float(np.median(needs)), unit="1"
    )
    yield Figure(name="selection.decided", value=decided, unit="1")
    share = float(np.mean([part for part, _ in raced]))
    yield Figure(name="selection.race_share", value=share, unit="1")
    changed = sum(other for _, other in raced)
    yield Figure(name="selection.race_changed", value=changed, unit="1")


BENCHMARK = Benchmark(
    names=(
        "selection.coverage_excess",
        *(f"selection.broken_{name}" for name in PROMISES),
        *(
            f"selection.{figure}_{name}"
            for name in AXES
            for figure in ("nees", "covered")
        ),
        "selection.need_overestimate",
        "selection.decided",
        "selection.race_share",
        "selection.race_changed",
    ),
    measure=_measure,
)
