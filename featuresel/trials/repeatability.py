"""Repeatability of chains: fresh random trials at the workcell's own uncertainties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from microplan.featuresel.look.design import random_design
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcomes
from microplan.featuresel.trials.score import ChainScore, score
from microplan.featuresel.trials.trials import Map, PreparedRoutines, run


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeated:
    """What fresh trials said of some chains."""

    outcomes: Outcomes
    scores: tuple[ChainScore, ...]  # of each chain, in their order

    def of(self, chain: Chain) -> ChainScore:
        """Return the score of one chain; ValueError if it was not tried."""
        for found in self.scores:
            if found.chain == chain:
                return found
        raise ValueError(f"{chain} was not tried")


def repeatability(
    case: LookCase,
    prepared: PreparedRoutines,
    chains: Sequence[Chain],
    *,
    count: int,
    root_seed: int,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
) -> Repeated:
    """Return what chains do on fresh random trials, whatever they were chosen by.

    A choice among chains favours those that were lucky in its trials; these are others,
    drawn with `LookCase.drawn` alone: no corner is among them.

    Parameters
    ----------
    case : LookCase
        The look.
    prepared : PreparedRoutines
        What the chains' routines prepared.
    chains : sequence of Chain
        Those to try, on the same images.
    count : int
        Trials.
    root_seed : int
        Root of all seeds.
    map : callable
        As in `microplan.featuresel.trials.trials.run`.
    """
    names = sorted({name for chain in chains for name in chain})
    alone = PreparedRoutines(
        chains=tuple(dict.fromkeys(chains)),
        artifacts={name: prepared.artifacts[name] for name in names},
    )
    outcomes = run(case, alone, random_design(case, count, root_seed), map=map)
    return Repeated(outcomes=outcomes, scores=score(case, alone, outcomes))
