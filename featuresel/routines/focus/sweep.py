"""The cheapest focus sweep that measures a height as surely as is wanted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines.contract import CameraNoise, Failure
from microplan.featuresel.routines.focus.measures import Measure
from microplan.featuresel.routines.focus.peak import mirror_error_um, mirror_peak

# Variance of the mirror fit over noise^2 x step x width for s = 1 / (1 + x^2), which is
# what a squared gradient looks like, its half height at x = 1 = sqrt(2 ln 2) widths:
# sqrt(2 ln 2) (4/3) / 2 / (pi/2 - 1)^2. Fisher's information of the same half: 2.10.
_VARIANCE = 2.409
_BEYOND = 2.0  # widths swept past the expected range: the half height is well inside
_COARSEST = 1.0  # widths from stop to stop, the most that the mirror's error holds for
_FINEST = 0.1  # widths: below it more frames do as well as more stops
_FRAMES = 1000  # at one stop, the most that are planned


@dataclass(frozen=True, slots=True, kw_only=True)
class FocusCurve:
    """What a sweep is planned by."""

    width_um: float  # standard deviation of a Gaussian as wide as the peak
    noise: float  # standard deviation of a score over the peak's height


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """Stops of a sweep and images averaged at each, by their scores."""

    focus_um: tuple[float, ...]
    frames: int
    sigma_um: float  # predicted standard deviation of the height

    @property
    def images(self) -> int:
        """Return how many images it takes."""
        return len(self.focus_um) * self.frames


def focus_curve(
    z_um: Sequence[float],
    images: FloatArray,
    measure: Measure,
    camera: CameraNoise,
    rng: np.random.Generator,
    *,
    mask: BoolArray | None = None,
    draws: int = 16,
) -> FocusCurve | Failure:
    """Return a measure's width and noise on a look.

    Parameters
    ----------
    z_um : (N,) sequence of float
        Stops, strictly rising.
    images : (N, rows, columns) float array
        Without noise, 0..1 of full scale.
    measure : Measure
        One of `microplan.featuresel.routines.focus.measures`.
    camera : CameraNoise
        Its noise.
    rng : numpy.random.Generator
        Source of the noise.
    mask : (rows, columns) bool array, optional
        Pixels that count.
    draws : int
        Noisy images a stop, at least 2; the noise is known to one part in
        sqrt(2 draws stops).

    Returns
    -------
    FocusCurve or Failure
        The noise is the rms over the stops of the upper half. Failures are those of
        `mirror_peak`.
    """
    scores = np.array([measure(image, mask) for image in images])
    found = mirror_peak(z_um, scores)
    if isinstance(found, Failure):
        return found
    height = float(np.ptp(scores))
    variances = [
        np.var(
            [measure(_noisy(image, camera, rng), mask) for _ in range(draws)], ddof=1
        )
        for image in images[scores >= float(scores.min()) + height / 2]
    ]
    return FocusCurve(
        width_um=found.width_um, noise=math.sqrt(float(np.mean(variances))) / height
    )


def sweep_sigma_um(curve: FocusCurve, step_um: float, frames: int) -> float:
    """Return the predicted standard deviation of a height by the mirror fit.

    Scores with a noise n of the peak's height, h apart, tell z with a variance of
    2.409 n^2 w h for a squared gradient's peak w wide: level, height and width do not
    mix with z, being even in it. To that comes what stops h apart leave undrawn.
    """
    noise = curve.noise / math.sqrt(frames)
    noise_term = noise * math.sqrt(_VARIANCE * curve.width_um * step_um)
    return math.hypot(noise_term, mirror_error_um(step_um, curve.width_um))


def plan_sweep(
    curve: FocusCurve,
    *,
    expected_um: float,
    within_um: float,
    sigma_um: float,
    move_frames: float = 1.0,
) -> Sweep | Failure:
    """Return the cheapest sweep that measures a height with `sigma_um`.

    Parameters
    ----------
    curve : FocusCurve
        From `focus_curve`.
    expected_um, within_um : float
        The height is within this of where it is expected.
    sigma_um : float
        One standard deviation wanted of the measured height.
    move_frames : float
        What a move to the next stop costs, in frames.

    Returns
    -------
    Sweep or Failure
        Stops are evenly spaced. Fails with "too_noisy" if no step and number of frames
        reaches `sigma_um`.

    Raises
    ------
    ValueError
        If a length or the noise is not positive or a cost is negative.
    """
    for name, value in (("sigma_um", sigma_um), ("width_um", curve.width_um)):
        if not (value > 0 and math.isfinite(value)):
            raise ValueError(f"{name} must be positive, got {value}")
    if not (within_um >= 0 and curve.noise >= 0 and move_frames >= 0):
        raise ValueError("within_um, noise and move_frames must not be negative")
    span_um = 2 * (within_um + _BEYOND * curve.width_um)
    fewest = math.ceil(span_um / (_COARSEST * curve.width_um))
    most = max(math.ceil(span_um / (_FINEST * curve.width_um)), fewest)
    best: tuple[float, int, int] | None = None
    for gaps in range(fewest, most + 1):
        frames = _frames(curve, span_um / gaps, sigma_um)
        if frames is None:
            continue
        cost = (gaps + 1) * (move_frames + frames)
        if best is None or cost < best[0]:
            best = cost, gaps, frames
    if best is None:
        return Failure(
            "too_noisy", f"{_FRAMES} frames a stop do not reach {sigma_um:.4g} um"
        )
    _, gaps, frames = best
    low = expected_um - span_um / 2
    return Sweep(
        focus_um=tuple(low + span_um * i / gaps for i in range(gaps + 1)),
        frames=frames,
        sigma_um=sweep_sigma_um(curve, span_um / gaps, frames),
    )


def _frames(curve: FocusCurve, step_um: float, sigma_um: float) -> int | None:
    """Return the fewest frames a stop that reach `sigma_um`, None if none do."""
    rest = sigma_um**2 - mirror_error_um(step_um, curve.width_um) ** 2
    if rest <= 0:
        return None
    noise_term = _VARIANCE * curve.noise**2 * curve.width_um * step_um
    frames = max(1, math.ceil(noise_term / rest))
    return frames if frames <= _FRAMES else None


def _noisy(
    image: FloatArray, camera: CameraNoise, rng: np.random.Generator
) -> FloatArray:
    """Return one noisy image."""
    spread = np.sqrt(camera.noise_variance(image))  # what frames average
    noisy: FloatArray = image + spread * rng.standard_normal(image.shape)
    return noisy
