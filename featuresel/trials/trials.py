"""Chains of routines tried on the same perturbed images."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol, TypeVar

from microplan.arrays import FloatArray, Point
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.perturb import exposed
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.templates import Located, along, located
from microplan.featuresel.routines.chain import ChainState, advance
from microplan.featuresel.routines.contract import Artifact, Failure, Guess, Measurement
from microplan.featuresel.routines.registry import load
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome, Outcomes
from microplan.featuresel.trials.trial_cache import Known
from microplan.optics.lens.sensor import CountArray, linear

_CHUNK = 2  # trials handed to one worker at a time: 24 keep 4 workers busy to the end
_AT_ONCE = 512  # trials made and handed out before their outcomes are waited for
# Of every four trials the first two tell what moved their answers: half are enough for
# a part of sigma, and these have both models equally often.
_TELLING = 4, 2

# An answer more than this many tolerances off is wrong. A chain that only just passes
# (2 sigma + bias = tolerance) comes there by 4 sigma, so what is counted are outliers,
# not the spread the error budget has already.
WRONG_TOLERANCES = 2.0

A = TypeVar("A")
B = TypeVar("B")


class Map(Protocol):
    """What `run` needs of `map`: order kept, any workers."""

    def __call__(
        self, function: Callable[[A], B], items: Iterable[A], /
    ) -> Iterable[B]:
        """Return `function` of each item, in order."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class PreparedRoutines:
    """Routines made ready for one look; a routine that could not be is a Failure."""

    chains: tuple[Chain, ...]
    artifacts: Mapping[str, Artifact | Failure]


def prepare(case: LookCase, chains: Sequence[Chain]) -> PreparedRoutines:
    """Return each routine of `chains` prepared once, on the nominal image."""
    names = sorted({name for chain in chains for name in chain})
    render = nominal_render(case)
    artifacts: dict[str, Artifact | Failure] = {}
    for name in names:
        routine = load(name)
        if case.target.kind not in routine.kinds:
            message = f"{name} cannot look for {case.target.kind}"
            artifacts[name] = Failure("wrong_kind", message)
        else:
            artifacts[name] = routine.prepare(render, case.target)
    return PreparedRoutines(chains=tuple(chains), artifacts=artifacts)


def start(case: LookCase, off_um: Point = (0.0, 0.0)) -> Guess:
    """Return where a look starts: the nominal position, the angle if known.

    Or as far off it as is known, world um.
    """
    theta, k = None if case.theta_any else case.target.theta_rad, case.target.px_per_um
    return Guess(
        column=case.target.column + k * off_um[0],
        row=case.target.row - k * off_um[1],
        theta_rad=theta,
        theta_assumed=True,
    )


def run(
    case: LookCase,
    prepared: PreparedRoutines,
    trials: Sequence[Trial],
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
    known: Known | None = None,
    *,
    tells_moves: bool = False,
) -> Outcomes:
    """Return what every chain said of every trial, trial by trial.

    Parameters
    ----------
    case : LookCase
        The look.
    prepared : PreparedRoutines
        Its chains and artifacts.
    trials : sequence of Trial
        From `microplan.featuresel.look.design.design`.
    map : callable
        Stands in for the builtin; gets a picklable function and chunks of trials, so
        that a process pool's `map` can do the work. The result does not depend on it.
    known : Known, optional
        What is known of the look already, with the same artifacts: no chain measures a
        trial twice. Takes what is found.
    tells_moves : bool
        Whether outcomes tell by how much the pictures' discrepancy moved them, those of
        half of the trials: every chain measures once more, without it. Then nothing may
        be known.

    Returns
    -------
    Outcomes
        Each image is made once and every chain measures it.
    """
    if tells_moves and known is not None:
        raise ValueError("trials that are known do not tell what moved them")
    seen = known or Known()
    what = _Asks(keeps=known is not None, tells_moves=tells_moves)
    work = partial(_run_chunk, case, prepared, what)
    order = array("i")
    for first in range(0, len(trials), _AT_ONCE):
        some = [_asked(prepared, t, seen) for t in trials[first : first + _AT_ONCE]]
        order.extend(each.trial.index for each in some)
        some = [each for each in some if each.chains]
        chunks = [tuple(some[i : i + _CHUNK]) for i in range(0, len(some), _CHUNK)]
        for chunk in map(work, chunks):
            for outcomes, picture in chunk:
                for outcome in outcomes:
                    seen.outcomes.add(outcome)
                seen.keep(outcomes[0].trial, picture)
    return seen.outcomes.pick(
        (chain, index) for index in order for chain in prepared.chains
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _PlannedTrial:
    """A trial, the chains that are to measure it, and its picture if that is known."""

    trial: Trial
    chains: tuple[Chain, ...]
    picture: CountArray | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Asks:
    """What is to be found of trials besides answers."""

    keeps: bool  # their pictures
    tells_moves: bool  # by how much discrepancies moved answers


def _asked(prepared: PreparedRoutines, trial: Trial, seen: Known) -> _PlannedTrial:
    """Return what is not known of a trial yet."""
    return _PlannedTrial(
        trial=trial,
        chains=tuple(
            chain
            for chain in prepared.chains
            if (chain, trial.index) not in seen.outcomes
        ),
        picture=seen.pictures.get(trial.index),
    )


def measure_picture(
    case: LookCase,
    prepared: PreparedRoutines,
    trial: Trial,
    picture: FloatArray,
) -> tuple[Outcome, ...]:
    """Return what each chain measures in `picture`, (rows, columns) 0..1."""
    done: dict[Chain, ChainState | Failure] = {}
    return tuple(
        _outcome(
            case,
            trial,
            chain,
            follow(case, prepared, chain, picture, done, trial.together_um),
        )
        for chain in prepared.chains
    )


def follow(
    case: LookCase,
    prepared: PreparedRoutines,
    chain: Chain,
    picture: FloatArray,
    done: dict[Chain, ChainState | Failure],
    off_um: Point = (0.0, 0.0),
) -> Measurement | Failure:
    """Return what `measure_chain` would in `picture`, (rows, columns) 0..1.

    A beginning that chains share is done once. `off_um` is as `start` has it.

    `done` holds the beginnings done on this image so far, and takes what is added.
    """
    progress = ChainState(guess=start(case, off_um))
    for length, name in enumerate(chain, 1):
        beginning = chain[:length]
        if beginning not in done:
            done[beginning] = _step(prepared, name, picture, progress)
        after = done[beginning]
        if isinstance(after, Failure):
            return after
        progress = after
    assert progress.found is not None  # noqa: S101 - a chain has a routine
    return progress.found


def _step(
    prepared: PreparedRoutines, name: str, picture: FloatArray, progress: ChainState
) -> ChainState | Failure:
    """Return the state after one routine, which may not even be prepared."""
    artifact = prepared.artifacts[name]
    if isinstance(artifact, Failure):
        return Failure("not_prepared", f"{name}: {artifact.message}")
    return advance(picture, name, artifact, progress)


def _run_chunk(
    case: LookCase,
    prepared: PreparedRoutines,
    asks: _Asks,
    asked: Sequence[_PlannedTrial],
) -> list[tuple[tuple[Outcome, ...], CountArray | None]]:
    """Return the outcomes of some trials, in order, and pictures that are new."""
    found = []
    for each in asked:
        picture, more = each.picture, None
        if picture is None:
            picture, more = exposed(case, each.trial)
        only = replace(prepared, chains=each.chains)
        shown = linear(picture, case.sensor)
        outcomes = measure_picture(case, only, each.trial, shown)
        turns, telling = _TELLING
        tells = asks.tells_moves and each.trial.index % turns < telling
        if tells and more is not None and case.discrepancy is not None:
            plain = measure_picture(case, only, each.trial, shown - more)
            outcomes = tuple(
                with_move(case, *both) for both in zip(outcomes, plain, strict=True)
            )
        fresh = picture if asks.keeps and each.picture is None else None
        found.append((outcomes, fresh))
    return found


def with_move(case: LookCase, there: Outcome, plain: Outcome) -> Outcome:
    """Return an outcome with what it differs by from one without discrepancy."""
    if there.target_um is None or plain.target_um is None:
        return there
    (x, y), (x0, y0) = there.target_um, plain.target_um
    turn = None
    if there.theta_rad is not None and plain.theta_rad is not None:
        turn = math.remainder(there.theta_rad - plain.theta_rad, period_rad(case))
    return replace(there, moved_um=(x - x0, y - y0), moved_rad=turn)


def _outcome(
    case: LookCase,
    trial: Trial,
    chain: Chain,
    found: Measurement | Failure,
) -> Outcome:
    """Return the errors of a measurement, and what the chain says of itself."""
    if isinstance(found, Failure):
        return outcome_of(case, trial, chain, found)
    place = located(case, found)
    if isinstance(place, Failure):
        return outcome_of(case, trial, chain, place)
    return replace(
        outcome_of(case, trial, chain, place),
        score=found.score,
        spread_um=found.spread_px * case.microscope.um_per_px,
        spread_theta_rad=found.spread_theta_rad,
        depth_um=None if found.z_um is None else abs(found.z_um),
        z_um=_focus_error_um(found, trial.dz_um),
        zoom=None if found.zoom is None else found.zoom - trial.magnification,
    )


def _focus_error_um(found: Measurement, dz_um: float) -> float | None:
    """Return the error of the focus, or of its size where no sign is measured."""
    if found.z_um is None:
        return None
    if found.z_is_signed:
        return found.z_um - dz_um
    return abs(found.z_um) - abs(dz_um)


def outcome_of(
    case: LookCase, trial: Trial, chain: Chain, place: Located | Failure
) -> Outcome:
    """Return the errors of a position in the world's and the target's axes."""
    if isinstance(place, Failure):
        return Outcome(
            chain=chain, trial=trial.index, failure=place.code, corner=trial.corner
        )
    off = (place.x_um - case.x_um - trial.dx_um, place.y_um - case.y_um - trial.dy_um)
    ex, ey = along(off, place.axis_rad)
    theta = case.theta_rad + trial.dtheta_rad
    c, s = math.cos(theta), math.sin(theta)
    turned, axis = None, place.axis_rad
    if place.theta_rad is not None:
        turned = math.remainder(place.theta_rad - theta, period_rad(case))
    return Outcome(
        chain=chain,
        trial=trial.index,
        world_um=(ex, ey),
        target_um=(c * ex + s * ey, -s * ex + c * ey),
        theta_rad=turned,
        axis_rad=None if axis is None else math.remainder(axis - theta, 2 * math.pi),
        corner=trial.corner,
    )


def period_rad(case: LookCase) -> float:
    """Return the turn that leaves the target the same; a notch makes it a full one."""
    fold = case.target.symmetry if case.target.kind == "outline" else 1
    return 2 * math.pi / max(fold, 1)


def is_wrong(case: LookCase, outcome: Outcome) -> bool:
    """Return whether the chain answered, but more than two tolerances off."""
    if outcome.failure is not None:
        return False
    if outcome.distance_um > WRONG_TOLERANCES * case.tolerance_um:
        return True
    limit = case.tolerance_theta_rad
    if limit is None or outcome.theta_rad is None:
        return False
    return abs(outcome.theta_rad) > WRONG_TOLERANCES * limit
