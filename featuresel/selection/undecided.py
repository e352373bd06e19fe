"""Which chains a choice still hangs on: those behind a roomy one need no trials."""

from __future__ import annotations

from collections.abc import Sequence

from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.pareto import by_cost
from microplan.featuresel.selection.select import Selection
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.score import ChainScore


def chains_ahead(
    scores: Sequence[ChainScore], found: Selection, task: Constraints
) -> frozenset[Chain]:
    """Return the chains whose trials may change the choice or what it falls back on.

    Where the chosen one leaves room, nothing that costs more can take its place; where
    the fallback begins with another routine and leaves room, nor can what costs more
    take that one's. Where either leaves none, the choice hangs on all.

    Parameters
    ----------
    scores : sequence of Score
        Of all chains of one look, by the trials they had so far.
    found : Selection
        What `select` takes by these scores.
    task : Constraints
        What it asked of them.

    Returns
    -------
    frozenset of Chain
        Chosen and fallback, and every chain that costs no more than the one it could
        take the place of.
    """
    chosen, fallback = found.chosen, found.fallback
    order = [score.chain for score in by_cost(scores)]
    if chosen is None or fallback is None:
        return frozenset(order)
    begun = chosen.chain[0]
    if fallback.chain[0] == begun or not (
        task.has_margin(chosen) and task.has_margin(fallback)
    ):
        return frozenset(order)
    before = order[: order.index(chosen.chain) + 1]
    apart = order[: order.index(fallback.chain) + 1]
    return frozenset([*before, *(chain for chain in apart if chain[0] != begun)])
