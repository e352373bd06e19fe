"""Choice of the light's unknowns to fit: those whose bias outweighs their variance."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping

import numpy as np

from microplan.featuresel.limits.information import Information, inverse, limit, places
from microplan.optics.outline import tolerant_order as ties


def choose(
    information: Information, wanted: Collection[str], spreads: Mapping[str, float]
) -> tuple[str, ...]:
    """Return which unknowns to fit: those whose bias would outweigh their price.

    Parameters
    ----------
    information : Information
        About all names below.
    wanted : collection of str
        What is to be found.
    spreads : mapping of str to float
        How much each other unknown varies, one standard deviation, >= 0.

    Returns
    -------
    tuple of str
        Names of `spreads` in its order. Of all subsets the one with the smallest worst
        ratio, over what is wanted, of root mean square error to the least that any
        subset gives; of equals the smallest, then the first. An unknown that is not
        fitted is taken as nominal, and its spread shifts a maximum-likelihood estimate
        of the others by F_SS**-1 F_Sn of it.

    Raises
    ------
    KeyError
        If a name is missing.
    ValueError
        If a spread is negative or nan.
    """
    bad = {name: spread for name, spread in spreads.items() if not spread >= 0}
    if bad:
        raise ValueError(f"spreads must not be negative, got {bad}")
    places(information.names, spreads)  # or a KeyError
    subsets = [
        chosen
        for count in range(len(spreads) + 1)
        for chosen in itertools.combinations(spreads, count)
    ]
    errors = [_errors(information, wanted, spreads, chosen) for chosen in subsets]
    least = {name: min(each[name] for each in errors) for name in wanted}
    seen = [name for name in wanted if least[name] < math.inf]
    worst = [
        max((each[name] / least[name] for name in seen), default=1.0) for each in errors
    ]
    return subsets[ties.least(range(len(subsets)), worst.__getitem__)]


def _errors(
    information: Information,
    wanted: Collection[str],
    spreads: Mapping[str, float],
    chosen: Collection[str],
) -> dict[str, float]:
    """Return the root mean square error of what is wanted, with a subset fitted."""
    fitted = information.only({*wanted, *chosen})
    sigmas = limit(fitted)
    left = [name for name in spreads if name not in chosen]
    cross = information.matrix[
        np.ix_(
            places(information.names, fitted.names),
            [information.names.index(name) for name in left],
        )
    ]
    shift = inverse(fitted)[0] @ cross * np.array([spreads[name] for name in left])
    bias = dict(zip(fitted.names, (shift**2).sum(axis=1).tolist(), strict=True))
    return {name: math.sqrt(sigmas[name] ** 2 + bias[name]) for name in wanted}
