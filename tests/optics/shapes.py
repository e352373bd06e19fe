"""Outlines, microscopes and slow reference images for the tests of `optics`."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from optics.microscope import Microscope
from optics.outline import Arc, Edge, Outline, Ring, Segment
from optics.scene import Layer, Scene

FloatArray = npt.NDArray[np.float64]


def microscope(magnification: float = 6.9, aperture: float = 0.42) -> Microscope:
    """Return the paper's setting in air, with a small frame."""
    return Microscope(
        aperture=aperture,
        wavelength_um=0.6,
        medium_index=1.0,
        magnification=magnification,
        pitch_um=7.5,
        width_px=160,
        height_px=120,
    )


def circle(
    radius_um: float, center: tuple[float, float] = (0.0, 0.0), *, hole: bool = False
) -> Ring:
    """Return a full circle, clockwise for a hole."""
    sweep = -2 * math.pi if hole else 2 * math.pi
    arc = Arc(center=center, radius_um=radius_um, start_rad=0.0, sweep_rad=sweep)
    return Ring(edges=(arc,))


def disc(radius_um: float, center: tuple[float, float] = (0.0, 0.0)) -> Outline:
    """Return a disc."""
    return Outline(rings=(circle(radius_um, center),))


def polygon(points: list[tuple[float, float]]) -> Outline:
    """Return a polygon of one ring."""
    ends = zip(points, points[1:] + points[:1], strict=True)
    edges = tuple(Segment(start=a, end=b) for a, b in ends)
    return Outline(rings=(Ring(edges=edges),))


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Outline:
    """Return an upright rectangle."""
    return polygon([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def gear(teeth: int = 18) -> Outline:
    """Return teeth cut from R = 50 to 45 um around a 25 um bore."""
    step, edges = 2 * math.pi / teeth, list[Edge]()
    for i in range(teeth):
        a, b, c = i * step, (i + 0.5) * step, (i + 1) * step
        edges += [
            Arc(center=(0.0, 0.0), radius_um=50.0, start_rad=a, sweep_rad=b - a),
            Segment(start=_polar(50, b), end=_polar(45, b)),
            Arc(center=(0.0, 0.0), radius_um=45.0, start_rad=b, sweep_rad=c - b),
            Segment(start=_polar(45, c), end=_polar(50, c)),
        ]
    return Outline(rings=(Ring(edges=tuple(edges)), circle(25.0, hole=True)))


def one_layer(outline: Outline, z_um: float = 0.0) -> Scene:
    """Return a white body over black."""
    layer = Layer(name="part", outline=outline, z_um=z_um, reflectance=1.0)
    return Scene(layers=(layer,), background=0.0)


def brute_force(
    distance_um: Callable[[FloatArray, FloatArray], FloatArray],
    optics: Microscope,
    otf: Callable[[FloatArray], FloatArray],
    *,
    samples: int = 16,
    margin_px: int = 48,
) -> FloatArray:
    """Return an image by a dense raster, one large convolution and box averages.

    Parameters
    ----------
    distance_um : callable of (x, y)
        Signed distance to the outline, positive inside; exact near the edge.
    optics : Microscope
        The optical setting; its whole frame is rendered.
    otf : callable of x
        Transfer over the share of the cutoff.
    samples : int
        Raster points a pixel; the raster errs with the square of their distance.
    margin_px : int
        Black pixels around the frame.

    Returns
    -------
    (height_px, width_px) float64 array
        Coverage of the pixels.
    """
    rows = optics.height_px + 2 * margin_px
    columns = optics.width_px + 2 * margin_px
    h = optics.um_per_px / samples
    x = (np.arange(columns * samples) - (columns * samples - 1) / 2) * h
    y = ((rows * samples - 1) / 2 - np.arange(rows * samples)) * h
    cover = np.clip(0.5 + distance_um(x, y[:, None]) / h, 0, 1)
    u = np.fft.rfftfreq(x.size, h)
    v = np.fft.fftfreq(y.size, h)[:, None]
    share = np.minimum(np.hypot(u, v) / optics.cutoff_per_um, 1.0)
    # the raster's own cell is h wide and must not blur twice
    sharp = np.sinc(u * h) * np.sinc(v * h)
    blurred = np.fft.irfft2(np.fft.rfft2(cover) * otf(share) / sharp, s=cover.shape)
    pixels = blurred.reshape(rows, samples, columns, samples).mean(axis=(1, 3))
    inner = slice(margin_px, -margin_px)
    image: FloatArray = pixels[inner, inner]
    return image


def _polar(radius: float, angle: float) -> tuple[float, float]:
    return (radius * math.cos(angle), radius * math.sin(angle))
