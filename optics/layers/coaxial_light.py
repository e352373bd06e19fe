"""Relative irradiance of coaxial light at a height, on as coarse a grid as allowed.

A point of a face sees the objective's pupil through the layers above it, and the lamp's
light comes along the same path. So the share that a layer keeps from the face is its
image in a microscope with the lamp's aperture, focused on the face; where layers of
several heights do, what they leave is taken for the product.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.layers.lattice import MORE, Area, EvenPoints, Lattice, blur
from microplan.optics.render.pixels import axis_px
from microplan.optics.render.render import cover
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Layer, Window
from microplan.optics.render.view_range import full
from microplan.optics.transfer.microscope import Microscope

# Points a radius of the shade's soft rim, which rises as the overlap of two discs, and
# of the blur by which it is seen: `benchmarks/optics/shading.py` measures the rest.
_A_RIM, _A_BLUR = 8, 16
_CLOSER = 2  # times closer are points where distances say what layers cover
_POINT = 1e-9  # a pixel's light-sensitive share that makes it a point
# Rays do not diffract between lamp and face. The Airy pattern that a transfer brings
# with it is set to so small a share of the rim, but not far below a point's share.
_AIRY, _AIRY_FINE = 1 / 200, 1 / 8
_OCTAVE = 2  # sizes of it where images share planes
# A shade is soft: neither its band nor its margin need be those of an image.
_COARSE = Sampling(band_error=1e-3, margin=12.0, near=12.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerShade:
    """What the layers of one height keep from a face."""

    z_um: float  # of the layers
    lattice: Lattice
    kept: FloatArray  # (rows, columns), 0..1 but for errors of band and margin
    by_um: tuple[float, float] = (0.0, 0.0)  # how far it lies from the lattice's points

    def on(self, other: Lattice) -> FloatArray:
        """Return the share kept from another lattice, (rows, columns), 0..1."""
        if other == self.lattice and self.by_um == (0.0, 0.0):
            return self.kept
        (x, y), step = other.corner_um, other.step_um
        rows, columns = other.shape
        return self.lattice.read(
            self.kept,
            (x - self.by_um[0], step, columns),
            (y - self.by_um[1], -step, rows),
            beyond_um=(MORE + 2) * step,  # points that only steady a spline
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Irradiance:
    """The light that reaches one height."""

    z_um: float
    shades: tuple[LayerShade, ...]  # none: all of it does

    @property
    def step_um(self) -> float:
        """Return how far apart points may be, um; inf where all light arrives."""
        return min((s.lattice.step_um for s in self.shades), default=math.inf)

    def on(self, lattice: Lattice) -> FloatArray:
        """Return the share of the lamp's light at a lattice, (rows, columns), 0..1."""
        share = np.ones(lattice.shape)
        for shade in self.shades:
            share *= 1 - np.clip(shade.on(lattice), 0.0, 1.0)
        return share

    def displaced(self, by_um: tuple[float, float]) -> Irradiance:
        """Return the light under the same layers displaced."""
        moved = (
            replace(s, by_um=(s.by_um[0] + by_um[0], s.by_um[1] + by_um[1]))
            for s in self.shades
        )
        return replace(self, shades=tuple(moved))

    def with_(self, other: Irradiance) -> Irradiance:
        """Return the light under the layers of both."""
        if other.z_um != self.z_um:
            raise ValueError(f"lights of heights {self.z_um} and {other.z_um}")
        found = sorted((*self.shades, *other.shades), key=lambda shade: shade.z_um)
        groups = itertools.groupby(found, key=lambda shade: shade.z_um)
        return replace(self, shades=tuple(_sum(list(group)) for _, group in groups))


def irradiances(
    layers: Sequence[Layer],
    heights_um: Sequence[float],
    microscope: Microscope,
    *,
    lamp_aperture: float,
    focus_um: Sequence[float],
    window: Window | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
    few_points: bool = False,
) -> tuple[Irradiance, ...]:
    """Return the relative irradiance at each height below the layers.

    Parameters
    ----------
    layers : sequence of Layer
        Possible occluders.
    heights_um : sequence of float
        World heights of the faces.
    lamp_aperture : float
        Of the light through the objective, evenly filled by area, in (0, n).
    focus_um : sequence of float
        World heights in focus in the images that use the light.
    window : Window, optional
        Their part of the frame. Default: all.
    shift_um : (x, y)
        Their displacement.
    few_points : bool
        As in `microplan.optics.render.sampling.Sampling`.

    Returns
    -------
    tuple of Irradiance
        One for each different height, rising. They serve for images at any of the
        focus heights, and at other zooms and shifts where they reach as far.

    Raises
    ------
    ValueError
        If the aperture is not in (0, n) or no focus is given.
    """
    lamp = replace(microscope, aperture=lamp_aperture, wavefront=(), halo=None)
    frame = window or full(microscope)
    found = []
    for z_um in sorted(set(heights_um)):
        away = [z_um - focus for focus in focus_um]
        area = area_um(microscope, frame, shift_um, max(away, key=abs))
        least = 0.0 if min(away) <= 0 <= max(away) else min(away, key=abs)
        seen = microscope.blur_diameter_um(least) / 2 / _A_BLUR
        finest = max(fine_um(microscope), seen)
        above = sorted({layer.z_um for layer in layers if layer.z_um > z_um})
        shades = (
            _shade(
                [a for a in layers if a.z_um == top],
                lamp, z_um, area, finest, few_points=few_points,
            )
            for top in above
        )  # fmt: skip
        kept = tuple(shade for shade in shades if shade is not None)
        found.append(Irradiance(z_um=z_um, shades=kept))
    return tuple(found)


def fine_um(microscope: Microscope) -> float:
    """Return the distance of points below which pixels or the lens resolve nothing."""
    return max(microscope.um_per_px / 2, microscope.airy_radius_um / 4)


def area_um(
    microscope: Microscope, frame: Window, shift_um: tuple[float, float], z_um: float
) -> Area:
    """Return what the pixels of a window see of a height `z_um` out of focus, um."""
    rim_um = microscope.blur_diameter_um(z_um) / 2
    x, y = pixel_axes_um(microscope, frame, shift_um)
    low = y[0] + y[1] * (y[2] - 1)
    return (
        x[0] - rim_um,
        low - rim_um,
        x[0] + x[1] * (x[2] - 1) + rim_um,
        y[0] + rim_um,
    )


def pixel_axes_um(
    microscope: Microscope, frame: Window, shift_um: tuple[float, float]
) -> tuple[EvenPoints, EvenPoints]:
    """Return the positions of a window's columns and rows, (first, step, count), um."""
    cx, cy = axis_px(microscope)
    p = microscope.um_per_px
    x = ((frame.column - cx) * p - shift_um[0], p, frame.columns)
    return x, ((cy - frame.row) * p - shift_um[1], -p, frame.rows)


def _sum(shades: Sequence[LayerShade]) -> LayerShade:
    """Return what layers of one height keep together, on the points of one of them.

    One that was not displaced, if there is one: it belongs to the image at hand.
    """
    if len(shades) == 1:
        return shades[0]
    first = min(shades, key=lambda shade: shade.by_um != (0.0, 0.0))
    x, y = first.by_um
    near = [replace(s, by_um=(s.by_um[0] - x, s.by_um[1] - y)) for s in shades]
    kept = sum((s.on(first.lattice) for s in near), np.zeros(first.lattice.shape))
    return replace(first, kept=kept)


def _shade(
    layers: Sequence[Layer],
    lamp: Microscope,
    z_um: float,
    area: Area,
    finest_um: float,
    *,
    few_points: bool,
) -> LayerShade | None:
    """Return what layers of one height keep from a face below, None if nothing."""
    height_um = layers[0].z_um - z_um
    radius = lamp.blur_diameter_um(height_um) / 2
    step = max(radius / _A_RIM, finest_um)
    lattice = Lattice.over(area, step, more=MORE + 1)  # holds all finer ones
    if radius < _AIRY_FINE * finest_um:  # hard on these points, and its band endless
        return _hard(layers, lattice)
    rest = max(_AIRY * radius, _AIRY_FINE * finest_um)
    airy = min(lamp.wavelength_um / lamp.aperture, rest)
    if few_points:  # alike in images of nearly the same focus
        airy = 2.0 ** (math.floor(_OCTAVE * math.log2(airy)) / _OCTAVE)
    point = replace(
        lamp,
        wavelength_um=airy * lamp.aperture,
        magnification=1.0,
        pitch_um=step,
        width_px=1,
        height_px=1,
        fill_factor=1.0 if step < 2 * finest_um else _POINT,
    )
    if few_points:
        kept = _blurred(layers, lattice, point, height_um)
    else:
        found = cover(
            layers, point, focus_um=z_um, window=lattice.window, sampling=_COARSE
        )
        kept = np.sum([c.coverage for c in found], axis=0)
    if not kept.any():
        return None
    return LayerShade(z_um=layers[0].z_um, lattice=lattice, kept=kept)


def _blurred(
    layers: Sequence[Layer], lattice: Lattice, point: Microscope, height_um: float
) -> FloatArray:
    """Return the shade of layers so high on a lattice, from closer points beyond it."""
    w, step = lattice.window, lattice.step_um / _CLOSER
    by = math.ceil(point.blur_diameter_um(height_um) / 2 / step)
    row, column, rows, columns = (
        _CLOSER * each for each in (w.row, w.column, w.rows, w.columns)
    )
    inner = Window(row=row, column=column, rows=rows, columns=columns)
    wide = Lattice(step_um=step, window=inner).grown(by)
    whole = np.sum([wide.covered(layer, 0.0) for layer in layers], axis=0)
    kept = blur(whole, step, point, "exact", height_um, cell_um=step)
    return kept[by:-by:_CLOSER, by:-by:_CLOSER]


def _hard(layers: Sequence[Layer], lattice: Lattice) -> LayerShade | None:
    """Return what layers of one height keep from squares about the points."""
    kept = np.sum([lattice.cells(layer) for layer in layers], axis=0)
    if not kept.any():
        return None
    return LayerShade(z_um=layers[0].z_um, lattice=lattice, kept=kept)
