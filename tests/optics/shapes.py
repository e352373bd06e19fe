"""Outlines, microscopes and slow reference images for the tests of `optics`."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import fft

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Arc, Edge, Outline, Ring, Segment
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.transfer.microscope import Microscope


def microscope(
    magnification: float = 6.9, width_px: int = 160, height_px: int = 120
) -> Microscope:
    """Return the paper's setting in air, with a small frame."""
    return Microscope(
        aperture=0.42,
        wavelength_um=0.6,
        medium_index=1.0,
        magnification=magnification,
        pitch_um=7.5,
        width_px=width_px,
        height_px=height_px,
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
    x = np.linspace(-0.5, 0.5, columns * samples) * (columns * samples - 1) * h
    y = np.linspace(0.5, -0.5, rows * samples) * (rows * samples - 1) * h
    cover = _cell_coverage(distance_um(x, y[:, None]), h)
    u = fft.rfftfreq(x.size, h)
    v = fft.fftfreq(y.size, h)[:, None]
    knots = np.linspace(0, 1, 20_001)  # read linearly: 1e-6 off at 10 waves
    gain = np.interp(np.hypot(u, v) / optics.cutoff_per_um, knots, otf(knots))
    blurred = fft.irfft2(fft.rfft2(cover) * gain, s=cover.shape)
    # a mean over cells of means over a cell: exactly the mean over the pixel
    pixels = blurred.reshape(rows, samples, columns, samples).mean(axis=(1, 3))
    inner = slice(margin_px, -margin_px)
    image: FloatArray = pixels[inner, inner]
    return image


def _cell_coverage(distance_um: FloatArray, cell_um: float) -> FloatArray:
    """Return the share of square cells on the inner side of a nearly straight edge."""
    gy, gx = (np.abs(g) / cell_um for g in np.gradient(distance_um))
    long, short = np.maximum(gx, gy), np.maximum(np.minimum(gx, gy), 1e-3)
    t = distance_um / cell_um

    def ramp(shift: FloatArray) -> FloatArray:
        squares: FloatArray = np.maximum(t + shift, 0) ** 2 / 2
        return squares

    wide, thin = (long + short) / 2, (long - short) / 2
    slope = (ramp(wide) - ramp(thin) - ramp(-thin) + ramp(-wide)) / (long * short)
    cover: FloatArray = np.clip(np.where(np.abs(t) < 1, slope, t > 0), 0, 1)
    return cover


def _polar(radius: float, angle: float) -> tuple[float, float]:
    return (radius * math.cos(angle), radius * math.sin(angle))
