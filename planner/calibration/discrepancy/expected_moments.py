"""What moments of residuals are to be expected of unit shares, the fit allowed for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.look.scenario import LookCase
from microplan.planner.calibration.discrepancy.misfit_moments import (
    FAR,
    NEXT,
    ROUGH,
    Step,
    a_step_apart,
    inner_pixels,
)
from microplan.planner.calibration.discrepancy.picture_misfit import (
    PictureMisfit,
    part_discrepancy,
)

_LENGTHS = 6  # of edges, even in their logarithm: what they have in common to 1 %


@dataclass(frozen=True, slots=True, kw_only=True)
class _Field:
    """A normal field times a weight, and how a fit's basis spreads by its covariance.

    Arrays are (R, C) and, of the basis, (K, R, C).
    """

    weight: FloatArray
    alike: Callable[[Step], float]  # correlation of pixels a step apart
    basis: FloatArray
    spread: FloatArray  # the covariance times the basis
    inner: FloatArray  # (K, K) basis by covariance by basis


def moment_matrix(case: LookCase, seen: PictureMisfit) -> FloatArray:
    """Return what moments unit squares of edge, flat and pixel give, (3, 3).

    Rows are as `moments` has them, columns as shares; no noise. Means over all draws of
    `featuresel.look.discrepancy`, of what the fit of gain, offset and pose leaves.

    Parameters
    ----------
    case : LookCase
        Of the region that is shown: lengths of the fields.
    seen : PictureMisfit
        Its fit, edges and faces.

    Notes
    -----
    Of a covariance C and an orthonormal basis Q the fit leaves
    C - Q Q'C - C Q Q' + Q Q'C Q Q'. Of single pixels' moment what it takes is left out:
    some six in as many as there are pixels.
    """
    size, k = part_discrepancy(case), case.target.px_per_um
    shares = (np.arange(_LENGTHS) + 0.5) / _LENGTHS
    ratio = size.size_um / size.fine_um
    along_px = [size.fine_um * ratio**share * k for share in shares.tolist()]
    fields = (
        _field(seen, seen.steps, along_px),
        _field(seen, seen.image, [size.size_um * k]),
        _field(seen, np.full(seen.image.shape, seen.step), []),
    )
    rows = [
        [_shared(each, seen.steps, seen.edges, NEXT) for each in fields],
        [_shared(each, seen.image, seen.faces, FAR) for each in fields],
        [_rough(each, seen) for each in fields],
    ]
    return np.array(rows)


def _field(seen: PictureMisfit, weight: FloatArray, lengths_px: list[float]) -> _Field:
    """Return a field of one of several correlation lengths; of none, white."""
    basis = np.zeros((seen.basis.shape[1], *seen.used.shape))
    basis[:, seen.used] = seen.basis.T
    weighted = weight * seen.used * basis
    smooth = [_smoothed(weighted, length) for length in lengths_px] or [weighted]
    spread: FloatArray = weight * seen.used * np.mean(smooth, axis=0)

    def alike(step: Step) -> float:
        far = math.hypot(*step)
        if not lengths_px:
            return float(far == 0)
        return sum(math.exp(-((far / x) ** 2) / 2) for x in lengths_px) / len(
            lengths_px
        )

    inner = np.einsum("irc,jrc->ij", basis, spread)
    return _Field(weight=weight, alike=alike, basis=basis, spread=spread, inner=inner)


def _smoothed(values: FloatArray, length_px: float) -> FloatArray:
    """Return values (K, R, C) times a field's covariance."""
    down, across = (_common(count, length_px) for count in values.shape[1:])
    found: FloatArray = down @ values @ across
    return found


def _common(count: int, length_px: float) -> FloatArray:
    """Return correlations of pixels of a line, (count, count)."""
    off = np.subtract.outer(np.arange(count), np.arange(count)) / length_px
    found: FloatArray = np.exp(-(off**2) / 2)
    return found


def _shared(
    field: _Field, weight: FloatArray, where: BoolArray, steps: tuple[Step, ...]
) -> float:
    """Return the mean product of what is left of a field a step apart, as shares."""
    top = below = 0.0
    back = np.tensordot(field.inner, field.basis, axes=1) / 2 - field.spread
    for step in steps:
        one, two = a_step_apart(weight * where, step)
        own, beside = a_step_apart(field.weight, step)
        basis, basis_there = a_step_apart(field.basis, step)
        taken, taken_there = a_step_apart(back, step)
        left = field.alike(step) * own * beside
        left = left + np.sum(basis * taken_there + taken * basis_there, axis=0)
        top += float(np.sum(one * two * left))
        below += float(np.sum((one * two) ** 2))
    return top / below if below > 0 else 0.0


def _rough(field: _Field, seen: PictureMisfit) -> float:
    """Return the variance of a field at the finest detail, over the step's square."""
    inner, total = inner_pixels(seen.used), np.zeros(seen.used.shape)
    shifts = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1)]
    around = {(i, j): np.roll(field.weight, (-i, -j), (0, 1)) for i, j in shifts}
    for one in shifts:
        for two in shifts:
            factor = ROUGH[one[0] + 1, one[1] + 1] * ROUGH[two[0] + 1, two[1] + 1]
            alike = field.alike((one[0] - two[0], one[1] - two[1]))
            if alike:
                total += factor * alike * around[one] * around[two]
    return float(total[inner].mean()) / seen.step**2
