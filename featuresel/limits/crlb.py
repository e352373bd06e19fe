"""The Cramer-Rao limit of a position: Fisher information, in all or by pixel.

`docs/limits.md` says what it is blind to and what it takes for granted.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.special import log_ndtr, ndtr

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.limits.information import (
    Information,
    covariance,
    inverse,
    limit,
    places,
)
from microplan.featuresel.look.nominal import displacement_changes
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.sensitivity import Sensitivities, sensitivities
from microplan.featuresel.routines.contract import CameraNoise
from microplan.featuresel.routines.likelihood.foreground import principal

_MODE = "sway_"  # begins the names of occluder modes


def limit_um(case: LookCase) -> float | None:
    """Return the Cramer-Rao limit of a look's place, the worse axis, as planned.

    What the trials vary is unknown to the estimator too: angle, focus, zoom, light, and
    within its spread where the occluder is, and how it is turned.
    """
    worse = max(place_limits_um(case))
    return worse if worse < float("inf") else None


def place_limits_um(case: LookCase) -> tuple[float, float]:
    """Return the Cramer-Rao limits of a look's place in x and y, see `limit_um`."""
    seen = _with_modes(case, sensitivities(case, names=unknowns(case)))
    occluder_modes = [name for name in seen.names if name.startswith(_MODE)]
    told = fisher(seen, camera_of(case)).with_prior(dict.fromkeys(occluder_modes, 1.0))
    known = limit(told)
    return known["x"], known["y"]


def unknowns(case: LookCase) -> Sequence[str]:
    """Return what an estimator must find besides the position, by the limit's names."""
    spread, names = case.spread, ["x", "y"]
    if case.target.kind != "circle":
        names.append("theta")
    if spread.focus_sigma_um > 0:
        names.append("z")
    if spread.magnification_sigma > 0:
        names.append("zoom")
    names.append("gain")
    if spread.light_gradient[1] > 0:
        names += ["gradient_x", "gradient_y"]
    return names


def _with_modes(case: LookCase, seen: Sensitivities) -> Sensitivities:
    """Return slopes by the occluders too, each over one standard deviation."""
    changes = case.sensor.gain * displacement_changes(case)
    if len(changes) == 0:
        return seen
    noise = np.sqrt(camera_of(case).variance(seen.mean))
    occluder_modes = np.tensordot(principal(changes / noise), changes, 1)
    return replace(
        seen,
        names=(*seen.names, *(f"{_MODE}{k}" for k in range(len(occluder_modes)))),
        slopes=np.concatenate((seen.slopes, occluder_modes)),
        errors=np.concatenate((seen.errors, np.zeros_like(occluder_modes))),
    )


IndexArray = npt.NDArray[np.intp]

_FAR = 38.0  # sigmas beyond which a normal density is 0 in double precision
_NOTHING = 1e-12  # of a pixel's information in mid-scale: rounding of 0
_ROUNDS = 2  # of choosing pixels: a third takes none off a gear's


def camera_of(case: LookCase) -> CameraNoise:
    """Return a look's noise; a sensor's gain makes full scale a part of its well."""
    sensor = case.sensor
    return CameraNoise(
        full_well_e=sensor.full_well_e / sensor.gain,
        read_noise_e=sensor.read_noise_e,
        bits=sensor.bits,
        fill_factor=case.microscope.fill_factor,
    )


def weights(
    mean: FloatArray, camera: CameraNoise, *, ceiling: float = 1.0
) -> FloatArray:
    """Return the information of each pixel about its own mean.

    Parameters
    ----------
    mean : (...) float array
        Share of full scale, not clipped.
    camera : CameraNoise
        Its noise.
    ceiling : float
        Where the well is full, at most 1.

    Returns
    -------
    (...) float64 array
        Fisher information per full scale squared: one over the variance, times the
        share that is left of a normal value which is cut off at both ends of the
        scale. 0 where there is no light.

    Notes
    -----
    For shot noise 1 / variance is all there is: a Poisson count of mean n tells 1 / n.
    The term that a normal density of varying width would add, 1 / (2 n**2), is not in
    it, nor in the likelihood that routines maximise.
    """
    variance = camera.variance(mean)
    sigma = np.sqrt(variance)
    half = 0.5 / (2**camera.bits - 1)  # counts are rounded
    top = ceiling - half if ceiling >= 1 else ceiling
    low = np.clip((half - mean) / sigma, -_FAR, _FAR)
    high = np.clip((top - mean) / sigma, -_FAR, _FAR)
    inside = ndtr(high) - ndtr(low) - (high * _normal(high) - low * _normal(low))
    left = inside + _cut(low) + _cut(-high)
    seen = (mean > 0) & (left > _NOTHING)
    told: FloatArray = np.where(seen, np.minimum(left, 1.0) / variance, 0.0)
    return told


def fisher(
    seen: Sensitivities, camera: CameraNoise, *, mask: BoolArray | None = None
) -> Information:
    """Return the information of one image.

    Parameters
    ----------
    seen : Sensitivities
        The mean image and its slopes.
    camera : CameraNoise
        The noise, by `camera_of`.
    mask : (rows, columns) bool array, optional
        Which pixels count. Default: all.

    Raises
    ------
    ValueError
        If the mask does not fit the image.
    """
    slopes, errors = _scores(seen, camera, mask)
    return _summed(seen.names, slopes, errors)


def density(
    seen: Sensitivities, camera: CameraNoise, *, mask: BoolArray | None = None
) -> FloatArray:
    """Return each pixel's part of the information, (P, rows, columns).

    Of each parameter after all others are projected out, so that a parameter's sum is
    1 / limit**2; 0 for one that is not observable. Arguments as in `fisher`.
    """
    slopes, errors = _scores(seen, camera, mask)
    found, lost = inverse(_summed(seen.names, slopes, errors))
    influence = found @ slopes
    variance = np.where(lost, math.inf, np.diag(found))
    shares: FloatArray = (influence / variance[:, None]) ** 2
    return shares.reshape(seen.slopes.shape)


def informative(
    seen: Sensitivities,
    camera: CameraNoise,
    wanted: Collection[str],
    *,
    share: float = 0.98,
    mask: BoolArray | None = None,
) -> BoolArray:
    """Return few pixels that tell nearly as much as all, (rows, columns).

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
    slopes, errors = _scores(seen, camera, mask)
    known = _summed(seen.names, slopes, errors)
    variances, at = np.diag(covariance(known)), places(seen.names, wanted)
    at = [k for k in at if variances[k] < math.inf]
    goal = variances[at] / share * (1 + 1e-12)

    def told(taken: IndexArray) -> Information:
        return _summed(seen.names, slopes[:, taken], errors[:, taken])

    best: IndexArray = np.arange(seen.mean.size if at else 0)
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


def _scores(
    seen: Sensitivities, camera: CameraNoise, mask: BoolArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return slopes and their errors over the pixels' noise, (P, N) each."""
    weight = weights(seen.mean, camera, ceiling=seen.ceiling)
    if mask is not None:
        if mask.shape != weight.shape:
            raise ValueError(f"mask must be {weight.shape}, got {mask.shape}")
        weight = np.where(mask, weight, 0.0)
    root = np.sqrt(weight).ravel()
    count = len(seen.names)
    return (
        seen.slopes.reshape(count, -1) * root,
        seen.errors.reshape(count, -1) * root,
    )


def _summed(
    names: tuple[str, ...], slopes: FloatArray, errors: FloatArray
) -> Information:
    """Return the pixels' information, from slopes and errors over noise, (P, N)."""
    return Information(
        names=names, matrix=slopes @ slopes.T, faked=(errors**2).sum(axis=1)
    )


def _normal(t: FloatArray) -> FloatArray:
    """Return the density of the normal distribution."""
    found: FloatArray = np.exp(-(t**2) / 2) / math.sqrt(2 * math.pi)
    return found


def _cut(t: FloatArray) -> FloatArray:
    """Return the information in a normal value's lying below t: density**2 / share."""
    found: FloatArray = np.exp(-(t**2) - log_ndtr(t)) / (2 * math.pi)
    return found
