"""Information of several images together, and about some parameters alone."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from microplan.featuresel.limits.information import Information, inverse, places
from microplan.featuresel.look.sensitivity import Sensitivities

_ROUNDING = 1e-14  # of a sum of squares


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
