"""Repeatability of chains: fresh random trials at the workcell's own uncertainties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.featuresel.look.design import Trial, random_design
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome, Outcomes
from microplan.featuresel.trials.score import ChainScore, score
from microplan.featuresel.trials.trials import Map, PreparedRoutines, is_wrong, run


@dataclass(frozen=True, slots=True, kw_only=True)
class Trueness:
    """How far the discrepancy of pictures moves answers: part of their sigma."""

    # root mean square, the target's frame; None: no right answer tells it
    um: tuple[float, float] | None = None
    rad: float | None = None  # None: no angle is measured

    @property
    def worse_um(self) -> float:
        """Return that of the worse axis, um, 0 if it is not known."""
        return 0.0 if self.um is None else max(self.um)


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeated:
    """What fresh trials said of some chains."""

    outcomes: Outcomes
    scores: tuple[ChainScore, ...]  # of each chain, in their order
    trueness: tuple[Trueness, ...] = ()  # of each, too; none where it is not told

    def true(self, chain: Chain) -> Trueness:
        """Return the trueness of one chain; ValueError if it was not tried."""
        at = self.scores.index(self.of(chain))
        return self.trueness[at] if self.trueness else Trueness()

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
    stops_um: Sequence[float] = (),
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
) -> Repeated:
    """Return what chains do on fresh random trials, whatever they were chosen by.

    A choice among chains favours those that were lucky in its trials; these are others,
    drawn with `LookCase.promised` alone: no corner is among them. A chain that finds
    nothing looks again from the next stop of the focus, as in a run; gates, which send
    a run there, too, are left out.

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
    stops_um : sequence of float
        Further stops of the focus from the look's own, in turn.
    map : callable
        As in `microplan.featuresel.trials.trials.run`.
    """
    names = sorted({name for chain in chains for name in chain})
    alone = PreparedRoutines(
        chains=tuple(dict.fromkeys(chains)),
        artifacts={name: prepared.artifacts[name] for name in names},
    )
    trials = random_design(case, count, root_seed)
    outcomes = run(case, alone, trials, map=map, tells_moves=True)
    for number in range(1, 1 + len(stops_um)):
        some = stops_um[:number]
        outcomes = _seen_again(case, alone, trials, outcomes, some, map)
    return Repeated(
        outcomes=outcomes,
        scores=score(case, alone, outcomes),
        trueness=tuple(trueness_of(case, outcomes.by(c)) for c in alone.chains),
    )


def trueness_of(case: LookCase, outcomes: Sequence[Outcome]) -> Trueness:
    """Return how far discrepancies moved one chain's right answers.

    Where either answer is wrong it is a failure, not an error.
    """
    known = [o for o in outcomes if o.moved_um is not None]
    right = [o for o in known if not (is_wrong(case, o) or is_wrong(case, _back(o)))]
    if not right:
        return Trueness()
    moved_um = np.array([o.moved_um for o in right])
    x_um, y_um = np.sqrt((moved_um**2).mean(axis=0))
    turns = [o.moved_rad for o in right if o.moved_rad is not None]
    return Trueness(
        um=(float(x_um), float(y_um)),
        rad=float(np.sqrt(np.mean(np.square(turns)))) if turns else None,
    )


def _back(outcome: Outcome) -> Outcome:
    """Return an outcome as it is without the discrepancy, its error in any axes."""
    off, by = np.array(outcome.target_um), np.array(outcome.moved_um)
    x_um, y_um = (off - by).tolist()
    turn = outcome.theta_rad
    if turn is not None and outcome.moved_rad is not None:
        turn -= outcome.moved_rad
    return replace(outcome, world_um=(x_um, y_um), theta_rad=turn)


def from_stops(trial: Trial, stops_um: Sequence[float]) -> tuple[Trial, ...]:
    """Return a trial from the look's own focus, and from each further stop, um off."""
    further = (
        replace(trial, dz_um=trial.dz_um + off_um, seed=(*trial.seed, number))
        for number, off_um in enumerate(stops_um, 1)
    )
    return (trial, *further)


def _seen_again(
    case: LookCase,
    prepared: PreparedRoutines,
    trials: Sequence[Trial],
    outcomes: Outcomes,
    stops_um: Sequence[float],
    map: Map,  # noqa: A002 - as above
) -> Outcomes:
    """Return outcomes with those of the last stop where nothing was found before."""
    found = {(o.chain, o.trial): o for o in outcomes}
    for chain in prepared.chains:
        lost = [o.trial for o in outcomes.by(chain) if o.failure is not None]
        again = [from_stops(trials[index], stops_um)[-1] for index in lost]
        only = replace(prepared, chains=(chain,))
        more = run(case, only, again, map=map, tells_moves=True)
        found |= {(o.chain, o.trial): o for o in more}
    return Outcomes.of(found.values())
