"""Information of images: several together, some parameters alone, few pixels."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import BoolArray, IntArray
from microplan.featuresel.limits.crlb import pixel_scores, summed
from microplan.featuresel.limits.information import (
    Information,
    covariance,
    inverse,
    places,
)
from microplan.featuresel.look.sensitivity import Sensitivities
from microplan.featuresel.routines.contract import CameraNoise

_ROUNDING = 1e-14  # of a sum of squares
_ROUNDS = 2  # of choosing pixels: a third takes none off a gear's


def together(*images: Information) -> Information:
    """Return what independent images tell together.

    Parameters of one name are one parameter; where each image has its own, take
    `without` it first.
    """
    names = tuple(dict.fromkeys(name for each in images for name in each.names))
    matrix, faked = np.zeros((len(names), len(names))), np.zeros(len(names))
    for each in images:
        at = [names.index(name) for name in each.names]
        matrix[np.ix_(at, at)] += each.matrix
        faked[at] += each.faked
    return Information(names=names, matrix=matrix, faked=faked)


def only(told: Information, names: Collection[str]) -> Information:
    """Return what is known if all but `names` were known; KeyError if missing."""
    at = places(told.names, names)
    return Information(
        names=tuple(told.names[k] for k in at),
        matrix=told.matrix[np.ix_(at, at)],
        faked=told.faked[at],
    )


def without(told: Information, names: Collection[str]) -> Information:
    """Return what is known about the rest if nothing is known about `names`.

    The Schur complement; where `names` are not observable the pseudo-inverse, which
    leaves them out. KeyError if one is missing.
    """
    out = places(told.names, names)
    stay = [k for k in range(len(told.names)) if k not in out]
    cross = told.matrix[np.ix_(stay, out)]
    spent, _ = inverse(only(told, names))
    rounding = _ROUNDING * np.diag(told.matrix)[stay]
    return Information(
        names=tuple(told.names[k] for k in stay),
        matrix=told.matrix[np.ix_(stay, stay)] - cross @ spent @ cross.T,
        faked=told.faked[stay] + rounding,
    )


def slopes_of(seen: Sensitivities, names: Sequence[str]) -> Sensitivities:
    """Return the slopes of some names, in the order given; ValueError if unknown."""
    index = [seen.names.index(name) for name in names]
    return replace(
        seen, names=tuple(names), slopes=seen.slopes[index], errors=seen.errors[index]
    )


def informative(
    seen: Sensitivities,
    camera: CameraNoise,
    wanted: Collection[str],
    *,
    share: float = 0.98,
    mask: BoolArray | None = None,
) -> BoolArray:
    """Return few pixels with nearly the information of all, (rows, columns).

    Pixels are taken in falling order of their `density` of what is wanted, relative to
    each limit, until 1 / limit**2 of every wanted parameter that is observable reaches
    `share` of what all pixels give, the rest of `seen` being unknown. What pixels tell
    depends on what else is taken, so they are ranked again by those found first; the
    smaller set is returned. None if nothing wanted is observable.

    Raises
    ------
    KeyError
        If something wanted has no slopes.
    ValueError
        If `share` is not in (0, 1], or the mask does not fit.
    """
    if not 0 < share <= 1:
        raise ValueError(f"share must be in (0, 1], got {share}")
    slopes, errors = pixel_scores(seen, camera, mask)
    known = summed(seen.names, slopes, errors)
    variances, at = np.diag(covariance(known)), places(seen.names, wanted)
    at = [k for k in at if variances[k] < math.inf]
    goal = variances[at] / share * (1 + 1e-12)

    def told(taken: IntArray) -> Information:
        return summed(seen.names, slopes[:, taken], errors[:, taken])

    best: IntArray = np.arange(seen.mean.size if at else 0)
    for _ in range(_ROUNDS if at else 0):
        influence = inverse(known)[0][at] @ slopes
        rank = (influence**2 / variances[at, None]).sum(axis=0)
        order = np.argsort(-rank, kind="stable")
        few, many = 0, len(order)
        while many - few > 1:
            middle = (few + many) // 2
            left = np.diag(covariance(told(order[:middle])))[at]
            few, many = (few, middle) if (left <= goal).all() else (middle, many)
        known = told(order[:many])
        best = min(best, order[:many], key=len)
    chosen = np.zeros(seen.mean.size, dtype=np.bool_)
    chosen[best] = True
    return chosen.reshape(seen.mean.shape)
