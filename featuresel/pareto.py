"""Accuracy against cost: the chains that no other beats in both."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from featuresel.score import Score


def front(
    scores: Sequence[Score], error: Callable[[Score], float]
) -> tuple[Score, ...]:
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
        equal in both the first by name.
    """
    ranked = sorted(scores, key=lambda s: (s.cost, error(s), s.chain))
    kept: list[Score] = []
    least = math.inf
    for score in ranked:
        if error(score) < least:
            kept.append(score)
            least = error(score)
    return tuple(kept)
