"""A lens learned from pictures of a point, and a point's height from one picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, optimize

from microplan.arrays import FloatArray
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import tabulate
from microplan.optics.transfer.wavefront import transfer_change
from validation.point_source.series import (
    APERTURE,
    INDEX,
    STEP_UM,
    UM_PER_PX,
    WAVELENGTH_UM,
)

# Astigmatism, coma, trefoil, and spherical aberration of two orders, by Noll's indices.
TERMS = (5, 6, 7, 8, 9, 10, 11, 22)
_PERIOD = 2  # pictures a side that a point's image is periodic in: it ends within
_MODELLED = 0.03  # of the peak: what a picture's model errs by, as a workcell's default
_ROUNDS = 3  # of moving an image to where the point lies
_SCALES = (0.02, 0.1, *(0.02 for _ in TERMS))  # aperture, focus, waves rms


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedLens:
    """A lens, and which place in the series is in focus."""

    lens: Microscope
    focus_um: float  # height of the point in plane 0, less that of the plane in focus


def stated_lens() -> Microscope:
    """Return the lens as the file's name has it, before anything is learned of it."""
    return Microscope(
        aperture=APERTURE,
        wavelength_um=WAVELENGTH_UM,
        medium_index=INDEX,
        magnification=1.0,
        pitch_um=UM_PER_PX,
        width_px=64,
        height_px=64,
    )


def point_image(lens: Microscope, z_um: float, at_px: FloatArray) -> FloatArray:
    """Return a point's image, (rows, columns), of sum 1 over all it reaches.

    Parameters
    ----------
    z_um : float
        Height of the point over the plane in focus.
    at_px : (2,) float64 array
        Its place, columns and rows from the middle pixel.
    """
    rows, columns = lens.height_px, lens.width_px
    tall, wide = _PERIOD * rows, _PERIOD * columns
    across, up = fft.rfftfreq(wide, lens.um_per_px), -fft.fftfreq(tall, lens.um_per_px)
    u, v = across[None, :], up[:, None]
    x = np.minimum(np.hypot(u, v) / lens.cutoff_per_um, 1.0)
    table = tabulate("exact", replace(lens, wavefront=()), abs(z_um))
    seen = np.where(x < 1, table.read(x), 0.0) + transfer_change(lens, z_um, across, up)
    seen = seen * np.sinc(u * lens.um_per_px) * np.sinc(v * lens.um_per_px)
    x_um, y_um = (at_px + (columns // 2, rows // 2)) * lens.um_per_px
    seen = seen * np.exp(-2j * np.pi * (u * x_um - v * y_um))
    found: FloatArray = fft.irfft2(seen, (tall, wide))[:rows, :columns]
    return found


def misfit(
    picture: FloatArray, lens: Microscope, z_um: float, noise_counts: float
) -> FloatArray:
    """Return a picture less a point's image that fits it best, over its spread.

    Parameters
    ----------
    picture : (rows, columns) float64 array
        Counts. Place, light and a level are free.
    z_um : float
        Height of the point over the plane in focus.
    noise_counts : float
        Standard deviation of a count in the dark.

    Returns
    -------
    (rows columns,) float64 array
        In standard deviations [1].
    """
    weight = 1 / np.hypot(noise_counts, _MODELLED * picture.max())
    at_px, rest = np.zeros(2), picture
    for _ in range(_ROUNDS):
        image, across, down = _with_slopes(lens, z_um, at_px)
        columns = np.stack([image, across, down, np.ones_like(image)], axis=-1)
        known = columns.reshape(-1, 4)
        free, *_ = np.linalg.lstsq(known, picture.ravel())
        rest = picture.ravel() - known @ free
        if free[0] > 0:
            at_px = at_px + np.clip(free[1:3] / free[0], -1.0, 1.0)
    return np.asarray(rest * weight)


def _with_slopes(
    lens: Microscope, z_um: float, at_px: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a point's image and its slopes by the point's place, a pixel."""
    image = point_image(lens, z_um, at_px)
    down, across = np.gradient(image)
    return image, np.negative(across), np.negative(down)


def learned(planes: Mapping[int, FloatArray], noise_counts: float) -> LearnedLens:
    """Return the lens whose images of a point fit pictures at known steps best.

    Parameters
    ----------
    planes : mapping of int to (rows, columns) float array
        Pictures by their number in the series.
    noise_counts : float
        Standard deviation of a count in the dark.
    """

    def rest(numbers: FloatArray) -> FloatArray:
        found = _of(numbers)
        return np.concatenate(
            [
                misfit(each, found.lens, height_um(found, plane), noise_counts)
                for plane, each in planes.items()
            ]
        )

    middle_um = STEP_UM * max(planes, key=lambda plane: float(planes[plane].max()))
    start = np.array([stated_lens().aperture, -middle_um, *(0.0 for _ in TERMS)])
    fit = optimize.least_squares(rest, start, x_scale=_SCALES, xtol=1e-4, ftol=1e-4)
    return _of(fit.x)


def _of(numbers: FloatArray) -> LearnedLens:
    aperture, focus_um, *waves = numbers.tolist()
    terms = tuple(zip(TERMS, waves, strict=True))
    lens = replace(stated_lens(), aperture=aperture, wavefront=terms)
    return LearnedLens(lens=lens, focus_um=focus_um)


def height_um(lens: LearnedLens, plane: int) -> float:
    """Return the height of the point over the plane in focus, um."""
    return lens.focus_um + STEP_UM * plane


def found_height_um(
    picture: FloatArray, lens: Microscope, noise_counts: float, heights: FloatArray
) -> float:
    """Return the height among some at which a picture's misfit is least, um.

    Parameters
    ----------
    picture : (rows, columns) float64 array
        Counts.
    noise_counts : float
        Standard deviation of a count in the dark.
    heights : (N,) float64 array
        Of the point over the plane in focus, um.
    """
    costs = [
        float((misfit(picture, lens, z_um, noise_counts) ** 2).sum())
        for z_um in heights.tolist()
    ]
    return float(heights[int(np.argmin(costs))])
