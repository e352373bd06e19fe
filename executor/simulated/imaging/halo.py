"""Halo of the cell's lens: a share of the finished light, spread by a Gaussian."""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.simulated.imaging.imaging_view import ImagingView, PixelWindow

REACH = 3.5  # sigmas: 5e-4 of the halo's light is beyond, on each axis
LEAST_PX = 4  # and what a Gaussian below a pixel rings


def halo_px(view: ImagingView) -> int:
    """Return how far beyond a window its halo comes from, px; 0: there is none."""
    halo = view.halo
    if not halo.radius_um * halo.share:
        return 0
    return LEAST_PX + math.ceil(REACH * halo.radius_um * view.px_per_um)


def halo_window(view: ImagingView, window: PixelWindow) -> PixelWindow:
    """Return what a picture of a window needs of the light: the window and a skirt."""
    skirt = halo_px(view)
    return PixelWindow(
        row=window.row - skirt,
        column=window.column - skirt,
        rows=window.rows + 2 * skirt,
        columns=window.columns + 2 * skirt,
    )


def with_halo(light: FloatArray, view: ImagingView) -> FloatArray:
    """Return light (rows, columns) with its halo, less `halo_px` at each side.

    The halo is as wide all over the field and as bright from any body: by the scale in
    focus, without distortion. What comes from beyond the skirt is taken from within.
    """
    skirt, sigma = halo_px(view), view.halo.radius_um * view.px_per_um
    if not skirt:
        return light
    down, across = np.fft.fftfreq(light.shape[0]), np.fft.rfftfreq(light.shape[1])
    veil = np.exp(-2 * (math.pi * sigma) ** 2 * (down[:, None] ** 2 + across**2))
    share = view.halo.share
    seen = np.fft.irfft2(
        np.fft.rfft2(light) * (1 - share + share * veil), s=light.shape
    )
    return seen[skirt:-skirt, skirt:-skirt]
