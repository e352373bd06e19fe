"""How far focus and zoom may drift before a chain misses its tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from featuresel.axes import words
from featuresel.bias import BiasCurve
from featuresel.candidates import Chain
from featuresel.case import LookCase
from featuresel.drift import one_by_one, through_focus
from featuresel.perturb import Trial
from featuresel.routines import FloatArray
from featuresel.trials import Map, Prepared, measure_picture

# Steps outward from nominal; the zoom's are of its ratio. A drift beyond the last is
# no drift any more.
FOCUS_UM = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 13.0, 16.0, 20.0, 25.0, 32.0, 40.0)
ZOOM = (0.002, 0.004, 0.006, 0.008, 0.01, 0.015, 0.02, 0.03, 0.05)
STRIDE = 4  # steps taken at once; shorter gaps of failures may be passed over


@dataclass(frozen=True, slots=True, kw_only=True)
class UsableRange:
    """Drifts at which every draw met the tolerance; (0, 0) or (1, 1) if none did."""

    focus_um: tuple[float, float]  # error of the focus height
    magnification: tuple[float, float]  # ratio to nominal


def usable_range(
    case: LookCase,
    prepared: Prepared,
    chain: Chain,
    *,
    root_seed: int,
    draws: int = 3,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
    curve: BiasCurve | None = None,
) -> UsableRange:
    """Return the drifts of focus and zoom that `chain` stands.

    Each direction is searched outward on `FOCUS_UM` or `ZOOM` until one of `draws`
    noisy images is not measured within the tolerance; the last step before that is the
    answer, by `last_held`. The target lies at as many random places of its pose spread,
    the same at all drifts, so that their images share its spectra. `map` gets one
    direction at a time, as in `featuresel.trials.run`; `curve` is taken off the places
    that the chain finds.

    Raises
    ------
    ValueError
        If `draws` is below 1.
    """
    if draws < 1:
        raise ValueError(f"draws must be at least 1, got {draws}")

    needed = Prepared(
        chains=(chain,), artifacts={name: prepared.artifacts[name] for name in chain}
    )
    search = partial(_reach, case, needed, curve, root_seed, draws)
    # focus goes farther and takes longer: those two first
    found = map(search, [("focus", -1), ("focus", 1), ("zoom", -1), ("zoom", 1)])
    nearer, farther, smaller, larger = found
    return UsableRange(
        focus_um=(nearer, farther), magnification=(1 + smaller, 1 + larger)
    )


def last_held(count: int, holds: Callable[[int], bool]) -> int:
    """Return the last of `count` steps before the first that does not hold.

    Parameters
    ----------
    count : int
        How many steps there are, numbered from 0 outward.
    holds : callable
        Whether a step holds; asked of six of thirteen at most.

    Returns
    -------
    int
        -1 if no step holds. Every `STRIDE`-th and the last are tried outward until one
        fails, then the steps since the one before are halved. The step returned holds
        and the next one does not; `STRIDE` or more failing in a row are never passed
        over, fewer may be where steps beyond hold again.
    """
    good, bad = -1, count
    for step in (*range(STRIDE - 1, count - 1, STRIDE), count - 1):
        if not holds(step):
            bad = step
            break
        good = step
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (middle, bad) if holds(middle) else (good, middle)
    return good


def _reach(
    case: LookCase,
    prepared: Prepared,
    curve: BiasCurve | None,
    root_seed: int,
    draws: int,
    direction: tuple[str, int],
) -> float:
    """Return the last drift in one direction at which every draw meets."""
    name, sign = direction
    steps = FOCUS_UM if name == "focus" else ZOOM
    drifts = [sign * step for step in steps]
    trials = {
        drift: [_trial(case, name, drift, k, root_seed) for k in range(draws)]
        for drift in drifts
    }
    if name == "focus" and case.shares_spectra:
        pictures = through_focus(case, trials[drifts[-1]])
    else:
        pictures = partial(one_by_one, case)

    def holds(step: int) -> bool:
        tried = trials[drifts[step]]
        return all(
            _meets(case, prepared, curve, trial, picture)
            for trial, picture in zip(tried, pictures(tried), strict=True)
        )

    last = last_held(len(drifts), holds)
    return drifts[last] if last >= 0 else 0.0


def _trial(case: LookCase, name: str, drift: float, draw: int, root: int) -> Trial:
    """Return a trial with one drift; the draw alone decides where the target is."""
    seed = (root, *words(f"{case.key}/usable {name} {drift:g} {draw}"))
    place = (root, *words(f"{case.key}/usable {draw}"))
    rng = np.random.default_rng(np.random.SeedSequence(place))
    dx, dy, turn = np.clip(rng.standard_normal(3), -2, 2)
    theta = float(turn) * case.spread.pose_sigma_theta_rad
    if case.theta_any:
        theta = float(rng.uniform(-math.pi, math.pi))
    return Trial(
        index=draw,
        dx_um=float(dx) * case.spread.pose_sigma_xy_um,
        dy_um=float(dy) * case.spread.pose_sigma_xy_um,
        dtheta_rad=theta,
        dz_um=drift if name == "focus" else 0.0,
        magnification=1 + drift if name == "zoom" else 1.0,
        gain=1.0,
        gradient_x=0.0,
        gradient_y=0.0,
        model=case.model,
        seed=seed,
    )


def _meets(
    case: LookCase,
    prepared: Prepared,
    curve: BiasCurve | None,
    trial: Trial,
    picture: FloatArray,
) -> bool:
    """Return whether the trial's picture is measured within every tolerance."""
    curves = {} if curve is None else {prepared.chains[0]: curve}
    (found,) = measure_picture(case, prepared, trial, picture, curves)
    if found.distance_um > case.tolerance_um:
        return False
    limit = case.tolerance_theta_rad
    return limit is None or (
        found.theta_rad is not None and abs(found.theta_rad) <= limit
    )
