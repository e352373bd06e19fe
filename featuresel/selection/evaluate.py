"""All routines that may find a look's target, raced against each other."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from microplan.featuresel.features.feature import seen_share
from microplan.featuresel.limits.crlb import limit_um
from microplan.featuresel.look.design import HALF_DESIGN
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Artifact, Failure
from microplan.featuresel.routines.registry import load
from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.race import Race, chains_ahead, race, round_ends
from microplan.featuresel.selection.select import Limits, Selection, select
from microplan.featuresel.trials.chains import Chain, chains, routines
from microplan.featuresel.trials.outcomes import Outcomes
from microplan.featuresel.trials.score import ChainScore
from microplan.featuresel.trials.trial_cache import Known, Looks
from microplan.featuresel.trials.trials import Map, PreparedRoutines, prepare

T = TypeVar("T")

# trials at the end of each; most chains leave early
ROUNDS = (8, 24, HALF_DESIGN, 64, 304, 1024)


@dataclass(frozen=True, slots=True, kw_only=True)
class RoutineComparison:
    """What the race over one look showed, and who won."""

    prepared: PreparedRoutines
    outcomes: Outcomes
    scores: tuple[ChainScore, ...]  # of every chain, by the trials that it had
    selection: Selection
    limit_um: float | None  # Cramer-Rao, the worse axis; None: none, or not asked for
    visible: float | None  # share of the target's edges; None: not known

    def only(self, chains: Collection[Chain]) -> RoutineComparison:
        """Return what it showed of some of its chains; the selection stays."""
        kept = tuple(chain for chain in self.prepared.chains if chain in chains)
        return replace(
            self,
            prepared=replace(self.prepared, chains=kept),
            outcomes=self.outcomes.only(lambda o: o.chain in chains),
            scores=tuple(s for s in self.scores if s.chain in chains),
        )

    def judged(
        self,
        case: LookCase,
        *,
        in_set: bool = False,
        rejected: Mapping[Chain, str] | None = None,
        kept: Chain | None = None,
    ) -> RoutineComparison:
        """Return it with the choice by other tolerances, on the trials that it has."""
        task = replace(
            _task(case, Limits(), self.visible),
            in_set=in_set,
            rejected=rejected or {},
            kept=kept,
        )
        return replace(self, selection=select(self.scores, task))

    def remind(self, known: Known) -> None:
        """Tell what is known of the look what this has of it."""
        known.artifacts.update(self.prepared.artifacts)
        for outcome in self.outcomes:
            if (outcome.chain, outcome.trial) not in known.outcomes:
                known.outcomes.add(outcome)
        known.facts.setdefault("visible", self.visible)


@dataclass(frozen=True, slots=True, kw_only=True)
class RejectedChains:
    """Chains that are not to be chosen, whatever their trials say."""

    before: RoutineComparison  # that chose among them; they keep their scores of it
    reasons: Mapping[Chain, str]  # why each is not


def compare_routines(
    case: LookCase,
    *,
    root_seed: int,
    most: int,
    limits: Limits | None = None,
    thorough: bool = False,
    to_the_end: bool = False,
    limited: bool = True,
    in_set: bool = False,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
    looks: Looks | None = None,
    rejected: RejectedChains | None = None,
) -> RoutineComparison:
    """Return the chain to measure a look with, and what was tried to find it.

    A target that is hidden, or whose angle is not observable, gets the trials of one
    round only: no chain can pass. Routines that are expensive to prepare take part
    where the others leave no room: where none passes, or the chosen one uses more than
    `Limits.margin_share` of a tolerance. Below that a more expensive one is never
    chosen. They race by themselves on the same trials; the bounds count the rounds of
    both races. For one of several features they take part if `thorough`: all of these
    would have to be prepared for each.

    Parameters
    ----------
    case : LookCase
        The look.
    root_seed : int
        Root of all seeds.
    most : int
        Trials of a chain that stays in the race to its end.
    limits : Limits, optional
        What a chain must meet, as in `microplan.featuresel.selection.select.select`.
    thorough : bool
        Whether expensive routines take part in any case, and `to_the_end`.
    to_the_end : bool
        Whether each chain that is not out has all trials; else one waits behind a
        cheaper one that leaves room.
    limited : bool
        Whether the Cramer-Rao limit is computed: it takes two dozen images.
    in_set : bool
        As in `microplan.featuresel.selection.select.select`.
    map : callable
        As in `microplan.featuresel.trials.trials.run`.
    looks : Looks, optional
        What is known from a contest over the same look that had to meet something else;
        takes what is found.
    rejected : RejectedChains, optional
        Chains that take no part any more: the others race again without them, with
        their own trials and as many more as the choice hangs on now.
    """
    bounds = limits or Limits()
    known = (looks or Looks()).of(case, root_seed)
    if rejected is not None:
        rejected.before.remind(known)
    visible = known.fact("visible", lambda: _mapped(map, visible_share, case))
    hopeless = not is_fit(case, visible, bounds)
    once = thorough or hopeless or in_set
    judge = _Judge(
        case=case,
        root_seed=root_seed,
        most=min(most, ROUNDS[0]) if hopeless else most,
        task=replace(
            _task(case, bounds, visible),
            in_set=in_set,
            rejected={} if rejected is None else rejected.reasons,
        ),
        map=map,
        races=1 if once else 2,
        to_the_end=thorough or to_the_end,
        limit_um=known.fact("limit_um", lambda: _mapped(map, limit_um, case))
        if limited and not hopeless
        else None,
        known=known,
    )
    out = None if rejected is None else rejected.before.only(rejected.reasons)
    found = judge.contest(judge.ready(expensive=thorough and not hopeless), out)
    if once or has_margin(case, found.selection, bounds):
        return found
    return judge.with_expensive(found)


def _mapped(map: Map, function: Callable[[LookCase], T], case: LookCase) -> T:  # noqa: A002
    """Return what a function gives for a look, by whom the map asks for it."""
    (found,) = map(function, (case,))
    return found


def visible_share(case: LookCase) -> float | None:
    """Return the share of the target's edges that a look shows, None if not known."""
    render = nominal_render(case)
    contrast = float(np.ptp(render.alone()))
    return seen_share(case.target, render.occluders(), contrast=contrast)


def has_margin(case: LookCase, found: Selection, limits: Limits | None = None) -> bool:
    """Return whether the chosen chain leaves room in every tolerance."""
    if found.chosen is None:
        return False
    return _task(case, limits or Limits()).has_margin(found.chosen)


def is_fit(case: LookCase, visible: float | None, limits: Limits | None = None) -> bool:
    """Return whether a chain can pass at all: the target is seen, its angle told."""
    return not _task(case, limits or Limits(), visible).unfit()


def _task(case: LookCase, limits: Limits, visible: float | None = None) -> Constraints:
    """Return what a chain has to meet on a look."""
    return Constraints(
        tolerance_um=case.tolerance_um,
        tolerance_theta_rad=case.tolerance_theta_rad,
        limits=limits,
        target=case.target,
        visible=visible,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Judge:
    """One look's races and the choice among their scores."""

    case: LookCase
    root_seed: int
    most: int
    task: Constraints
    map: Map
    races: int  # at most
    to_the_end: bool  # all chains have all trials, whatever the choice hangs on
    limit_um: float | None
    known: Known

    def ready(self, *, expensive: bool = True) -> PreparedRoutines:
        """Return routines prepared once, and the chains worth trying."""
        make = partial(make_ready, expensive=expensive, known=self.known.artifacts)
        is_known = self.known.artifacts.keys() >= set(
            _names(self.case, expensive=expensive)
        )
        found = make(self.case) if is_known else _mapped(self.map, make, self.case)
        self.known.artifacts.update(found.artifacts)
        return found

    def with_expensive(self, found: RoutineComparison) -> RoutineComparison:
        """Return a contest after the race of those that were too expensive for it."""
        ready = self.ready()
        is_new = not set(ready.chains) <= set(found.prepared.chains)
        return self.contest(ready, found) if is_new else found

    def contest(
        self, ready: PreparedRoutines, before: RoutineComparison | None = None
    ) -> RoutineComparison:
        """Return the choice among chains that are new and those of before."""
        if before is not None:
            known = before.prepared.chains
            fresh = tuple(chain for chain in ready.chains if chain not in known)
            ready = replace(ready, chains=fresh)
        raced = self.race(ready, before)
        outcomes, chains_, artifacts = raced.outcomes, ready.chains, ready.artifacts
        scores = tuple(replace(s, limit_um=self.limit_um) for s in raced.scores)
        if before is not None:
            outcomes = before.outcomes + outcomes
            chains_ = before.prepared.chains + chains_
            artifacts = {**before.prepared.artifacts, **artifacts}
            scores = before.scores + scores
        return RoutineComparison(
            prepared=PreparedRoutines(chains=chains_, artifacts=artifacts),
            outcomes=outcomes,
            scores=scores,
            selection=select(scores, self.task),
            limit_um=self.limit_um,
            visible=self.task.visible,
        )

    def race(self, ready: PreparedRoutines, before: RoutineComparison | None) -> Race:
        """Return the outcomes of chains, as far as any of them may be chosen."""
        return race(
            self.case,
            ready,
            root_seed=self.root_seed,
            most=self.most,
            limits=self.task.limits,
            rounds=ROUNDS,
            interim_tests=self.races * len(round_ends(ROUNDS, self.most)),
            in_set=self.task.in_set,
            ahead=None if self.to_the_end else partial(self.ahead, before),
            map=self.map,
            known=self.known,
        )

    def ahead(
        self, before: RoutineComparison | None, scores: Sequence[ChainScore]
    ) -> frozenset[Chain]:
        """Return the chains that the choice hangs on, an earlier contest's included."""
        whole = [*(before.scores if before else ()), *scores]
        return chains_ahead(whole, select(whole, self.task), self.task)


def make_ready(
    case: LookCase,
    *,
    expensive: bool = True,
    known: Mapping[str, Artifact | Failure] | None = None,
) -> PreparedRoutines:
    """Return every routine prepared once, and the chains worth trying by their cost.

    Parameters
    ----------
    case : LookCase
        The look.
    expensive : bool
        Whether routines that are expensive to prepare are among them.
    known : mapping of str to Artifact or Failure, optional
        Routines that are prepared already.
    """
    names = _names(case, expensive=expensive)
    ready = {name: found for name, found in (known or {}).items() if name in names}
    fresh = prepare(case, [(name,) for name in names if name not in ready])
    ready |= fresh.artifacts
    found = chains(case.target, costs=_costs(case, names, ready))
    if not found:  # nothing could be prepared: the trials say of each why
        found = chains(case.target, costs=dict.fromkeys(names, 1.0))
    return PreparedRoutines(chains=found, artifacts=ready)


def _names(case: LookCase, *, expensive: bool) -> list[str]:
    """Return the routines that may find a target."""
    return [
        name for name in routines(case.target) if expensive or not load(name).expensive
    ]


def _costs(
    case: LookCase, names: Sequence[str], ready: Mapping[str, Artifact | Failure]
) -> dict[str, float]:
    """Return what each routine costs that could be prepared."""
    pixels = case.window.rows * case.window.columns
    return {
        name: load(name).cost(artifact, pixels)
        for name in names
        if not isinstance(artifact := ready[name], Failure)
    }
