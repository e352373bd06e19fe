"""The share of coaxial light that reaches a height, on points as far apart as it bears.

A point of a face sees the objective's pupil through the layers above it, and the lamp's
light comes the same way. So the share that a layer keeps from the face is its image in
a microscope with the lamp's aperture, focused on the face; where layers of several
heights do, what they leave is taken for the product.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self

import numpy as np
import numpy.typing as npt
from scipy import fft
from scipy.interpolate import CubicSpline

from optics.microscope import Microscope
from optics.models import tabulate
from optics.pixels import axis_px
from optics.render import cover
from optics.sampling import Sampling
from optics.scan import cells
from optics.scene import Layer, Window
from optics.views import full

FloatArray = npt.NDArray[np.float64]
Area = tuple[float, float, float, float]  # x_min, y_min, x_max, y_max, um
Places = tuple[float, float, int]  # the first, the step, how many

# Points a radius of the shade's soft rim, which rises as the overlap of two discs, and
# a pixel where the rim is narrower: `benchmarks/shading.py` tells what they leave.
_A_RIM, _A_PIXEL = 8, 2
_POINT = 1e-9  # a pixel's light-sensitive share that makes it a point
_MORE = 3  # points beyond all that is read: a spline is worse near its ends
_ROUNDING = 1e-6  # of a step
# Rays do not diffract on their way to a face. The Airy pattern that a transfer brings
# with it is made so small a share of the rim, but not far below a point's share.
_AIRY, _AIRY_PX = 1 / 200, 1 / 16
# A shade is soft: neither its band nor its margin need be those of an image.
_COARSE = Sampling(band_error=1e-3, margin=12.0, near=12.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lattice:
    """Points of a square lattice through the world's origin, rows down."""

    step_um: float
    window: Window  # (0, 0) is the origin

    @property
    def corner_um(self) -> tuple[float, float]:
        """Return (x, y) of the first point."""
        return self.window.column * self.step_um, -self.window.row * self.step_um

    @property
    def shape(self) -> tuple[int, int]:
        """Return (rows, columns)."""
        return self.window.rows, self.window.columns

    @classmethod
    def over(cls, area: Area, step_um: float, *, more: int = _MORE) -> Self:
        """Return the points of an area and `more` on all sides of it."""
        x_min, y_min, x_max, y_max = (edge / step_um for edge in area)
        left, top = math.floor(x_min), math.floor(-y_max)
        inner = Window(
            row=top,
            column=left,
            rows=math.ceil(-y_min) - top + 1,
            columns=math.ceil(x_max) - left + 1,
        )
        return cls(step_um=step_um, window=inner).grown(more)

    def grown(self, by: int) -> Self:
        """Return the lattice with `by` more points on every side."""
        w = self.window
        wide = Window(
            row=w.row - by,
            column=w.column - by,
            rows=w.rows + 2 * by,
            columns=w.columns + 2 * by,
        )
        return replace(self, window=wide)

    def cells(self, layer: Layer) -> FloatArray:
        """Return which share of the square about each point a layer covers."""
        x, y = self.corner_um
        half = self.step_um / 2
        return cells(layer.outline, x - half, y + half, self.step_um, self.shape)

    def read(
        self, values: FloatArray, x: Places, y: Places, *, beyond_um: float = 0.0
    ) -> FloatArray:
        """Return values at places between the points, by cubic splines.

        Parameters
        ----------
        values : (rows, columns) float64 array
            At the points.
        x, y : (first, step, count)
            Where the columns and the rows wanted lie, um; y falls if its step does.
        beyond_um : float
            How far beyond the points places may lie; the last ones' values hold there.

        Raises
        ------
        ValueError
            If a place lies farther outside.
        """
        (left, top), step = self.corner_um, self.step_um
        rows, columns = self.shape
        far = beyond_um / step + _ROUNDING
        down = _spline(rows, (top - y[0]) / step, -y[1] / step, y[2], far)
        across = _spline(columns, (x[0] - left) / step, x[1] / step, x[2], far)
        found: FloatArray = down @ values @ across.T
        return found


@lru_cache(maxsize=128)
def _spline(
    points: int, first: float, step: float, count: int, beyond: float
) -> FloatArray:
    """Return weights (count, points) of values at 0, 1, ... for even places."""
    at = first + step * np.arange(count)
    if at.min() < -beyond or at.max() > points - 1 + beyond:
        raise ValueError("the light was not computed for so wide a window or defocus")
    at = np.clip(at, 0, points - 1)
    weights: FloatArray = CubicSpline(np.arange(points), np.eye(points))(at)
    weights.setflags(write=False)
    return weights


@dataclass(frozen=True, slots=True, kw_only=True)
class Shade:
    """What the layers of one height keep from a face."""

    z_um: float  # of the layers
    lattice: Lattice
    kept: FloatArray  # (rows, columns), 0..1 but for errors of band and margin

    def on(self, other: Lattice) -> FloatArray:
        """Return what is kept from the points of another lattice."""
        (x, y), step = other.corner_um, other.step_um
        rows, columns = other.shape
        return self.lattice.read(
            self.kept,
            (x, step, columns),
            (y, -step, rows),
            beyond_um=(_MORE + 2) * step,  # points that only steady a spline
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
    """The light that reaches one height."""

    z_um: float
    shades: tuple[Shade, ...]  # none: all of it does

    @property
    def step_um(self) -> float:
        """Return how far apart points may be, um; inf where all light arrives."""
        return min((s.lattice.step_um for s in self.shades), default=math.inf)

    def on(self, lattice: Lattice) -> FloatArray:
        """Return the share of the lamp's light at the points of a lattice, 0..1."""
        share = np.ones(lattice.shape)
        for shade in self.shades:
            share *= 1 - np.clip(shade.on(lattice), 0.0, 1.0)
        return share

    def with_(self, other: Light) -> Light:
        """Return the light under the layers of both."""
        if other.z_um != self.z_um:
            raise ValueError(f"lights of heights {self.z_um} and {other.z_um}")
        found = sorted((*self.shades, *other.shades), key=lambda shade: shade.z_um)
        joined = []
        for z_um, group in itertools.groupby(found, key=lambda shade: shade.z_um):
            each = list(group)
            # the same distance has the same lattice, if the window was the same
            if any(shade.lattice != each[0].lattice for shade in each):
                raise ValueError("lights of different windows cannot be joined")
            kept = np.sum([shade.kept for shade in each], axis=0)
            joined.append(Shade(z_um=z_um, lattice=each[0].lattice, kept=kept))
        return Light(z_um=self.z_um, shades=tuple(joined))


def lights(
    layers: Sequence[Layer],
    heights_um: Sequence[float],
    microscope: Microscope,
    *,
    lamp_aperture: float,
    focus_um: Sequence[float],
    window: Window | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
) -> tuple[Light, ...]:
    """Return how much of the lamp's light reaches each height through layers above it.

    Parameters
    ----------
    layers : sequence of Layer
        What may throw shade.
    heights_um : sequence of float
        World heights of the faces.
    microscope : Microscope
        The optical setting.
    lamp_aperture : float
        Of the light through the objective, evenly filled by area, in (0, n).
    focus_um : sequence of float
        World heights in focus in the images that use the light.
    window : Window, optional
        Their part of the frame. Default: all.
    shift_um : (x, y)
        Their displacement.

    Returns
    -------
    tuple of Light
        One for each different height, rising. They serve for images at any of the
        focus heights, and at other zooms and shifts where they reach as far.

    Raises
    ------
    ValueError
        If the aperture is not in (0, n) or no focus is given.
    """
    lamp = replace(microscope, aperture=lamp_aperture)
    frame = window or full(microscope)
    found = []
    for z_um in sorted(set(heights_um)):
        most = max(abs(z_um - focus) for focus in focus_um)
        area = area_um(microscope, frame, shift_um, most)
        above = sorted({layer.z_um for layer in layers if layer.z_um > z_um})
        shades = (
            _shade([a for a in layers if a.z_um == top], lamp, z_um, area)
            for top in above
        )
        kept = tuple(shade for shade in shades if shade is not None)
        found.append(Light(z_um=z_um, shades=kept))
    return tuple(found)


def area_um(
    microscope: Microscope, frame: Window, shift_um: tuple[float, float], z_um: float
) -> Area:
    """Return what the pixels of a window see of a height `z_um` out of focus, um."""
    rim_um = microscope.blur_diameter_um(z_um) / 2
    x, y = places_um(microscope, frame, shift_um)
    low = y[0] + y[1] * (y[2] - 1)
    return (
        x[0] - rim_um,
        low - rim_um,
        x[0] + x[1] * (x[2] - 1) + rim_um,
        y[0] + rim_um,
    )


def places_um(
    microscope: Microscope, frame: Window, shift_um: tuple[float, float]
) -> tuple[Places, Places]:
    """Return where the columns and rows of a window lie, (first, step, count), um."""
    cx, cy = axis_px(microscope)
    p = microscope.um_per_px
    x = ((frame.column - cx) * p - shift_um[0], p, frame.columns)
    return x, ((cy - frame.row) * p - shift_um[1], -p, frame.rows)


def _shade(
    layers: Sequence[Layer], lamp: Microscope, z_um: float, area: Area
) -> Shade | None:
    """Return what layers of one height keep from a face below, None if nothing."""
    height_um = layers[0].z_um - z_um
    radius = lamp.blur_diameter_um(height_um) / 2
    pixel = lamp.um_per_px
    step = max(radius / _A_RIM, pixel / _A_PIXEL)
    lattice = Lattice.over(area, step, more=_MORE + 1)  # holds all finer ones
    airy = min(
        lamp.wavelength_um / lamp.aperture, max(_AIRY * radius, _AIRY_PX * pixel)
    )
    point = replace(
        lamp,
        wavelength_um=airy * lamp.aperture,
        magnification=1.0,
        pitch_um=step,
        width_px=1,
        height_px=1,
        fill_factor=1.0 if step < pixel else _POINT,
    )
    found = cover(layers, point, focus_um=z_um, window=lattice.window, sampling=_COARSE)
    kept = np.sum([c.coverage for c in found], axis=0)
    if not kept.any():
        return None
    return Shade(z_um=layers[0].z_um, lattice=lattice, kept=kept)


def blur(
    values: FloatArray, step_um: float, microscope: Microscope, model: str, z_um: float
) -> FloatArray:
    """Return values of a lattice as pixels see them there, blurred by a defocus.

    Parameters
    ----------
    values : (..., rows, columns) float64 array
        At points `step_um` apart, continued by their mirror images.
    step_um : float
        Distance of the points.
    microscope, model, z_um
        As in `optics.models.transfer`.
    """
    v, u = (np.arange(size) / (2 * size * step_um) for size in values.shape[-2:])
    x = np.hypot(u, v[:, None]) / microscope.cutoff_per_um
    gain = tabulate(model, microscope, z_um).read(np.minimum(x, 1.0))
    side = microscope.um_per_px * math.sqrt(microscope.fill_factor)
    gain = np.where(x < 1, gain, 0.0) * np.sinc(u * side) * np.sinc(v * side)[:, None]
    waves = fft.dctn(values, axes=(-2, -1))
    found: FloatArray = fft.idctn(waves * gain, axes=(-2, -1))
    return found
