"""Wavefront error of the cell's lens: Zernike terms, and where it shows discs.

A flat plane is blurred by the whole pupil, in and out of focus. What is approximated:
the terms are the same all over the field and at each zoom; what light from one
direction has more than the mean of all passes by as a ray of geometry, and beside
bodies that both the plane and the focus cut it is blurred as in focus instead; a plane
more than 60 um out of focus is rays alone. Scalar, incoherent light.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.simulated.imaging.imaging_view import ImagingView

SIDE = 192  # samples across the pupil: the disc's place is right to 1e-4 um
DIRECTIONS = 16  # of a disc's edge: terms to Noll 22 turn 5 times at most
HALVINGS = 40  # of twice wavelength / A: below a double's rounding
ASIDE = 1e-4  # of the pupil's radius, for slopes


def zernike(noll: int, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return a Zernike polynomial of rms 1 over the unit disc, (...).

    `x`, `y` : (...) float arrays, shares of the pupil's radius, x right and y up.

    References
    ----------
    Noll (1976), J. Opt. Soc. Am. 66, 207, eqs. (1) and (2): even numbers are cosines.
    r**m cos(m theta) and r**m sin(m theta) are those of (x + i y)**m.
    """
    if noll < 1:
        raise ValueError(f"the first Zernike polynomial is 1, got {noll}")
    n = math.ceil((math.sqrt(8 * noll + 1) - 3) / 2)
    k = noll - n * (n + 1) // 2 - 1  # 0 to n, in its order
    m = 2 * (k // 2) + 1 if n % 2 else 2 * ((k + 1) // 2)
    square, radial = x * x + y * y, np.zeros(np.shape(x))
    for s in range((n - m) // 2 + 1):  # by Horner, highest power first
        share = math.comb(n - s, s) * math.comb(n - 2 * s, (n - m) // 2 - s)
        radial = radial * square + (-1) ** s * share
    if m == 0:
        return math.sqrt(n + 1) * radial
    turning = (x + 1j * y) ** m
    wave: FloatArray = turning.imag if noll % 2 else turning.real
    return math.sqrt(2 * (n + 1)) * radial * wave


def lens_waves(view: ImagingView, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the wavefront error W over the pupil, (...) wavelengths.

    With the tilt by which a large disc in focus is shown where it is: a camera is
    calibrated by edges in focus.

    Parameters
    ----------
    view : ImagingView
        Its terms; aperture, wavelength and pixels say where discs are shown.
    x, y : (...) float arrays
        Spatial frequency times wavelength / A of the field that leaves the object:
        shares of the pupil's radius.
    """
    aside_x, aside_y = disc_um(view)
    tilt = view.aperture / view.wavelength_um
    return _sum(view.wavefront, x, y) + tilt * (aside_x * x + aside_y * y)


def ray_shifts(view: ImagingView, slopes: FloatArray) -> FloatArray | None:
    """Return how far aside of where it is seen a ray meets the focus, (N, 2) um.

    By geometry, lambda / A times the gradient of W; None without terms.

    Parameters
    ----------
    view : ImagingView
        The lens.
    slopes : (N, 2) float array
        Of rays on their way down, um per um: light goes the other way.
    """
    if not view.wavefront:
        return None
    sine = slopes / np.sqrt(1 + (slopes**2).sum(axis=1, keepdims=True))
    x, y = -(view.medium_index / view.aperture * sine).T
    steps = ((ASIDE, 0.0), (0.0, ASIDE))
    rises = [
        lens_waves(view, x + u, y + v) - lens_waves(view, x - u, y - v)
        for u, v in steps
    ]
    scale = view.wavelength_um / view.aperture / (2 * ASIDE)
    shifts: FloatArray = scale * np.transpose(rises)
    return shifts


def disc_um(view: ImagingView) -> tuple[float, float]:
    """Return where the terms alone would show the middle of a large disc in focus."""
    return _disc_um(
        view.wavefront,
        view.wavelength_um / view.aperture,
        math.sqrt(view.fill_factor) / view.px_per_um,
    )


@lru_cache(maxsize=64)
def _disc_um(
    terms: tuple[tuple[int, float], ...], unit_um: float, side_um: float
) -> tuple[float, float]:
    """Return it for pixels of a side, and wavelength / A: a circle through its edge."""
    angles = 2 * math.pi / DIRECTIONS * np.arange(DIRECTIONS)
    moved = np.array([_edge_um(terms, unit_um, side_um, angle) for angle in angles])
    x, y = (2 * np.mean(moved * f(angles)) for f in (np.cos, np.sin))
    return float(x), float(y)


def _edge_um(
    terms: tuple[tuple[int, float], ...], unit_um: float, side_um: float, angle: float
) -> float:
    """Return where half the step of an edge in focus is seen, along its normal."""
    at = (2 * np.arange(SIDE) + 1.0) / SIDE - 1
    x, y = np.meshgrid(at, at)
    c, s = math.cos(angle), math.sin(angle)
    waves = _sum(terms, c * x - s * y, s * x + c * y)  # the edge's normal along x
    pupil = (x * x + y * y < 1) * np.exp(2j * math.pi * waves)
    power = np.abs(np.fft.fft(pupil, 2 * SIDE, axis=1)) ** 2
    overlap = np.fft.ifft(power.sum(axis=0))[:SIDE]
    f = 2 / (SIDE * unit_um) * np.arange(SIDE)  # per um
    seen = (
        overlap / overlap[0].real * np.sinc(c * f * side_um) * np.sinc(s * f * side_um)
    )
    f, seen = f[1:], seen[1:] / f[1:]

    def above(at_um: float) -> bool:
        wave = np.exp(2j * math.pi * at_um * f)
        return bool((seen * wave).imag.sum() + math.pi * at_um > 0)

    low, high = -2 * unit_um, 2 * unit_um
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if above(middle) else (middle, high)
    return (low + high) / 2


def _sum(
    terms: tuple[tuple[int, float], ...], x: FloatArray, y: FloatArray
) -> FloatArray:
    """Return a sum of terms, (...) wavelengths."""
    total = np.zeros(np.shape(x))
    for noll, waves in terms:
        total = total + waves * zernike(noll, x, y)
    return total
