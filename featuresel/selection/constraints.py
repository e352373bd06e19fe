"""Constraints on a chain of routines, reasons of failures, the Pareto front."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from microplan.featuresel.routines.contract import Target
from microplan.featuresel.trials.bounds import CONFIDENCE
from microplan.featuresel.trials.chains import Chain, has_angle
from microplan.featuresel.trials.score import ChainScore
from microplan.optics.outline.tolerant_order import above, at_most, ordered


def front(
    scores: Sequence[ChainScore], error: Callable[[ChainScore], float]
) -> tuple[ChainScore, ...]:
    """Return the scores that none is both as cheap and as accurate as.

    Parameters
    ----------
    scores : sequence of ChainScore
        Those to compare.
    error : callable
        What is to be small beside the cost, such as the share of a tolerance that the
        chain uses; a score whose error is infinite is left out.

    Returns
    -------
    tuple of ChainScore
        The cheapest first, each more accurate than those before it. Of scores that are
        equal in both, within the margin of `microplan.optics.outline.tolerant_order`,
        the first by name.
    """
    ranked = ordered(ordered(sorted(scores, key=_name), error), _cost)
    kept: list[ChainScore] = []
    least = math.inf
    for score in ranked:
        if above(least, error(score)):
            kept.append(score)
            least = error(score)
    return tuple(kept)


def by_cost(scores: Sequence[ChainScore]) -> list[ChainScore]:
    """Return scores, the cheapest first; of those that cost the same by name."""
    return ordered(sorted(scores, key=_name), _cost)


def _cost(score: ChainScore) -> float:
    return score.cost


def _name(score: ChainScore) -> Chain:
    return score.chain


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What a chain must meet apart from the tolerance."""

    success: float = 0.98  # observed; the rest fails detectably and is retried
    silent_upper: float = 0.01  # or no silent failure at all, where trials are few
    margin_share: float = 0.5  # of a tolerance: the cheapest chain within it is taken
    better: float = 1.5  # where none is, a more expensive one must be this much finer
    cost: float = math.inf  # of one fix, in 640 x 480 box filters
    # of the target's edges, in view and nothing in front: a quarter of a circle tells
    # its centre 16 times worse along its bisector than all of it, the radius free
    visible: float = 0.25

    def __post_init__(self) -> None:
        if not (self.cost > 0 and 0 <= self.visible <= 1):
            raise ValueError(f"need cost > 0 and visible in 0..1, got {self}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Constraints:
    """Tolerances and limits of one selection; `target` None leaves it unjudged."""

    tolerance_um: float
    tolerance_theta_rad: float | None  # None: the angle is not needed
    limits: Limits = field(default_factory=Limits)
    target: Target | None = None
    visible: float | None = None  # share of the target's edges; None: not known
    in_set: bool = False  # one of several features: one direction will do
    # why chains do not pass whatever their trials say: not judged by scores
    rejected: Mapping[Chain, str] = field(default_factory=dict)
    kept: Chain | None = None  # that is chosen if it passes, whatever costs less

    def __post_init__(self) -> None:
        theta = 1.0 if self.tolerance_theta_rad is None else self.tolerance_theta_rad
        if not (self.tolerance_um > 0 and theta > 0):  # also refuses nan
            raise ValueError("tolerances must be positive")
        if self.visible is not None and not 0 <= self.visible <= 1:
            raise ValueError(f"visible must be in 0..1, got {self.visible}")

    def fault(self, score: ChainScore) -> str:
        """Return why the chain does not pass, with numbers; "" if it does."""
        return (
            self.unfit()
            or self.unreliable(score)
            or self.inaccurate(score)
            or self.slow(score)
        )

    def unfit(self) -> str:
        """Return what is wrong with the target itself, for any chain."""
        return self.hidden() or self.ambiguous()

    def hidden(self) -> str:
        """Return whether too little of the target is seen."""
        if self.visible is None or at_most(self.limits.visible, self.visible):
            return ""
        return (
            f"{self.visible:.0%} of the target's edges are visible, "
            f"at least {self.limits.visible:.0%}"
        )

    def ambiguous(self) -> str:
        """Return whether two angles of the declared range look alike."""
        target = self.target
        if self.tolerance_theta_rad is None or target is None or has_angle(target):
            return ""
        if target.kind == "circle" or target.symmetry == 0:
            return "a round target has no angle, which is needed"
        half_rad = half_period_rad(target)
        return (
            f"not unique: nothing breaks the symmetry, half its period is "
            f"{half_rad:.3g} rad and the angle may be {target.theta_range_rad:.3g} rad "
            "off"
        )

    def unreliable(self, score: ChainScore) -> str:
        """Return what the chain is rejected for, or the counts say against it."""
        if score.chain in self.rejected:
            return self.rejected[score.chain]
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

    def inaccurate(self, score: ChainScore) -> str:
        """Return what the errors say against the chain."""
        if self.one_way(score):
            return "tells the place in one direction only, both are needed"
        if above(score.need_um, self.tolerance_um):
            return (
                f"2 sigma + |bias| is {score.need_um:.3g} um, "
                f"tolerance {self.tolerance_um:.3g} um"
            )
        if self.tolerance_theta_rad is None:
            return ""
        if self.in_set and not score.angles:
            return ""  # others may give it
        if score.angles < score.success or score.sigma_theta_rad is None:
            return "gives no angle, which is needed"
        if above(score.need_theta_rad, self.tolerance_theta_rad):
            return (
                f"2 sigma + |bias| of the angle is {score.need_theta_rad:.3g} rad, "
                f"tolerance {self.tolerance_theta_rad:.3g} rad"
            )
        return ""

    def one_way(self, score: ChainScore) -> bool:
        """Return whether a needed direction of the position is not determined."""
        return score.axis_rad is not None and not self.in_set

    def slow(self, score: ChainScore) -> str:
        """Return whether one fix costs too much."""
        if at_most(score.cost, self.limits.cost):
            return ""
        return f"cost {score.cost:.3g}, at most {self.limits.cost:.3g}"

    def use(self, score: ChainScore) -> float:
        """Return the share of the tighter tolerance that the chain uses up."""
        place = score.need_um / self.tolerance_um
        if self.tolerance_theta_rad is None:
            return place
        return max(place, score.need_theta_rad / self.tolerance_theta_rad)

    def has_margin(self, score: ChainScore) -> bool:
        """Return whether the chain leaves room in every tolerance."""
        return at_most(self.use(score), self.limits.margin_share)


def half_period_rad(target: Target) -> float:
    """Return how far off an angle may be without looking like another; pi if any."""
    order = max(target.symmetry, int(target.parameters.get("count", 1.0)), 1)
    return math.pi / order
