"""Smallest set of a look's pixels with nearly all of its information."""

from __future__ import annotations

import math
from collections.abc import Collection

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

_ROUNDS = 2  # of choosing pixels: a third takes none off a gear's


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
