"""Accuracy against cost: the chains that no other beats in both."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.score import ChainScore
from microplan.optics.outline.tolerant_order import above, ordered


def front(
    scores: Sequence[ChainScore], error: Callable[[ChainScore], float]
) -> tuple[ChainScore, ...]:
    """Return the scores that none is both as cheap and as accurate as.

    Parameters
    ----------
    scores : sequence of Score
        Those to compare.
    error : callable
        What is to be small beside the cost, such as the share of a tolerance that the
        chain uses; a score whose error is infinite is left out.

    Returns
    -------
    tuple of Score
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
