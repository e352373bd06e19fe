"""Races of chains over trials: those that cannot be chosen any more stop."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from microplan.featuresel.look.design import Trial, design
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.selection.constraints import Constraints, Limits, by_cost
from microplan.featuresel.selection.elimination import Elimination
from microplan.featuresel.selection.select import Selection, independence
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome, Outcomes
from microplan.featuresel.trials.score import ChainScore, score
from microplan.featuresel.trials.trial_cache import Known
from microplan.featuresel.trials.trials import Map, PreparedRoutines, run


def chains_ahead(
    scores: Sequence[ChainScore], found: Selection, task: Constraints
) -> frozenset[Chain]:
    """Return the chains whose trials may change the choice or what it falls back on.

    Where the chosen one leaves room, nothing that costs more can take its place; where
    the fallback leaves room, nor can what costs more take that one's, unless it has
    less in common with the chosen one. Where either leaves none, the choice hangs on
    all.

    Parameters
    ----------
    scores : sequence of ChainScore
        Of all chains of one look, by the trials they had so far.
    found : Selection
        What `select` takes by these scores.
    task : Constraints
        What it asked of them.

    Returns
    -------
    frozenset of Chain
        Chosen and fallback, and every chain that could take the place of either.
    """
    chosen, fallback = found.chosen, found.fallback
    order = [score.chain for score in by_cost(scores)]
    if chosen is None or fallback is None:
        return frozenset(order)
    if not (task.has_margin(chosen) and task.has_margin(fallback)):
        return frozenset(order)
    before = order[: order.index(chosen.chain) + 1]
    cheaper = order[: order.index(fallback.chain) + 1]
    apart = independence(fallback, chosen)
    instead = [
        score.chain
        for score in scores
        if independence(score, chosen) > apart
        or (independence(score, chosen) == apart and score.chain in cheaper)
    ]
    return frozenset([*before, *instead])


SHOWN = 24  # trials before a chain waits: what it can do shows in these

Ahead = Callable[[Sequence[ChainScore]], Collection[Chain]]
Run = Callable[[PreparedRoutines, Sequence[Trial]], Sequence[Outcome]]
Scored = Callable[[PreparedRoutines, Sequence[Outcome]], tuple[ChainScore, ...]]


@dataclass(slots=True, kw_only=True)
class Heats:
    """How a race stands: who runs, who fell and why, and on what each was tried."""

    prepared: PreparedRoutines
    trials: Sequence[Trial]
    run: Run
    scored: Scored  # with bounds for dropping chains
    judged: Scored  # as the choice is made by in the end
    ahead: Ahead | None  # the chains that the choice hangs on; None: always all
    outcomes: Outcomes = field(default_factory=Outcomes.of)
    done: dict[Chain, int] = field(default_factory=dict)  # trials of each chain
    dropped: list[tuple[Chain, str]] = field(default_factory=list)

    def round(self, end: int) -> list[ChainScore]:
        """Try the chains that the choice hangs on up to a trial; return their scores.

        Who that is may change with the trials: none is left out that matters by the
        scores of all.
        """
        due = self._due(end)
        while due:
            self._try(due, end)
            due = self._due(end)
        return [score for score in self._scores() if score.trials == end]

    def left(
        self, scores: Sequence[ChainScore], fallen: Sequence[tuple[Chain, str]]
    ) -> list[ChainScore]:
        """Drop who has fallen; return the scores of the others."""
        out = {chain for chain, _ in fallen}
        self.dropped += fallen
        return [score for score in scores if score.chain not in out]

    def _running(self) -> tuple[Chain, ...]:
        """Return the chains that have not fallen."""
        out = {chain for chain, _ in self.dropped}
        return tuple(chain for chain in self.prepared.chains if chain not in out)

    def _scores(self) -> tuple[ChainScore, ...]:
        """Return the scores of all that run, by the trials that each had."""
        return self.scored(
            replace(self.prepared, chains=self._running()), self.outcomes
        )

    def _due(self, end: int) -> list[Chain]:
        """Return the chains that have to be tried now."""
        behind = [chain for chain in self._running() if self._had(chain) < end]
        if self.ahead is None or any(self._had(chain) < SHOWN for chain in behind):
            return behind
        # of all, those that fell too: they may pass, and stand before others
        wanted = self.ahead(self.judged(self.prepared, self.outcomes)) if behind else ()
        return [chain for chain in behind if chain in wanted]

    def _try(self, chains: Sequence[Chain], end: int) -> None:
        """Try chains up to a trial, those together that had as many."""
        for had in sorted({self._had(chain) for chain in chains}):
            group = tuple(chain for chain in chains if self._had(chain) == had)
            racing = replace(self.prepared, chains=group)
            self.outcomes += Outcomes.of(self.run(racing, self.trials[had:end]))
            self.done.update(dict.fromkeys(group, end))

    def _had(self, chain: Chain) -> int:
        return self.done.get(chain, 0)


ROUNDS = (32, 256, 1024)  # trials at the end of each


@dataclass(frozen=True, slots=True, kw_only=True)
class Race:
    """What the rounds showed."""

    outcomes: Outcomes  # round by round, each trial by trial
    scores: tuple[ChainScore, ...]  # of every chain, by the trials that it had
    trials: Mapping[Chain, int]  # how many that were
    dropped: tuple[tuple[Chain, str], ...]  # why a chain was, in the order it happened
    interim_tests: (
        int  # how often outcomes could decide on trials: bounds hold for each
    )


def race(
    case: LookCase,
    prepared: PreparedRoutines,
    *,
    root_seed: int,
    most: int,
    limits: Limits | None = None,
    rounds: Sequence[int] = ROUNDS,
    interim_tests: int | None = None,
    in_set: bool = False,
    ahead: Ahead | None = None,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
    known: Known | None = None,
) -> Race:
    """Return the outcomes of chains that are tried while they may be chosen.

    All chains see the same images (common random numbers), those of
    `microplan.featuresel.look.design.design`. After each round a chain is dropped if

    - the upper bound of its success rate is below the limit,
    - the lower bound of its silent failures is above the limit,
    - the lower bound of what it needs (2 sigma + |bias|) is above a tolerance, or it
      never gave an angle that is needed, or the position in one direction only where
      both are, or
    - another of the same principle that begins with the same routine and itself meets
      the limits is no more expensive, surely more accurate, and was on the same trials
      right no less often and wrong without a failure no more often. One of another
      principle or beginning is kept: it may be the fallback.

    After `microplan.featuresel.selection.race.SHOWN` trials only those chains
    go on that `ahead` tells; the others follow where that changes.

    The race ends when no chain is left, after `most` trials, or when a chain is proved
    good enough with room to spare and none that is cheaper is left. Where `ahead` is
    given and not even `most` trials would prove a rate of success, it is enough that
    such a chain and one of another principle were right in all of at least
    `HALF_DESIGN` trials. What failed too often for `most` trials does not hold it up.

    Parameters
    ----------
    case, prepared
        The look, and its chains and artifacts.
    root_seed : int
        Root of all seeds.
    most : int
        Trials of a chain that stays to the end.
    limits : Limits, optional
        What a chain must meet, as in `microplan.featuresel.selection.select.select`.
    rounds : sequence of int
        Trials at the end of each round, rising; those below `most` count.
    interim_tests : int, optional
        How often outcomes may decide on trials, at least the number of rounds, which is
        the default. Where one race's outcomes decide whether another is run, both want
        the rounds of both: the bounds of whichever chain wins then hold.
    in_set : bool
        As in `microplan.featuresel.selection.select.select`.
    ahead : callable, optional
        Returns the chains that the choice hangs on by the scores so far, as
        `microplan.featuresel.selection.race.chains_ahead` does. Without it that is
        all.
    map, known
        As in `microplan.featuresel.trials.trials.run`.

    Returns
    -------
    Race
        It depends on case, chains, seed, rounds, interim_tests, limits, `ahead` alone.
        Each bound in a score holds at all `interim_tests` at once, at `CONFIDENCE`
        (union bound); a chain that meets all limits is dropped by the first three tests
        with a probability of 1 - `CONFIDENCE` at most.

    Raises
    ------
    ValueError
        If the rounds do not rise, `most` is out of range, or `interim_tests` are fewer
        than the rounds.

    References
    ----------
    Maron & Moore (1997), The racing algorithm, Artificial Intelligence Review 11.
    """
    ends = round_ends(rounds, most)
    interim_tests = _tests(ends, interim_tests)
    verdicts = Elimination(
        case=case,
        limits=limits or Limits(),
        interim_tests=interim_tests,
        in_set=in_set,
        most=None if ahead is None else most,
    )
    heats = Heats(
        prepared=prepared,
        trials=design(case, most, root_seed),
        run=partial(run, case, map=map, known=known or Known()),
        scored=verdicts.scores,
        judged=partial(score, case, interim_tests=interim_tests),
        ahead=ahead,
    )
    for end in ends:
        scores = heats.round(end)
        if verdicts.is_decided(heats.left(scores, verdicts.fallen(scores))):
            break
    found = score(case, prepared, heats.outcomes, interim_tests=interim_tests)
    return Race(
        outcomes=heats.outcomes,
        scores=found,
        trials={s.chain: s.trials for s in found},
        dropped=tuple(heats.dropped),
        interim_tests=interim_tests,
    )


def round_ends(rounds: Sequence[int], most: int) -> tuple[int, ...]:
    """Return the trials at the end of each round within `most`, the last."""
    if any(b <= a for a, b in zip((0, *rounds), rounds, strict=False)):
        raise ValueError(f"rounds must rise from 1, got {tuple(rounds)}")
    return (*(end for end in rounds if end < most), most)


def _tests(ends: Sequence[int], interim_tests: int | None) -> int:
    """Return how often outcomes may decide on trials, at least once a round."""
    if interim_tests is None:
        return len(ends)
    if interim_tests < len(ends):
        raise ValueError(
            f"need a test for each of {len(ends)} rounds, got {interim_tests}"
        )
    return interim_tests
