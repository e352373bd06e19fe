"""Aberrations of a lens in pictures through focus: which are told, and how surely."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from microplan.arrays import FloatArray
from microplan.planner.calibration.estimates import (
    FEWEST_BLOCKS,
    BlockEstimate,
    Refused,
    VectorEstimate,
    jackknife_covariance,
)
from microplan.planner.calibration.through_focus.lens_normals import (
    FIRST,
    ROUNDS,
    TRUE,
    LensFit,
    StepNormals,
    fit_lens,
)
from microplan.planner.calibration.through_focus.lens_picture import LensPicture
from microplan.planner.task.lens.check_wavefront import MOST_WAVES

NOLLS = (5, 6, 7, 8, 9, 10, 11)  # astigmatism, coma, trefoil, spherical aberration
_SPHERICAL = 11
_SURE = 0.99865  # that a term is not none, one-sided: 3 normal standard deviations
_BETTER = 0.9  # of the squared error of steps left out that a term must reach
# numbers that images of two makers differ by: a blur in all directions, alike on either
# side of the focus, looks like no aberration, and like no other zero of the focus
_BLUR = (0, 2)  # aperture, scale
_SAMPLED = 0.004  # share of a wavefront by which its sampling in images errs (twins)
_METHOD = "edges through focus against the compiler's images; steps left out in turn"
_TAKE = "the part at nine signed focus readings or more, on both sides of the sharpest"


@dataclass(frozen=True, slots=True, kw_only=True)
class WavefrontTerm:
    """One aberration."""

    noll: int
    waves: BlockEstimate  # rms over the pupil
    better: float  # squared error of steps left out with it, over that without

    @property
    def sureness(self) -> float:
        """Return by how many standard deviations it is not none."""
        return abs(self.waves.value) / (self.waves.sigma or math.inf)

    @property
    def is_told(self) -> bool:
        """Return whether it is sure, and foretells steps that were left out."""
        sigmas = float(special.stdtrit(self.waves.blocks - 1, _SURE))
        return self.sureness > sigmas and self.better < _BETTER


@dataclass(frozen=True, slots=True, kw_only=True)
class WavefrontFit:
    """What pictures tell of a lens with its aberrations."""

    terms: tuple[WavefrontTerm, ...]  # that are told; () if the lens is free of them
    dropped: tuple[WavefrontTerm, ...]
    numbers: VectorEstimate  # aperture, zero um, scale, waves of the terms told


def fit_wavefront(
    pictures: Sequence[LensPicture],
    start: FloatArray,
    nolls: Sequence[int] = NOLLS,
    *,
    rounds: int = ROUNDS,
) -> WavefrontFit | Refused:
    """Return the aberrations that pictures through focus tell.

    Parameters
    ----------
    pictures : sequence of LensPicture
        By their readings, rising, on both sides of the sharpest.
    start : (3,) float array
        Aperture, zero um and scale, to begin with.
    nolls : sequence of int
        The terms that are tried.
    rounds : int
        Of changes of a lens, at most.
    """
    readings = len({picture.z_um for picture in pictures})
    if readings < FEWEST_BLOCKS:
        return _refused(
            f"{readings} focus readings show it, {FEWEST_BLOCKS} are needed"
        )
    begin = np.append(start, np.zeros(len(nolls)))
    fit = fit_lens(pictures, begin, nolls, rounds=rounds)
    dropped: list[WavefrontTerm] = []
    while fit.is_settled:
        kept, out = sorted_terms(fit)
        dropped += out
        if not out:
            return _found(fit, kept, dropped)
        begin = np.append(fit.numbers[:FIRST], [t.waves.value for t in kept])
        left = [t.noll for t in kept]
        fit = fit_lens(pictures, begin, left, rounds=rounds)
    return _refused("no lens suits all pictures")


def _refused(why: str) -> Refused:
    return Refused(what="wavefront", why=why, take=_TAKE)


def _found(
    fit: LensFit, kept: Sequence[WavefrontTerm], dropped: Sequence[WavefrontTerm]
) -> WavefrontFit | Refused:
    """Return what a fit tells, unless it is no lens that shows edges."""
    total = math.hypot(*(abs(t.waves.value) + 2 * (t.waves.sigma or 0.0) for t in kept))
    if total > MOST_WAVES:
        return _refused(f"it would be {total:.2g} waves rms, {MOST_WAVES:g} at most")
    return WavefrontFit(
        terms=tuple(kept),
        dropped=tuple(sorted(dropped, key=lambda term: term.noll)),
        numbers=_estimate(fit, _free(range(len(kept)))),
    )


def sorted_terms(
    fit: LensFit,
) -> tuple[tuple[WavefrontTerm, ...], tuple[WavefrontTerm, ...]]:
    """Return the terms that are told, and the others, the least sure first."""
    left, dropped = list(range(len(fit.nolls))), list[WavefrontTerm]()
    while True:
        terms = [_term(fit, left, index) for index in left]
        doubtful = [term for term in terms if not term.is_told]
        if not doubtful:
            return tuple(terms), tuple(dropped)
        least = min(doubtful, key=lambda term: term.sureness)
        dropped.append(least)
        left.remove(fit.nolls.index(least.noll))


def _term(fit: LensFit, left: Sequence[int], index: int) -> WavefrontTerm:
    """Return one of the terms left by their indices."""
    place = FIRST + list(left).index(index)
    others = _free([k for k in left if k != index])
    error, without = _held_out(fit, _free(left)), _held_out(fit, others)
    return WavefrontTerm(
        noll=fit.nolls[index],
        waves=_estimate(fit, _free(left)).one(place),
        better=error / max(without, 1e-300),
    )


def _free(terms: Sequence[int]) -> list[int]:
    """Return the places of numbers that are not held: the first, and terms'."""
    return [*range(FIRST), *(FIRST + k for k in terms)]


def _change(fit: LensFit, free: Sequence[int], left_out: StepNormals) -> FloatArray:
    """Return what numbers (P,) change by without a step; terms not free go to 0."""
    normal, slope = fit.total
    normal, slope = normal - left_out.normal, slope - left_out.slope
    change = -fit.numbers
    change[free] = 0.0
    some = np.ix_(free, free)
    change[free] = -np.linalg.solve(normal[some], (slope + normal @ change)[free])
    return change


def _held_out(fit: LensFit, free: Sequence[int]) -> float:
    """Return the squared error of steps left out, of what any lens explains."""
    total = 0.0
    for step in fit.steps:
        off = step.slope + step.normal @ _change(fit, free, step)
        total += float(off @ np.linalg.pinv(step.normal, hermitian=True) @ off)
    return total


def _estimate(fit: LensFit, free: Sequence[int]) -> VectorEstimate:
    """Return the free numbers with their deviations."""
    normal, _ = fit.total
    none = StepNormals.none(len(fit.numbers))
    values = (fit.numbers + _change(fit, free, none))[free]
    without = [(fit.numbers + _change(fit, free, step))[free] for step in fit.steps]
    covariance = jackknife_covariance(without)
    if covariance is not None:
        alike = TRUE**2 * fit.pixels * np.linalg.inv(normal[np.ix_(free, free)])
        common, blur = np.zeros_like(alike), np.ix_(_BLUR, _BLUR)
        common[blur] = alike[blur]
        covariance = covariance + common + np.diag(_sampled(fit, values) ** 2)
    return VectorEstimate(
        values=values, covariance=covariance, method=_METHOD, blocks=len(fit.steps)
    )


def _sampled(fit: LensFit, values: FloatArray) -> FloatArray:
    """Return what the pupil's sampling moves numbers (P,) by: terms, and the focus.

    Of spherical aberration what errs looks like focus.
    """
    found = np.zeros(len(values))
    found[FIRST:] = _SAMPLED * values[FIRST:]
    if _SPHERICAL in fit.nolls:
        waves = fit.numbers[FIRST + fit.nolls.index(_SPHERICAL)]
        found[1] = _SAMPLED * fit.wave_um * waves
    return found
