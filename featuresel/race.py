"""Trials in rounds: chains that cannot be chosen any more are tried no further."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from featuresel.bounds import CONFIDENCE, Estimate, failure_upper, success_lower
from featuresel.candidates import Chain
from featuresel.case import LookCase
from featuresel.perturb import design
from featuresel.score import Score, score
from featuresel.select import Limits
from featuresel.trials import Curves, Map, Outcome, Prepared, run

ROUNDS = (32, 256, 1024)  # trials at the end of each
_TESTS = 4  # success, silent failures, place, angle: a chain may fall by any of them


@dataclass(frozen=True, slots=True, kw_only=True)
class Race:
    """What the rounds showed."""

    outcomes: tuple[Outcome, ...]  # round by round and trial by trial
    scores: tuple[Score, ...]  # of every chain, by the trials that it had
    trials: Mapping[Chain, int]  # how many that were
    dropped: tuple[tuple[Chain, str], ...]  # why a chain was, in the order it happened
    peeks: int  # how many rounds there could have been: bounds hold after each


def race(
    case: LookCase,
    prepared: Prepared,
    *,
    root_seed: int,
    most: int,
    limits: Limits | None = None,
    rounds: Sequence[int] = ROUNDS,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
    curves: Curves | None = None,
) -> Race:
    """Return the outcomes of chains that are tried while they may be chosen.

    All chains see the same images (common random numbers), those of
    `featuresel.perturb.design`. After each round a chain is dropped if

    - the upper bound of its success rate is below the limit,
    - the lower bound of its silent failures is above the limit,
    - the lower bound of what it needs (2 sigma + |bias|) is above a tolerance, or it
      never gave an angle that is needed, or
    - another that begins with the same routine and itself meets the limits is no
      dearer, surely more accurate, and was on the same trials right no less often and
      silently wrong no more often. One that begins with another routine is kept: it
      may be the fallback.

    The race ends when no chain is left, after `most` trials, or when a chain is proved
    good enough with room to spare and none that is cheaper is left.

    Parameters
    ----------
    case, prepared
        The look, and its chains and artifacts.
    root_seed : int
        Root of all seeds.
    most : int
        Trials of a chain that stays to the end.
    limits : Limits, optional
        What a chain must meet, as in `featuresel.select.select`.
    rounds : sequence of int
        Trials at the end of each round, rising; those below `most` count.
    map, curves
        As in `featuresel.trials.run`.

    Returns
    -------
    Race
        It depends on the case, chains, seed, rounds and limits alone. The bounds in the
        scores hold at the end of each round at once, at `CONFIDENCE` (union bound over
        `peeks`); a chain that meets all limits is dropped by the first three tests with
        a probability of 1 - `CONFIDENCE` at most.

    Raises
    ------
    ValueError
        If the rounds do not rise, or `most` is out of range.

    References
    ----------
    Maron & Moore (1997), The racing algorithm, Artificial Intelligence Review 11.
    """
    ends = _ends(rounds, most)
    task = _Task(case, limits or Limits(), len(ends))
    trials = design(case, most, root_seed)
    running, done = prepared.chains, 0
    outcomes: list[Outcome] = []
    dropped: list[tuple[Chain, str]] = []
    for end in ends:
        racing = replace(prepared, chains=running)
        outcomes += run(case, racing, trials[done:end], map, curves)
        done = end
        wide = task.scores(racing, outcomes, _TESTS)
        fallen = task.fallen(wide)
        dropped += fallen
        out = {chain for chain, _ in fallen}
        running = tuple(chain for chain in running if chain not in out)
        if task.is_decided([s for s in wide if s.chain not in out]):
            break
    scores = score(case, prepared, outcomes, peeks=len(ends), curves=curves)
    return Race(
        outcomes=tuple(outcomes),
        scores=scores,
        trials={s.chain: s.trials for s in scores},
        dropped=tuple(dropped),
        peeks=len(ends),
    )


@dataclass(frozen=True, slots=True)
class _Task:
    """What a chain must meet, and how often it is asked."""

    case: LookCase
    limits: Limits
    peeks: int

    def scores(
        self, racing: Prepared, outcomes: Sequence[Outcome], tests: int
    ) -> tuple[Score, ...]:
        """Return scores whose bounds hold in every test of every round at once."""
        return score(self.case, racing, outcomes, peeks=tests * self.peeks)

    def fallen(self, scores: Sequence[Score]) -> list[tuple[Chain, str]]:
        """Return the chains that are out, with the reason."""
        found = [(s.chain, self.excluded(s)) for s in scores]
        out = {chain for chain, reason in found if reason}
        left = [s for s in scores if s.chain not in out]
        found += [(s.chain, self.dominated(s, left)) for s in left]
        return [(chain, reason) for chain, reason in found if reason]

    def excluded(self, score: Score) -> str:
        """Return which limit the chain misses for certain, "" if none."""
        level = 1 - (1 - CONFIDENCE) / (_TESTS * self.peeks)
        most = failure_upper(score.success, score.trials, level)
        if most < self.limits.success:
            return f"success below {most:.1%}, at least {self.limits.success:.0%}"
        least = success_lower(score.silent, score.trials, level)
        if least > self.limits.silent_upper:
            return (
                f"silent failures above {least:.2%}, limit "
                f"{self.limits.silent_upper:.2%}"
            )
        if score.need_lower_um > self.case.tolerance_um:
            return (
                f"2 sigma + |bias| above {score.need_lower_um:.3g} um, tolerance "
                f"{self.case.tolerance_um:.3g} um"
            )
        return self.turned(score)

    def turned(self, score: Score) -> str:
        """Return what the angle misses for certain, "" if nothing."""
        limit = self.case.tolerance_theta_rad
        if limit is None or not score.success:
            return ""
        if not score.angles:
            return "gives no angle, which is needed"
        if score.theta is not None and score.theta.need_lower > limit:
            return (
                f"2 sigma + |bias| of the angle above {score.theta.need_lower:.3g} "
                f"rad, tolerance {limit:.3g} rad"
            )
        return ""

    def dominated(self, score: Score, left: Sequence[Score]) -> str:
        """Return which other chain makes this one superfluous, "" if none."""
        for other in left:
            if (
                other.chain != score.chain
                and other.chain[0] == score.chain[0]
                and self.meets(other)
                and other.cost <= score.cost
                and other.success >= score.success
                and other.silent <= score.silent
                and self.surely_finer(other, score)
            ):
                return f"{' > '.join(other.chain)} is no dearer and more accurate"
        return ""

    def meets(self, score: Score) -> bool:
        """Return whether the chain has met all limits so far, the needs for certain."""
        return (
            score.success >= self.limits.success * score.trials
            and (not score.silent or score.silent_upper <= self.limits.silent_upper)
            and self.use(score) <= 1
        )

    def surely_finer(self, one: Score, other: Score) -> bool:
        """Return whether one chain's need is below the other's for certain."""
        if one.need_upper_um > other.need_lower_um:
            return False
        if self.case.tolerance_theta_rad is None:
            return True
        return one.theta is not None and (
            other.theta is None or one.theta.need_upper <= other.theta.need_lower
        )

    def use(self, score: Score) -> float:
        """Return the largest share of the tighter tolerance that is not refuted."""
        place = score.need_upper_um / self.case.tolerance_um
        limit = self.case.tolerance_theta_rad
        if limit is None:
            return place
        return max(place, _most(score, score.theta) / limit)

    def is_decided(self, left: Sequence[Score]) -> bool:
        """Return whether more trials cannot change the choice."""
        if not left:
            return True
        first = min(left, key=lambda s: (s.cost, s.chain))
        return (
            first.success_lower >= self.limits.success
            and first.silent_upper <= self.limits.silent_upper
            and self.use(first) <= self.limits.roomy
        )


def _most(score: Score, theta: Estimate | None) -> float:
    """Return the largest need of the angle; inf where it is not always given."""
    if theta is None or score.angles < score.success:
        return math.inf
    return theta.need_upper


def _ends(rounds: Sequence[int], most: int) -> tuple[int, ...]:
    """Return the trials at the end of each round, `most` the last."""
    if any(b <= a for a, b in zip((0, *rounds), rounds, strict=False)):
        raise ValueError(f"rounds must rise from 1, got {tuple(rounds)}")
    return (*(end for end in rounds if end < most), most)
