"""Normal equations of pictures through focus for the numbers of a lens."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Self

import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.calibration.through_focus.lens_picture import (
    LensPicture,
    TriedLens,
)

FIRST = 3  # numbers before the terms: aperture, zero um, scale
# of aperture, um, scale and waves: small against a depth of field, large against what
# images jump by from one sampling of the pupil to the next
_CHANGES, _WAVES = (4e-3, 0.1, 0.01), 4e-3
_PRIOR = 0.1  # waves rms: of a term that edges do not show little is found
_ANY = 10.0  # aperture, um or scale: such a prior only lets equations have a solution
_LEAST = 1e-12  # of the variance
_MOST_PX = 2.0  # that a part is moved by at once
_MOST_WAVES = 0.2  # of one term
ROUNDS = 9
_WAVE = 4 * math.sqrt(3)  # depths of field to a wave rms of paraxial defocus, Noll's
_STILL = 0.7  # standard deviations of noise and `TRUE`: the rest is as good as linear
# rms of an edge's step by which exact images of two makers differ in ways that look
# like another lens (twins); the compiler's jump by as much from band to band
TRUE = 2e-5
_OTHER = 0.5  # of aperture and scale by edges' profiles, which aberrations mislead


@dataclass(frozen=True, slots=True, kw_only=True)
class StepNormals:
    """Sums of the pictures at one focus reading; light is in edges' steps.

    The misfit's square is `square` + 2 `slope` d + d `normal` d for changes d (P,) of
    the numbers.
    """

    normal: FloatArray  # (P, P)
    slope: FloatArray  # (P,)
    square: float
    count: int  # pixels

    @classmethod
    def none(cls, numbers: int) -> Self:
        """Return the sums of no picture for so many numbers."""
        zero = np.zeros(numbers)
        return cls(normal=np.diag(zero), slope=zero, square=0.0, count=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class LensFit:
    """Numbers of a lens that suit pictures best, and the sums about them."""

    nolls: tuple[int, ...]
    numbers: FloatArray  # (P,) aperture, zero um, scale, waves rms
    steps: tuple[StepNormals, ...]
    wave_um: float  # focus that is a wave rms
    is_settled: bool = True  # no number changes any more

    @property
    def pixels(self) -> int:
        """Return how many pixels were fitted."""
        return sum(step.count for step in self.steps)

    @property
    def variance(self) -> float:
        """Return the mean square of a pixel's misfit, in edges' steps."""
        return sum(step.square for step in self.steps) / self.pixels

    @property
    def total(self) -> tuple[FloatArray, FloatArray]:
        """Return normal matrix (P, P) and slope (P,) of all pictures and the prior.

        The prior keeps terms small that edges do not show.
        """
        weights = np.full(len(self.numbers), max(self.variance, _LEAST) / _ANY**2)
        weights[FIRST:] *= (_ANY / _PRIOR) ** 2
        normal = np.sum([step.normal for step in self.steps], axis=0)
        slope = np.sum([step.slope for step in self.steps], axis=0)
        return normal + np.diag(weights), slope + weights * self.numbers


def lens_of(numbers: FloatArray, nolls: Sequence[int]) -> TriedLens:
    """Return the lens of numbers (P,): aperture, zero um, scale, waves rms."""
    aperture, zero_um, scale, *waves = numbers.tolist()
    terms = tuple(zip(nolls, waves, strict=True))
    return TriedLens(aperture=aperture, zero_um=zero_um, scale=scale, terms=terms)


def fit_lens(
    pictures: Sequence[LensPicture],
    start: FloatArray,
    nolls: Sequence[int],
    *,
    rounds: int = ROUNDS,
) -> LensFit:
    """Return the numbers of a lens that suit pictures best.

    Parameters
    ----------
    pictures : sequence of LensPicture
        In the order of readings.
    start : (P,) float array
        Aperture, zero um, scale, waves rms of each term, to begin with.
    nolls : sequence of int
        The terms.
    rounds : int
        Of changes, at most.
    """
    numbers, shots = start.astype(np.float64), list(pictures)
    for _ in range(rounds):
        shots = [_placed(each, lens_of(numbers, nolls)) for each in shots]
        steps = tuple(_by_step(shots, numbers, nolls))
        fit = LensFit(
            nolls=tuple(nolls), numbers=numbers, steps=steps,
            wave_um=_WAVE * shots[0].depth_um,
        )  # fmt: skip
        normal, slope = fit.total
        change = -np.linalg.solve(normal, slope)
        if -change @ slope < _STILL**2 * (fit.variance + TRUE**2 * fit.pixels):
            return fit
        numbers = _within(numbers + change, start)
    return replace(fit, is_settled=False)


def _within(numbers: FloatArray, start: FloatArray) -> FloatArray:
    """Return numbers (P,) no farther from a start (P,) than images are made for."""
    around = np.array([_OTHER * start[0], np.inf, _OTHER * start[2]])
    low = np.append(start[:FIRST] - around, np.full(len(start) - FIRST, -_MOST_WAVES))
    high = np.append(start[:FIRST] + around, np.full(len(start) - FIRST, _MOST_WAVES))
    return np.clip(numbers, low, high)


def _placed(picture: LensPicture, lens: TriedLens) -> LensPicture:
    """Return a picture with its part where it is seen."""
    image = picture.image(lens)
    light, right, down = np.linalg.lstsq(
        picture.design(image), picture.shown[picture.used], rcond=None
    )[0][:3].tolist()
    if light <= 0:
        return picture
    by = np.clip([-right / light, -down / light], -_MOST_PX, _MOST_PX)
    return picture.moved(float(by[0]), float(by[1]))


def _by_step(
    shots: Sequence[LensPicture], numbers: FloatArray, nolls: Sequence[int]
) -> Iterator[StepNormals]:
    """Yield the sums of each reading's pictures."""
    for _, group in groupby(shots, lambda shot: shot.z_um):
        held = list(group)
        slopes = _slopes(held[0], numbers, nolls)
        sums = [
            _normals(
                shot,
                lens_of(numbers, nolls),
                slopes if shot.is_alike(held[0]) else _slopes(shot, numbers, nolls),
            )
            for shot in held
        ]
        yield StepNormals(
            normal=np.sum([each.normal for each in sums], axis=0),
            slope=np.sum([each.slope for each in sums], axis=0),
            square=sum(each.square for each in sums),
            count=sum(each.count for each in sums),
        )


def _slopes(
    picture: LensPicture, numbers: FloatArray, nolls: Sequence[int]
) -> FloatArray:
    """Return an image's changes by each number, (P, rows, columns)."""
    image = picture.image(lens_of(numbers, nolls))
    found = np.empty((len(numbers), *image.shape))
    for k, by in enumerate((*_CHANGES, *(_WAVES for _ in nolls))):
        other = numbers.copy()
        other[k] += by
        found[k] = (picture.image(lens_of(other, nolls)) - image) / by
    return found


def _normals(picture: LensPicture, lens: TriedLens, slopes: FloatArray) -> StepNormals:
    """Return the sums of one picture by slopes (P, rows, columns) of its image.

    What else changes it is taken off.
    """
    image = picture.image(lens)
    design, shown = picture.design(image), picture.shown[picture.used]
    basis = np.linalg.qr(design)[0]
    light = float(np.linalg.lstsq(design, shown, rcond=None)[0][0])
    step = max(abs(light) * float(np.ptp(image)), 1e-9)
    jacobian = _left(slopes[:, picture.used].T * (-light / step), basis)
    misfit = _left(shown / step, basis)
    return StepNormals(
        normal=jacobian.T @ jacobian,
        slope=jacobian.T @ misfit,
        square=float(misfit @ misfit),
        count=len(misfit),
    )


def _left(values: FloatArray, basis: FloatArray) -> FloatArray:
    """Return values (N, ...) less their part in a basis (N, K)."""
    found: FloatArray = values - basis @ (basis.T @ values)
    return found
