"""Blurred layers on grids in their outline's own frame, kept.

A layer that only moves, in images of slightly different focus and zoom, is blurred at
few heights, and read from there: `microplan.optics.render.plane_reading`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy import ndimage

from microplan.arrays import Float32Array
from microplan.optics.outline.outline import Outline
from microplan.optics.outline.own_frame import OwnEdges, own_edges
from microplan.optics.render.sampling import Sampling, margin_um
from microplan.optics.render.scene import Layer, Window
from microplan.optics.render.tiled_layer import make_part
from microplan.optics.render.view_range import ImageView, Range
from microplan.optics.transfer.lru import Recent
from microplan.optics.transfer.microscope import Microscope

_HELD_BYTES = 3 << 25  # of planes
# Samples a side of planes that are made all over, wherever they are wanted; of bodies
# beside the image, which sees other parts of them when they turn
_WHOLE, _WHOLE_BESIDE = 384, 768
_EVEN = 64  # samples: others end at whole multiples, areas nearly alike share planes
_RIM = 12  # samples beyond: a spline's ends are felt by .27 a sample
# A cubic through four heights errs most where the blur's rim passes an edge: heights
# lie so many depths of field apart, or so much of their distance from the focus.
_DEPTHS, _SHARE = 0.3, 0.025


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaneSetting:
    """What planes of one layer share."""

    own: OwnEdges
    lens: Microscope  # with a pixel a sample, of an even pitch
    model: str
    sampling: Sampling


_PLANES: Recent[Float32Array] = Recent(_HELD_BYTES, lambda found: found.nbytes)


def nodes_um(lens: Microscope, z_um: float) -> tuple[list[float], list[float]]:
    """Return four heights about a defocus z, um, and the weight of each [1].

    Heights are even in asinh z; those below 0 are blurred as those above.
    """
    scale = _DEPTHS / _SHARE * lens.wave_depth_um
    place = math.asinh(abs(z_um) / scale) / _SHARE
    first = math.floor(place)
    t = place - first
    heights = [abs(scale * math.sinh(_SHARE * (first + k))) for k in (-1, 0, 1, 2)]
    return heights, [
        -t * (t - 1) * (t - 2) / 6,
        (t + 1) * (t - 1) * (t - 2) / 2,
        -(t + 1) * t * (t - 2) / 2,
        (t + 1) * t * (t - 1) / 6,
    ]


def plane_window(
    setting: PlaneSetting, most_um: float, wanted: Window
) -> Window | None:
    """Return the samples of planes up to a defocus, where they are wanted.

    None where the layer is not seen. Column c and row r lie at (c, -r) steps.
    """
    step = setting.lens.um_per_px
    margin = margin_um(setting.lens, most_um, setting.sampling.margin)
    left, low, right, high = own_edges(setting.own).bounds_um
    across = _even((left - margin) / step, (right + margin) / step)
    down = _even((-high - margin) / step, (margin - low) / step)
    aside = math.hypot(
        wanted.column + wanted.columns / 2 - (left + right) / 2 / step,
        wanted.row + wanted.rows / 2 + (low + high) / 2 / step,
    )
    whole = _WHOLE if aside < wanted.columns / 2 else _WHOLE_BESIDE
    if max(len(across), len(down)) > whole:
        seen = (_even(wanted.column, wanted.column + wanted.columns),
                _even(wanted.row, wanted.row + wanted.rows))  # fmt: skip
        across, down = _common(across, seen[0]), _common(down, seen[1])
    if not across or not down:
        return None
    return Window(
        column=across.start, row=down.start, columns=len(across), rows=len(down)
    )


def _even(low: float, high: float) -> range:
    """Return samples all about two ends, to whole multiples."""
    first = _EVEN * math.floor((low - _RIM) / _EVEN)
    return range(first, _EVEN * math.ceil((high + _RIM) / _EVEN))


def _common(one: range, other: range) -> range:
    """Return the samples that are in both."""
    return range(max(one.start, other.start), min(one.stop, other.stop))


def plane(setting: PlaneSetting, z_um: float, window: Window) -> Float32Array:
    """Return a layer `z_um` out of focus as a cubic spline's coefficients.

    (rows, columns), 0..1 but for errors of band and margin.
    """
    key = (setting, z_um, window)
    return _PLANES.get(key, partial(_blurred, setting, z_um, window))


def _blurred(setting: PlaneSetting, z_um: float, window: Window) -> Float32Array:
    """Return a plane, not to be changed."""
    part = make_part(
        Layer(name="", outline=Outline(rings=()), z_um=z_um, reflectance=0.0),
        own_edges(setting.own),
        setting.lens,
        reach=Range(focus_um=(0.0, 0.0)),
        model=setting.model,
        window=window,
        sampling=setting.sampling,
    )
    found = np.zeros((window.rows, window.columns), dtype=np.float32)
    view = ImageView(microscope=setting.lens, focus_um=0.0)
    patch = None if part is None else part.patch(window, view)
    if patch is not None:
        found[patch.rows, patch.columns] = patch.coverage
    spline: Float32Array = ndimage.spline_filter(
        found, order=3, output=np.float32, mode="mirror"
    )
    spline.setflags(write=False)
    return spline
