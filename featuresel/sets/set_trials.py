"""Trials of several features measured on one image: the pose they determine."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from microplan.arrays import FloatArray, Point
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.perturb import exposed
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.templates import Located, located
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.fusion import Believed, SeenFeature, fuse
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome, Outcomes
from microplan.featuresel.trials.repeatability import (
    Repeated,
    from_stops,
    trueness_of,
)
from microplan.featuresel.trials.score import ChainScore, chain_cost, score_chain
from microplan.featuresel.trials.trials import (
    Map,
    PreparedRoutines,
    follow,
    outcome_of,
    with_move,
)
from microplan.optics.lens.sensor import linear


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """A feature of a set, with the chain that measures it."""

    case: LookCase  # a look at the feature itself, through the same region
    prepared: PreparedRoutines  # of its one chain
    score: ChainScore  # of that chain, by the feature's own trials
    offset_um: tuple[float, float]  # from the set's point, in the part's frame
    sigma_um: float  # of its position per axis, fabrication errors included

    @property
    def name(self) -> str:
        """Return the feature's name."""
        return self.case.target.name

    @property
    def chain(self) -> Chain:
        """Return the routines that measure it."""
        return self.prepared.chains[0]


def score_set(
    case: LookCase,
    members: Sequence[Member],
    trials: Sequence[Trial],
    *,
    least: int,
    stops_um: Sequence[float] = (),
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
) -> ChainScore:
    """Return what the members tell together of the case's target, by fresh trials.

    Parameters
    ----------
    case : LookCase
        The look: its target is the point that is wanted.
    members : sequence of Member
        At least one; their cases differ from `case` in the target alone.
    trials : sequence of Trial
        Of `case`, see `microplan.featuresel.look.design.design`.
    least : int
        Features that must answer for the set to answer.
    stops_um : sequence of float
        Further stops of the focus from the look's own, in turn, until so many have.
    map : callable
        As in `microplan.featuresel.trials.trials.run`; gets one trial at a time.

    Returns
    -------
    Score
        Of a chain that names the features; each trial's errors are of the pose that
        `microplan.featuresel.routines.fusion.fuse` makes of those that answered.

    Raises
    ------
    ValueError
        If there is no member or no trial.
    """
    asked = _Asked(members=tuple(members), least=least, stops_um=tuple(stops_um))
    return _score(case, members, _outcomes(case, asked, trials, map))


def repeated_set(
    case: LookCase,
    members: Sequence[Member],
    trials: Sequence[Trial],
    *,
    least: int,
    stops_um: Sequence[float] = (),
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
) -> Repeated:
    """Return what `score_set` does, with the trueness of what the members tell.

    Of one chain that names the features.
    """
    asked = _Asked(
        members=tuple(members), least=least, stops_um=tuple(stops_um), tells_moves=True
    )
    outcomes = _outcomes(case, asked, trials, map)
    return Repeated(
        outcomes=Outcomes.of(outcomes),
        scores=(_score(case, members, outcomes),),
        trueness=(trueness_of(case, outcomes),),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Asked:
    """What trials of a set are made with."""

    members: tuple[Member, ...]
    least: int  # that must answer
    stops_um: tuple[float, ...]
    tells_moves: bool = False  # by how much discrepancies moved answers

    @property
    def chain(self) -> Chain:
        """Return the features' names in place of routines."""
        return _chain(self.members)


def _outcomes(
    case: LookCase,
    asked: _Asked,
    trials: Sequence[Trial],
    map: Map,  # noqa: A002 - as above
) -> tuple[Outcome, ...]:
    """Return what a set says of each trial."""
    if not asked.members or not trials:
        raise ValueError("a set needs members and trials")
    return tuple(map(partial(_tried, case, asked), trials))


def _score(
    case: LookCase, members: Sequence[Member], outcomes: Sequence[Outcome]
) -> ChainScore:
    """Return the score of a set."""
    cost = sum(chain_cost(m.case, m.prepared, m.chain) for m in members)
    return score_chain(case, _chain(members), outcomes, cost)


def _chain(members: Sequence[Member]) -> Chain:
    """Return the features' names in place of routines."""
    return tuple(member.name for member in members)


def _found(
    asked: _Asked, trial: Trial, pictures: Iterable[FloatArray]
) -> list[SeenFeature | Failure]:
    """Return each member as the first of the pictures that shows it has it.

    There are no further ones once so many as needed are found.
    """
    found: list[SeenFeature | Failure] = [Failure("not_seen", "")] * len(asked.members)
    for picture in pictures:
        found = [
            known
            if isinstance(known, SeenFeature)
            else _seen(member, picture, trial.together_um)
            for known, member in zip(found, asked.members, strict=True)
        ]
        if sum(isinstance(each, SeenFeature) for each in found) >= asked.least:
            break
    return found


def _tried(case: LookCase, asked: _Asked, trial: Trial) -> Outcome:
    """Return what the set says of one trial, from focus stop to focus stop."""
    stops = from_stops(trial, asked.stops_um)
    made: list[tuple[FloatArray, FloatArray]] = []  # by stop, as they are asked for

    def pictures(share: float) -> Iterator[FloatArray]:
        for number, stop in enumerate(stops):
            if number == len(made):
                counts, more = exposed(case, stop)
                made.append((linear(counts, case.sensor), more))
            picture, more = made[number]
            yield picture - share * more

    there = _told(case, asked, trial, pictures(0.0))
    if not asked.tells_moves or case.discrepancy is None:
        return there
    return with_move(case, there, _told(case, asked, trial, pictures(1.0)))


def _told(
    case: LookCase, asked: _Asked, trial: Trial, pictures: Iterable[FloatArray]
) -> Outcome:
    """Return what the set says of the pictures of one trial."""
    found = _found(asked, trial, pictures)
    answered = [seen for seen in found if isinstance(seen, SeenFeature)]
    if len(answered) < asked.least:
        missed = next(seen for seen in found if isinstance(seen, Failure))
        return outcome_of(case, trial, asked.chain, missed)
    fused = fuse(answered, _believed(case))
    if isinstance(fused, Failure):
        return outcome_of(case, trial, asked.chain, fused)
    place = Located(
        x_um=fused.x_um, y_um=fused.y_um, theta_rad=fused.theta_rad, axis_rad=None
    )
    return replace(
        outcome_of(case, trial, asked.chain, place),
        spread_um=fused.sigma_um,
        spread_theta_rad=fused.sigma_theta_rad,
    )


def _believed(case: LookCase) -> Believed | None:
    """Return the angle that a look starts with, None if it is any."""
    if case.theta_any:
        return None
    return Believed(
        theta_rad=case.theta_rad, sigma_rad=case.spread.pose_sigma_theta_rad
    )


def _seen(member: Member, picture: FloatArray, off_um: Point) -> SeenFeature | Failure:
    """Return a feature as one image shows it, its mean error taken off.

    It starts as far off the nominal place as is known.
    """
    case = member.case
    found = follow(case, member.prepared, member.chain, picture, {}, off_um)
    if isinstance(found, Failure):
        return found
    place = located(case, found)
    if isinstance(place, Failure):
        return place
    turn = case.theta_rad if place.theta_rad is None else place.theta_rad
    x, y = member.score.bias_um or (0.0, 0.0)
    if place.theta_rad is None and case.theta_any:
        x, y = 0.0, 0.0  # which way it points is not known
    c, s = math.cos(turn), math.sin(turn)
    # what is left of the angle's bias counts as spread, as it does in the search
    sigma_theta = math.hypot(
        member.score.sigma_theta_rad or 0.0, member.score.bias_theta_rad or 0.0
    )
    return SeenFeature(
        x_um=place.x_um - (c * x - s * y),
        y_um=place.y_um - (s * x + c * y),
        sigma_um=member.sigma_um,
        offset_um=member.offset_um,
        axis_rad=place.axis_rad,
        theta_rad=place.theta_rad,
        sigma_theta_rad=sigma_theta or None,
    )
