"""Scores and a tolerance to the chain that is used, with a reason for every other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from microplan.featuresel.selection.constraints import (
    Constraints,
    by_cost,
    front,
    half_period_rad,
)
from microplan.featuresel.selection.constraints import (
    Limits as Limits,  # handed on: they are select's
)
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.score import ChainScore
from microplan.optics.outline.tolerant_order import above, least


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """The chain chosen, one to fall back on, and a sentence for every chain."""

    chosen: ChainScore | None  # None: no chain passes, and `advice` says what to relax
    fallback: ChainScore | None  # as different from `chosen` as any that passes
    reasons: tuple[tuple[Chain, str], ...]  # in the order of the scores
    advice: str  # "" if a chain was chosen
    # reliable chains that none is both cheaper and more accurate than, cheapest first
    pareto: tuple[ChainScore, ...] = ()


def select(scores: Sequence[ChainScore], task: Constraints) -> Selection:
    """Return the cheapest chain that is good enough, and why the others are not it.

    With the limits of `task`, a chain passes if the target is visible and its angle,
    where needed, cannot be mistaken for another of the declared range; if it is not
    `task.rejected`, answers rightly in at least `limits.success` of the trials, has no
    silent failure (or an upper bound below `limits.silent_upper`), gives the angle
    where that is needed, 2 sigma + |bias| stays within each tolerance, and it costs no
    more than `limits.cost`. Of those the cheapest that uses at most
    `limits.margin_share` of each tolerance is taken, the first by name among equals.
    Where none leaves that much, it is the cheapest, unless a more expensive one is
    `task.limits.better` times more accurate. One that is `task.kept` is taken before.
    Numbers within the margin of `microplan.optics.outline.tolerant_order` are equal.
    The fallback is taken alike from the passing chains of the greatest `independence`
    of the chosen one.

    Parameters
    ----------
    scores : sequence of ChainScore
        Of the chains tried on one look, at least one.
    task : Constraints
        What a chain has to meet. Without a target uniqueness is not judged.

    Raises
    ------
    ValueError
        If `scores` is empty.
    """
    if not scores:
        raise ValueError("there must be at least one score")
    faults = {score.chain: task.fault(score) for score in scores}
    passing = [score for score in scores if not faults[score.chain]]
    kept = [score for score in passing if score.chain == task.kept]
    chosen = _best(kept or passing, task)
    fallback = _fallback(passing, chosen, task)
    reliable = [score for score in scores if not task.unreliable(score)]
    return Selection(
        chosen=chosen,
        fallback=fallback,
        reasons=tuple(
            (s.chain, _reason(s, faults[s.chain], chosen, fallback)) for s in scores
        ),
        advice=_advice(scores, task) if chosen is None else "",
        pareto=front(reliable, task.use),
    )


def _best(scores: Sequence[ChainScore], task: Constraints) -> ChainScore | None:
    """Return the cheapest that leaves room, by the rule of `select`."""
    chosen: ChainScore | None = None
    for score in by_cost(scores):
        if task.has_margin(score):
            return score
        if chosen is None or above(
            task.use(chosen), task.limits.better * task.use(score)
        ):
            chosen = score
    return chosen


def independence(score: ChainScore, chosen: ChainScore) -> tuple[bool, bool]:
    """Return whether a chain is of another principle, and begins with another routine.

    The greater, the less the two have in common to fail by.
    """
    return (score.principle != chosen.principle, score.chain[0] != chosen.chain[0])


def _fallback(
    passing: Sequence[ChainScore], chosen: ChainScore | None, task: Constraints
) -> ChainScore | None:
    """Return the best of those that have the least in common with the chosen one."""
    others = [s for s in passing if chosen and s.chain != chosen.chain]
    if chosen is None or not others:
        return None
    most = max(independence(s, chosen) for s in others)
    return _best([s for s in others if independence(s, chosen) == most], task)


def _advice(scores: Sequence[ChainScore], task: Constraints) -> str:
    """Return what to relax: what the best reliable chain needs, or another target."""
    if task.hidden():
        return f"{task.hidden()}: look from elsewhere, or at another feature"
    if task.ambiguous():
        return _unambiguous(task)
    reliable = [s for s in scores if not task.unreliable(s)]
    return _looser(reliable, task) if reliable else _safer(scores)


def _looser(reliable: Sequence[ChainScore], task: Constraints) -> str:
    """Return the limits under which a reliable chain would pass, or what none tells."""
    whole = [s for s in reliable if not task.one_way(s)]
    if not whole:
        return (
            "reliable chains tell the place in one direction only: look at another "
            "feature, or at several together"
        )
    able = [s for s in whole if math.isfinite(task.use(s))]
    if able:
        # a chain that only costs too much wants its limit raised, not the tolerances
        only_slow = [s for s in able if not task.inaccurate(s)]
        quick = [s for s in able if not task.slow(s)]
        nearest = least(by_cost(only_slow or quick or able), task.use)
        return f"{_name(nearest.chain)} would pass with {_needs(nearest, task)}"
    if any(math.isfinite(s.need_um) for s in whole):
        return "no reliable chain gives an angle: break the target's symmetry"
    return "too few trials to tell a spread"


def _safer(scores: Sequence[ChainScore]) -> str:
    """Return how near the most reliable chain comes, where none is."""
    rightest = max(by_cost(scores), key=lambda s: s.success - s.silent)
    return (
        f"no chain is reliable; the best, {_name(rightest.chain)}, is right in "
        f"{rightest.success} of {rightest.trials} trials: look closer to focus, at "
        "another feature, or start nearer"
    )


def _unambiguous(task: Constraints) -> str:
    """Return what would make the angle unique."""
    target = task.target
    if target is None or target.kind == "circle" or target.symmetry == 0:
        return "a round target has no angle: look at another feature"
    return (
        "break the target's symmetry, or start with the angle known to "
        f"{half_period_rad(target):.3g} rad"
    )


def _needs(score: ChainScore, task: Constraints) -> str:
    """Return the limits the chain needs, in words."""
    parts = []
    if above(score.need_um, task.tolerance_um):
        parts.append(f"a tolerance of {score.need_um:.3g} um")
    limit = task.tolerance_theta_rad
    if limit is not None and above(score.need_theta_rad, limit):
        parts.append(f"an angle tolerance of {score.need_theta_rad:.3g} rad")
    if task.slow(score):
        parts.append(f"a cost of {score.cost:.3g}")
    return " and ".join(parts)


def _reason(
    score: ChainScore,
    fault: str,
    chosen: ChainScore | None,
    fallback: ChainScore | None,
) -> str:
    """Return why a chain is taken or not; one without a fault passes."""
    if fault or chosen is None:
        return f"rejected: {fault}"
    numbers = f"2 sigma + |bias| {score.need_um:.3g} um, cost {score.cost:.3g}"
    if score.chain == chosen.chain:
        return f"chosen: {numbers}, success above {score.success_lower:.1%}"
    if fallback is not None and score.chain == fallback.chain:
        return f"fallback: {numbers}"
    if score.cost >= chosen.cost:
        tried = "" if score.trials >= chosen.trials else f" in {score.trials} trials"
        return (
            f"passes{tried} ({numbers}), but costs no less than {_name(chosen.chain)}"
        )
    return (
        f"passes ({numbers}), but {_name(chosen.chain)} is "
        f"{score.need_um / max(chosen.need_um, 1e-12):.2g} times more accurate"
    )


def _name(chain: Chain) -> str:
    """Return a chain in words."""
    return " > ".join(chain)
