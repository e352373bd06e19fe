"""All routines that may find a look's target, raced against each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from featuresel.candidates import chains, routines
from featuresel.case import LookCase
from featuresel.completeness import seen_share
from featuresel.crlb import camera_of, fisher
from featuresel.information import limit
from featuresel.nominal import nominal_render
from featuresel.race import race
from featuresel.routines import Failure, load
from featuresel.score import Score
from featuresel.select import Limits, Selection, select
from featuresel.sensitivity import sensitivities
from featuresel.trials import Map, Outcome, Prepared, prepare

ROUNDS = (8, 24, 64, 304, 1024)  # trials at the end of each; most chains leave early


@dataclass(frozen=True, slots=True, kw_only=True)
class Contest:
    """What the race over one look showed, and who won."""

    prepared: Prepared
    outcomes: tuple[Outcome, ...]
    scores: tuple[Score, ...]  # of every chain, by the trials that it had
    selection: Selection
    limit_um: float | None  # Cramer-Rao, of the worse axis; None: not observable


def compete(
    case: LookCase,
    *,
    root_seed: int,
    most: int,
    limits: Limits | None = None,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
) -> Contest:
    """Return the chain to measure a look with, and what was tried to find it.

    Parameters
    ----------
    case : LookCase
        The look.
    root_seed : int
        Root of all seeds.
    most : int
        Trials of a chain that stays in the race to its end.
    limits : Limits, optional
        What a chain must meet, as in `featuresel.select.select`.
    map : callable
        As in `featuresel.trials.run`.
    """
    ready = make_ready(case)
    raced = race(
        case,
        ready,
        root_seed=root_seed,
        most=most,
        limits=limits,
        rounds=ROUNDS,
        map=map,
    )
    least_um = limit_um(case)
    scores = tuple(replace(score, limit_um=least_um) for score in raced.scores)
    selection = select(
        scores,
        tolerance_um=case.tolerance_um,
        tolerance_theta_rad=case.tolerance_theta_rad,
        limits=limits,
        target=case.target,
        visible=seen_share(case.target, nominal_render(case).veil()),
    )
    return Contest(
        prepared=ready,
        outcomes=raced.outcomes,
        scores=scores,
        selection=selection,
        limit_um=least_um,
    )


def make_ready(case: LookCase, *, controls: bool = False) -> Prepared:
    """Return every routine prepared once, and the chains worth trying by their cost."""
    names = routines(case.target, controls=controls)
    alone = prepare(case, [(name,) for name in names])
    pixels = case.window.rows * case.window.columns
    costs = {
        name: load(name).cost(artifact, pixels)
        for name, artifact in alone.artifacts.items()
        if not isinstance(artifact, Failure)
    }
    found = chains(case.target, costs=costs, controls=controls)
    return Prepared(chains=found or chains(case.target), artifacts=alone.artifacts)


def limit_um(case: LookCase) -> float | None:
    """Return the Cramer-Rao limit of a look's place, the worse axis, as planned.

    What the trials vary is unknown to the estimator too: angle, focus, zoom, light.
    """
    seen = sensitivities(case, names=unknowns(case))
    known = limit(fisher(seen, camera_of(case)))
    worse = max(known["x"], known["y"])
    return worse if worse < float("inf") else None


def unknowns(case: LookCase) -> Sequence[str]:
    """Return what an estimator must find besides the place, by the limit's names."""
    spread, names = case.spread, ["x", "y"]
    if case.target.kind != "circle":
        names.append("theta")
    if spread.focus_sigma_um > 0:
        names.append("z")
    if spread.magnification_sigma > 0:
        names.append("zoom")
    names.append("gain")
    if spread.light_gradient[1] > 0:
        names += ["gradient_x", "gradient_y"]
    return names
