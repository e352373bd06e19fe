"""Scene to image: what the camera sees, without noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.outline.clip import to_edges
from microplan.optics.render.layer_blending import Patch, blend_layers, light_up
from microplan.optics.render.prepared_scene import prepare
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.render.tiled_layer import make_part
from microplan.optics.render.view_range import ImageView, Range, full
from microplan.optics.transfer.lru import Recent
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import find_model

_USUAL = Sampling()
_SINGLE = Sampling(single=True)
_RECENT_BYTES = 1 << 24  # of blurred layers: images of one pose with other layers


def render(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    model: str = "exact",
    window: Window | None = None,
    light: Illumination | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
    also: Sequence[Covered] = (),
    sampling: Sampling = _USUAL,
) -> FloatArray:
    """Return the noise-free image of a scene.

    Parameters
    ----------
    scene : Scene
        Layers in the world frame over a uniform background.
    microscope : Microscope
        The optical setting; the camera's axis is the world's origin.
    focus_um : float
        World height of the plane in focus.
    model : str
        The OTF model of defocus, a key of `microplan.optics.transfer.models.MODELS`.
    window : Window, optional
        The part of the frame wanted; it may reach beyond the frame. Default: all.
    light : Illumination, optional
        Gain and gradient of the light; the gradient refers to the full field.
    shift_um : (x, y)
        Displacement of the whole image, um in object space.
    also : sequence of Covered
        More layers of the scene, blurred already by `cover` with the same arguments.
    sampling : Sampling
        Band and margin to compute with.

    Returns
    -------
    (rows, columns) float64 array
        Share of full scale, not clipped; pixels are integrals over their area.

    Raises
    ------
    ValueError
        If the model is unknown or a number is not finite.

    Notes
    -----
    Layers are blurred each with its own defocus and blended from the lowest to the
    highest, image = (1 - a) image + reflectance a. Layers of equal height share one
    step. Errors of band and margin: `microplan.optics.render.sampling`.
    """
    frame = window or full(microscope)
    fresh = cover(
        scene.layers,
        microscope,
        focus_um=focus_um,
        model=model,
        window=frame,
        shift_um=shift_um,
        sampling=sampling,
    )
    patches = [c.patch() for c in (*also, *fresh)]
    image = np.empty((frame.rows, frame.columns))
    blend_layers(image, patches, scene.background)
    light_up(image, microscope, frame, light or Illumination())
    return image


@dataclass(frozen=True, slots=True, kw_only=True)
class Covered:
    """A layer with its blurred indicator at the pixels of a window."""

    layer: Layer
    coverage: FloatArray  # (rows, columns), 0..1 but for errors of band and margin

    def patch(self, lit: FloatArray | None = None) -> Patch:
        """Return the layer over the window, `lit` (rows, columns) 0..1 if unevenly."""
        whole = slice(None)
        return Patch(
            layer=self.layer, rows=whole, columns=whole, coverage=self.coverage, lit=lit
        )


_RECENT: Recent[Covered] = Recent(_RECENT_BYTES, lambda found: found.coverage.nbytes)


def cover(
    layers: Sequence[Layer],
    microscope: Microscope,
    *,
    focus_um: float,
    model: str = "exact",
    window: Window | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
    sampling: Sampling = _USUAL,
) -> tuple[Covered, ...]:
    """Return layers blurred, for images that share them; arguments as in `render`.

    Their coverage is not to be changed: what was asked for not long ago is given again.
    """
    find_model(model)
    for name, values in (("focus_um", (focus_um,)), ("shift_um", shift_um)):
        if not all(math.isfinite(value) for value in values):
            raise ValueError(f"{name} must be finite, got {values}")
    frame = window or full(microscope)
    settings = (microscope, focus_um, model, frame, shift_um, sampling)
    return tuple(
        _RECENT.get((layer, *settings), partial(_covered, layer, *settings))
        for layer in layers
    )


def _covered(
    layer: Layer,
    microscope: Microscope,
    focus_um: float,
    model: str,
    frame: Window,
    shift_um: tuple[float, float],
    sampling: Sampling,
) -> Covered:
    """Return one layer blurred."""
    coverage = None
    if sampling.planes:
        from microplan.optics.render.plane_reading import (  # loads a compiler
            read_layer,
        )

        coverage = read_layer(
            layer, microscope, focus_um=focus_um, model=model, window=frame,
            shift_um=shift_um, sampling=sampling,
        )  # fmt: skip
    if coverage is None:
        settings = (microscope, focus_um, model, frame, shift_um, sampling)
        coverage = _transformed(layer, *settings)
    coverage.setflags(write=False)
    return Covered(layer=layer, coverage=coverage)


def _transformed(
    layer: Layer,
    microscope: Microscope,
    focus_um: float,
    model: str,
    frame: Window,
    shift_um: tuple[float, float],
    sampling: Sampling,
) -> FloatArray:
    """Return one layer's coverage by a transform of its own, (rows, columns)."""
    part = make_part(
        layer,
        to_edges(layer.outline),
        microscope,
        reach=Range(focus_um=(focus_um, focus_um)),
        model=model,
        window=frame,
        sampling=sampling,
        shift_um=shift_um,
    )
    coverage = np.zeros((frame.rows, frame.columns))
    view = ImageView(microscope=microscope, focus_um=focus_um)
    patch = None if part is None else part.patch(frame, view)
    if patch is not None:
        coverage[patch.rows, patch.columns] = patch.coverage
    return coverage


def render_stack(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: Sequence[float],
    model: str = "exact",
    window: Window | None = None,
    sampling: Sampling = _SINGLE,
) -> FloatArray:
    """Return images of a scene at several focus heights, (N, rows, columns).

    Share of full scale, in even light. Spectra are computed once for all planes; else
    like `render`. The margin is that of the plane most out of focus and the precision
    single, so a plane agrees with `render` within the predicted errors, not bit by bit.
    """
    if not (focus_um and all(map(math.isfinite, focus_um))):
        raise ValueError(f"focus_um must hold finite heights, got {focus_um}")
    frame = window or full(microscope)
    still = prepare(
        scene,
        microscope,
        Range(focus_um=(min(focus_um), max(focus_um))),
        model=model,
        window=frame,
        sampling=sampling,
    )
    images = np.empty((len(focus_um), frame.rows, frame.columns))
    top = max((layer.z_um for layer in scene.layers), default=0.0)
    # planes at one distance from a layer share its gain
    for index in sorted(range(len(focus_um)), key=lambda i: abs(focus_um[i] - top)):
        still.draw(
            images[index], ImageView(microscope=microscope, focus_um=focus_um[index])
        )
    return images
