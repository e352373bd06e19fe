"""Blending of blurred layers over a background, from the lowest to the highest."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.render.pixels import axis_px
from microplan.optics.render.pruned_ifft import Samples
from microplan.optics.render.scene import Illumination, Layer, Window
from microplan.optics.transfer.microscope import Microscope

# Coverages of one height add up to 1 at most unless bodies overlap; the rest is error
# of the band and the margin.
_OVERLAP = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Patch:
    """A layer's blurred indicator where it is not 0."""

    layer: Layer
    rows: slice  # of the window
    columns: slice
    coverage: Samples  # 0..1 but for errors of band and margin
    # the same of the layer times the share of light that reaches it; None: all does
    lit: FloatArray | None = None


def blend_layers(
    image: FloatArray, patches: Sequence[Patch], background: float | FloatArray
) -> None:
    """Fill an image (rows, columns), share of full scale, in place."""
    ordered = sorted(patches, key=lambda p: (p.layer.z_um, p.layer.name))
    if not ordered:
        image[...] = background
    for z_um, each in itertools.groupby(ordered, key=lambda p: p.layer.z_um):
        group, first = list(each), z_um == ordered[0].layer.z_um
        if len(group) > 1 and _side_by_side(image.shape, group):
            if first:
                image[...] = background
            _add(image, group)
            continue
        if first and group[0].lit is None and not isinstance(background, np.ndarray):
            _start(image, group.pop(0), background)
        elif first:
            image[...] = background
        for patch in group:
            _cover(image, patch)


def light_up(
    images: FloatArray, microscope: Microscope, frame: Window, light: Illumination
) -> None:
    """Multiply images (N, rows, columns), of full scale, by the light's intensity.

    In place; one image may be (rows, columns).
    """
    if light.gradient_x or light.gradient_y:
        images *= _light(microscope, frame, light)
    elif light.gain != 1:
        images *= light.gain


def _start(image: FloatArray, patch: Patch, background: float) -> None:
    """Fill `image` with a background and the first layer over it."""
    if patch.coverage.shape != image.shape:
        image.fill(background)
    seen = image[patch.rows, patch.columns]
    np.multiply(patch.coverage, patch.layer.reflectance - background, out=seen)
    if background:
        seen += background


def _cover(image: FloatArray, patch: Patch) -> None:
    """Lay one layer over `image`: image + a (reflectance - image)."""
    seen = image[patch.rows, patch.columns]
    seen += _change(patch, seen)


def _change(patch: Patch, seen: FloatArray) -> FloatArray:
    """Return what a layer changes of what is seen behind it."""
    if patch.lit is not None:
        return patch.layer.reflectance * patch.lit - patch.coverage * seen
    change = patch.layer.reflectance - seen
    change *= patch.coverage
    return change


def _side_by_side(shape: tuple[int, ...], group: Sequence[Patch]) -> bool:
    """Return whether layers of one height nowhere cover more than all."""
    total = np.zeros(shape)
    for patch in group:
        total[patch.rows, patch.columns] += patch.coverage
    return bool(total.max() <= 1 + _OVERLAP)


def _add(image: FloatArray, group: Sequence[Patch]) -> None:
    """Lay layers side by side over `image`: exact for one height."""
    under = image.copy()
    for patch in group:
        seen = under[patch.rows, patch.columns]
        image[patch.rows, patch.columns] += _change(patch, seen)


def _light(microscope: Microscope, frame: Window, light: Illumination) -> FloatArray:
    """Return the illumination of the frame's pixels, (rows, columns)."""
    cx, cy = axis_px(microscope)
    x = (np.arange(frame.columns) + frame.column - cx) / microscope.width_px
    y = (cy - np.arange(frame.rows) - frame.row) / microscope.height_px
    lit: FloatArray = light.gain * (
        1 + light.gradient_x * x + light.gradient_y * y[:, None]
    )
    return lit
