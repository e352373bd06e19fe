"""The Cramer-Rao limit of a position: Fisher information, in all or by pixel.

`docs/limits.md` says what it is blind to and what it takes for granted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import log_ndtr, ndtr

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.limits.information import Information, limit
from microplan.featuresel.look.camera_noise import camera_noise
from microplan.featuresel.look.nominal import displacement_changes
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.sensitivity import Sensitivities, sensitivities
from microplan.featuresel.routines.contract import CameraNoise
from microplan.featuresel.routines.likelihood.foreground import principal

_MODE = "sway_"  # begins the names of occluder modes


def limit_um(case: LookCase) -> float | None:
    """Return the Cramer-Rao limit of a look's position, the worse axis, as planned.

    What the trials vary is unknown to the estimator too: angle, focus, zoom, light, and
    within its standard deviation where the occluder is, and how it is turned.
    """
    worse = max(place_limits_um(case))
    return worse if worse < float("inf") else None


def place_limits_um(case: LookCase) -> tuple[float, float]:
    """Return the Cramer-Rao limits of a look's position in x and y, see `limit_um`."""
    seen = _with_modes(case, sensitivities(case, names=unknowns(case)))
    occluder_modes = [name for name in seen.names if name.startswith(_MODE)]
    found = fisher(seen, camera_of(case)).with_prior(dict.fromkeys(occluder_modes, 1.0))
    known = limit(found)
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


_FAR = 38.0  # sigmas beyond which a normal density is 0 in double precision
_NOTHING = 1e-12  # of a pixel's information in mid-scale: rounding of 0


def camera_of(case: LookCase) -> CameraNoise:
    """Return a look's noise; a sensor's gain makes full scale a part of its well."""
    return camera_noise(case.sensor, case.microscope.fill_factor)


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
    bottom = half
    if camera.table is not None:
        bottom, top = camera.floor or -math.inf, min(ceiling, camera.ceiling)
    low = np.clip((bottom - mean) / sigma, -_FAR, _FAR)
    high = np.clip((top - mean) / sigma, -_FAR, _FAR)
    inside = ndtr(high) - ndtr(low) - (high * _normal(high) - low * _normal(low))
    left = inside + _cut(low) + _cut(-high)
    seen = (mean > 0) & (left > _NOTHING)
    found: FloatArray = np.where(seen, np.minimum(left, 1.0) / variance, 0.0)
    return found


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
    slopes, errors = pixel_scores(seen, camera, mask)
    return summed(seen.names, slopes, errors)


def pixel_scores(
    seen: Sensitivities, camera: CameraNoise, mask: BoolArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return slopes and their errors over the pixels' noise, (P, N), per um etc."""
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


def summed(
    names: tuple[str, ...], slopes: FloatArray, errors: FloatArray
) -> Information:
    """Return the pixels' information by slopes and errors over noise, (P, N) per um."""
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
