"""What the trials so far say of a chain for certain: out of the race, or proved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from microplan.featuresel.look.design import HALF_DESIGN
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.selection.constraints import Limits, by_cost
from microplan.featuresel.selection.select import independence
from microplan.featuresel.trials.bounds import (
    CONFIDENCE,
    Estimate,
    failure_upper,
    success_lower,
)
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.score import ChainScore, score
from microplan.featuresel.trials.trials import PreparedRoutines
from microplan.optics.outline.tolerant_order import above, at_most

_TESTS = 4  # success, silent failures, place, angle: a chain may fall by any of them


@dataclass(frozen=True, slots=True, kw_only=True)
class Elimination:
    """What a chain must meet, and how often it is asked."""

    case: LookCase
    limits: Limits
    interim_tests: int
    in_set: bool  # one direction of the position will do
    # trials of a chain at most, where a race may end without proof; None: it may not
    most: int | None = None

    def scores(
        self, racing: PreparedRoutines, outcomes: Sequence[Outcome]
    ) -> tuple[ChainScore, ...]:
        """Return scores whose bounds hold in every test of every round at once."""
        return score(
            self.case, racing, outcomes, interim_tests=_TESTS * self.interim_tests
        )

    def fallen(self, scores: Sequence[ChainScore]) -> list[tuple[Chain, str]]:
        """Return the chains that are out, with the reason."""
        found = [(s.chain, self.excluded(s)) for s in scores]
        out = {chain for chain, reason in found if reason}
        left = [s for s in scores if s.chain not in out]
        found += [(s.chain, self.dominated(s, left)) for s in left]
        return [(chain, reason) for chain, reason in found if reason]

    def excluded(self, score: ChainScore) -> str:
        """Return which limit the chain misses for certain, "" if none."""
        return self.unreliable(score) or self.misplaced(score) or self.turned(score)

    def unreliable(self, score: ChainScore) -> str:
        """Return what the counts refute, "" if nothing."""
        level = 1 - (1 - CONFIDENCE) / (_TESTS * self.interim_tests)
        most = failure_upper(score.success, score.trials, level)
        if most < self.limits.success:
            return f"success below {most:.1%}, at least {self.limits.success:.0%}"
        least = success_lower(score.silent, score.trials, level)
        if least > self.limits.silent_upper:
            return (
                f"silent failures above {least:.2%}, limit "
                f"{self.limits.silent_upper:.2%}"
            )
        return ""

    def misplaced(self, score: ChainScore) -> str:
        """Return what the position misses for certain, "" if nothing."""
        if self.one_way(score):
            return "tells the place in one direction only, both are needed"
        if above(score.need_lower_um, self.case.tolerance_um):
            return (
                f"2 sigma + |bias| above {score.need_lower_um:.3g} um, tolerance "
                f"{self.case.tolerance_um:.3g} um"
            )
        return ""

    def turned(self, score: ChainScore) -> str:
        """Return what the angle misses for certain, "" if nothing."""
        limit = self.case.tolerance_theta_rad
        if limit is None or not score.success:
            return ""
        if not score.angles:
            return "" if self.in_set else "gives no angle, which is needed"
        if score.theta is not None and above(score.theta.need_lower, limit):
            return (
                f"2 sigma + |bias| of the angle above {score.theta.need_lower:.3g} "
                f"rad, tolerance {limit:.3g} rad"
            )
        return ""

    def dominated(self, score: ChainScore, left: Sequence[ChainScore]) -> str:
        """Return which other chain makes this one superfluous, "" if none."""
        for other in left:
            if (
                other.chain != score.chain
                and independence(other, score) == (False, False)
                and self.meets(other)
                and at_most(other.cost, score.cost)
                and other.success >= score.success
                and other.silent <= score.silent
                and self.surely_finer(other, score)
            ):
                return f"{' > '.join(other.chain)} is no dearer and more accurate"
        return ""

    def meets(self, score: ChainScore) -> bool:
        """Return whether the chain has met all limits so far, the needs for certain."""
        return (
            score.success >= self.limits.success * score.trials
            and (not score.silent or score.silent_upper <= self.limits.silent_upper)
            and at_most(self.use(score), 1)
        )

    def one_way(self, score: ChainScore) -> bool:
        """Return whether a needed direction of the position is not determined."""
        return score.axis_rad is not None and not self.in_set

    def surely_finer(self, one: ChainScore, other: ChainScore) -> bool:
        """Return whether one chain's need is below the other's for certain.

        Needs along different directions do not compare.
        """
        if (one.axis_rad is None) != (other.axis_rad is None):
            return False
        if one.need_upper_um > other.need_lower_um:
            return False
        if self.case.tolerance_theta_rad is None:
            return True
        return one.theta is not None and (
            other.theta is None or one.theta.need_upper <= other.theta.need_lower
        )

    def use(self, score: ChainScore) -> float:
        """Return the largest share of the tighter tolerance that is not refuted."""
        if self.one_way(score):
            return math.inf
        place = score.need_upper_um / self.case.tolerance_um
        limit = self.case.tolerance_theta_rad
        if limit is None:
            return place
        return max(place, _most(score, score.theta) / limit)

    def is_decided(self, left: Sequence[ChainScore]) -> bool:
        """Return whether more trials cannot change the choice, or will hardly do so."""
        if not left:
            return True
        first = by_cost(left)[0]
        if self._has_room(first) and self._is_proved(first):
            return True
        return self._is_clear(left)

    def _has_room(self, score: ChainScore) -> bool:
        """Return whether a chain surely leaves room in every tolerance."""
        return at_most(self.use(score), self.limits.margin_share)

    def _is_proved(self, score: ChainScore) -> bool:
        """Return whether its rates are shown to meet the limits."""
        return (
            score.success_lower >= self.limits.success
            and score.silent_upper <= self.limits.silent_upper
        )

    def _is_clear(self, left: Sequence[ChainScore]) -> bool:
        """Return whether a chain was always right, and one to fall back on as well.

        Where no number of trials that may be made would prove it. What has failed more
        often than all of these allow is not waited for.
        """
        if self.most is None:
            return False
        allowed = (1 - self.limits.success) * self.most
        level = 1 - (1 - CONFIDENCE) / self.interim_tests
        if success_lower(self.most, self.most, level) >= self.limits.success:
            return False
        reliable = [s for s in left if at_most(s.trials - s.success, allowed)]
        if not reliable:
            return False
        first, *others = by_cost(reliable)
        return (
            first.trials >= HALF_DESIGN
            and _is_always_right(first)
            and self._has_room(first)
            and any(self._is_spare(s, first) for s in others)
        )

    def _is_spare(self, score: ChainScore, first: ChainScore) -> bool:
        """Return whether a chain that was always right may stand in for another."""
        return (
            score.principle != first.principle
            and at_most(score.cost, self.limits.cost)
            and _is_always_right(score)
            and self.meets(score)
        )


def _is_always_right(score: ChainScore) -> bool:
    return score.success == score.trials


def _most(score: ChainScore, theta: Estimate | None) -> float:
    """Return the largest need of the angle; inf where it is not always given."""
    if theta is None or score.angles < score.success:
        return math.inf
    return theta.need_upper
