"""Fisher information about some parameters: sums, marginals, and the bound it sets."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from microplan.arrays import BoolArray, FloatArray

# A slope known to a tenth only is none: its information is below 100 times what
# its errors can fake.
_TRUST = 100.0
_FAKED = 3.0  # how far errors of several slopes may add up in one direction
_ROUNDING = 1e-14  # of a sum of squares, and of eigenvalues of a scaled matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class Information:
    """A Fisher matrix, and how much of it errors of the slopes can fake."""

    names: tuple[str, ...]
    matrix: FloatArray  # (P, P)
    faked: FloatArray  # (P,) at most, of the diagonal

    def __post_init__(self) -> None:
        count = len(self.names)
        if self.matrix.shape != (count, count) or self.faked.shape != (count,):
            raise ValueError(f"matrix must be {(count, count)}, for {self.names}")
        if not (np.isfinite(self.matrix).all() and np.isfinite(self.faked).all()):
            raise ValueError("matrix and faked must be finite")

    def with_prior(self, sigmas: Mapping[str, float]) -> Information:
        """Return it with what is known before: standard deviations by name, > 0."""
        matrix = self.matrix.copy()
        for name, sigma in sigmas.items():
            if not sigma > 0:
                raise ValueError(f"the prior of {name} must be positive, got {sigma}")
            k = places(self.names, (name,))[0]
            matrix[k, k] += sigma**-2
        return Information(names=self.names, matrix=matrix, faked=self.faked)


def covariance(information: Information) -> FloatArray:
    """Return the smallest covariance of unbiased estimates, (P, P), e.g. um squared.

    A parameter that is not observable has infinite variance and no covariance. One is
    not if its slope is known to less than a tenth, or if it has a part in a direction
    of parameters whose information is no larger than what errors of the slopes can
    fake, and which could make its variance more than twice as large.

    References
    ----------
    Stoica & Marzetta (2001), Parameter estimation problems with singular information
    matrices, IEEE Trans. Signal Processing 49(1): a parameter outside the range of the
    matrix has no finite bound, for the others the pseudo-inverse gives it.
    """
    found, lost = inverse(information)
    found[lost, :] = found[:, lost] = 0.0
    found[lost, lost] = math.inf
    return found


def limit(information: Information) -> dict[str, float]:
    """Return the smallest standard deviation of each parameter, inf if not observable.

    All others are unknown too; `covariance` says when a parameter is not observable.
    """
    sigmas = np.sqrt(np.diag(covariance(information)))
    return dict(zip(information.names, sigmas.tolist(), strict=True))


def places(names: tuple[str, ...], wanted: Collection[str]) -> list[int]:
    """Return where `wanted` stand in `names`, rising; KeyError if one is missing."""
    unknown = sorted(set(wanted) - set(names))
    if unknown:
        raise KeyError(f"nothing is known about {unknown}, only about {names}")
    return [k for k, name in enumerate(names) if name in wanted]


def inverse(information: Information) -> tuple[FloatArray, BoolArray]:
    """Return the pseudo-inverse over what is observable, e.g. um^2, and what is that.

    Returns
    -------
    (P, P) float64 array
        Directions that are not observable are left out, as if they were known.
    (P,) bool array
        As in `covariance`.
    """
    known = np.diag(information.matrix)
    seen = known > _TRUST * (information.faked + _ROUNDING * known)
    found = np.zeros_like(information.matrix)
    lost = ~seen
    if not seen.any():
        return found, lost
    scale = np.sqrt(known[seen])
    values, vectors = np.linalg.eigh(
        information.matrix[np.ix_(seen, seen)] / np.outer(scale, scale)
    )
    doubt = np.sqrt(information.faked[seen]) / scale
    floor = (_FAKED * np.abs(vectors).T @ doubt) ** 2 + _ROUNDING * len(scale)
    dark = values <= floor
    bright = vectors[:, ~dark]
    told_of = (bright / values[~dark]) @ bright.T
    risk = (vectors[:, dark] ** 2 / floor[dark]).sum(axis=1)
    lost[seen] = risk > np.diag(told_of)
    found[np.ix_(seen, seen)] = told_of / np.outer(scale, scale)
    return found, lost
