"""Scores and a tolerance to the chain that is used, with a reason for every other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from featuresel.candidates import Chain
from featuresel.score import CONFIDENCE, Score


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What a chain must meet apart from the tolerance."""

    success: float = 0.98  # observed; the rest fails aloud and is retried
    silent_upper: float = 0.01  # or no silent failure at all, where trials are few
    better: float = 1.5  # a dearer chain must be this much more accurate ...
    roomy: float = 0.5  # ... and the cheaper one use more than this of the tolerance


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """The chain chosen, one to fall back on, and a sentence for every chain."""

    chosen: Score | None  # None: no chain passes, and `advice` says what to relax
    fallback: Score | None  # with another first routine if there is one
    reasons: tuple[tuple[Chain, str], ...]  # in the order of the scores
    advice: str  # "" if a chain was chosen


def select(
    scores: Sequence[Score],
    *,
    tolerance_um: float,
    tolerance_theta_rad: float | None,
    limits: Limits | None = None,
) -> Selection:
    """Return the cheapest chain that is good enough, and why the others are not it.

    A chain passes if it answers rightly in at least `limits.success` of the trials, has
    no silent failure (or an upper bound below `limits.silent_upper`), gives the angle
    where that is needed, and 2 sigma + |bias| stays within each tolerance. Of those the
    cheapest is taken, the first by name among equals, unless it uses more than
    `limits.roomy` of a tolerance and a dearer one is `limits.better` times more
    accurate.

    Raises
    ------
    ValueError
        If `scores` is empty or a tolerance is not positive.
    """
    if not scores:
        raise ValueError("there must be at least one score")
    if not tolerance_um > 0 or not (tolerance_theta_rad or 1.0) > 0:
        raise ValueError("tolerances must be positive")
    task = _Task(tolerance_um, tolerance_theta_rad, limits or Limits())
    faults = {score.chain: task.fault(score) for score in scores}
    passing = [score for score in scores if not faults[score.chain]]
    chosen = task.best(passing)
    if chosen is None:
        return Selection(
            chosen=None,
            fallback=None,
            reasons=tuple((s.chain, f"rejected: {faults[s.chain]}") for s in scores),
            advice=task.advice(scores),
        )
    others = [s for s in passing if s.chain != chosen.chain]
    apart = [s for s in others if s.chain[0] != chosen.chain[0]]
    fallback = task.best(apart) or task.best(others)
    reasons = []
    for score in scores:
        fault = faults[score.chain]
        if fault:
            reasons.append((score.chain, f"rejected: {fault}"))
        else:
            reasons.append((score.chain, _standing(score, chosen, fallback)))
    return Selection(
        chosen=chosen, fallback=fallback, reasons=tuple(reasons), advice=""
    )


@dataclass(frozen=True, slots=True)
class _Task:
    """Tolerances and limits of one selection."""

    tolerance_um: float
    tolerance_theta_rad: float | None
    limits: Limits

    def fault(self, score: Score) -> str:
        """Return why the chain does not pass, with numbers; "" if it does."""
        return self.unreliable(score) or self.inaccurate(score)

    def unreliable(self, score: Score) -> str:
        """Return what the counts say against the chain."""
        if score.silent and score.silent_upper > self.limits.silent_upper:
            return (
                f"{score.silent} silent failures in {score.trials} trials, "
                f"rate below {score.silent_upper:.2%} at {CONFIDENCE:.0%}, "
                f"limit {self.limits.silent_upper:.2%}"
                + (f"; worst {score.worst_um:.3g} um" if score.worst_um else "")
            )
        rate = score.success / score.trials
        if rate < self.limits.success:
            codes = ", ".join(f"{n} {code}" for code, n in score.failures)
            return (
                f"success {rate:.1%} of {score.trials} trials, "
                f"at least {self.limits.success:.0%}" + (f" ({codes})" if codes else "")
            )
        return ""

    def inaccurate(self, score: Score) -> str:
        """Return what the errors say against the chain."""
        if score.need_um > self.tolerance_um:
            return (
                f"2 sigma + |bias| is {score.need_um:.3g} um, "
                f"tolerance {self.tolerance_um:.3g} um"
            )
        if self.tolerance_theta_rad is None:
            return ""
        if score.angles < score.success or score.sigma_theta_rad is None:
            return "gives no angle, which is needed"
        if score.need_theta_rad > self.tolerance_theta_rad:
            return (
                f"2 sigma + |bias| of the angle is {score.need_theta_rad:.3g} rad, "
                f"tolerance {self.tolerance_theta_rad:.3g} rad"
            )
        return ""

    def use(self, score: Score) -> float:
        """Return the share of the tighter tolerance that the chain uses up."""
        place = score.need_um / self.tolerance_um
        if self.tolerance_theta_rad is None:
            return place
        return max(place, score.need_theta_rad / self.tolerance_theta_rad)

    def best(self, scores: Sequence[Score]) -> Score | None:
        """Return the cheapest that leaves room, by the rule of `select`."""
        chosen: Score | None = None
        for score in sorted(scores, key=lambda s: (s.cost, s.chain)):
            if chosen is None:
                chosen = score
            tight = self.use(chosen) > self.limits.roomy
            if tight and self.use(chosen) > self.limits.better * self.use(score):
                chosen = score
        return chosen

    def advice(self, scores: Sequence[Score]) -> str:
        """Return what to relax: the tolerances that the best reliable chain needs."""
        reliable = [s for s in scores if not self.unreliable(s)]
        able = [s for s in reliable if math.isfinite(self.use(s))]
        if able:
            best = min(able, key=lambda s: (self.use(s), s.cost, s.chain))
            return f"{_name(best.chain)} would pass with {self._needs(best)}"
        if reliable:
            return "no reliable chain gives an angle: break the target's symmetry"
        best = max(scores, key=lambda s: (s.success - s.silent, -s.cost))
        return (
            f"no chain is reliable; the best, {_name(best.chain)}, is right in "
            f"{best.success} of {best.trials} trials: look closer to focus, at another "
            "feature, or start nearer"
        )

    def _needs(self, score: Score) -> str:
        """Return the tolerances the chain needs, in words."""
        parts = []
        if score.need_um > self.tolerance_um:
            parts.append(f"a tolerance of {score.need_um:.3g} um")
        limit = self.tolerance_theta_rad
        if limit is not None and score.need_theta_rad > limit:
            parts.append(f"an angle tolerance of {score.need_theta_rad:.3g} rad")
        return " and ".join(parts)


def _standing(score: Score, chosen: Score, fallback: Score | None) -> str:
    """Return the reason of a chain that passes."""
    numbers = f"2 sigma + |bias| {score.need_um:.3g} um, cost {score.cost:.3g}"
    if score.chain == chosen.chain:
        return f"chosen: {numbers}, success above {score.success_lower:.1%}"
    if fallback is not None and score.chain == fallback.chain:
        return f"fallback: {numbers}"
    if score.cost >= chosen.cost:
        return f"passes ({numbers}), but costs no less than {_name(chosen.chain)}"
    return (
        f"passes ({numbers}), but {_name(chosen.chain)} is "
        f"{score.need_um / max(chosen.need_um, 1e-12):.2g} times more accurate"
    )


def _name(chain: Chain) -> str:
    """Return a chain in words."""
    return " > ".join(chain)
