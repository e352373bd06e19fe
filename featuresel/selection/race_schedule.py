"""The trials that chains had in a race; some wait while others go on."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

from microplan.featuresel.look.design import Trial
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome, Outcomes
from microplan.featuresel.trials.score import ChainScore
from microplan.featuresel.trials.trials import PreparedRoutines

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
