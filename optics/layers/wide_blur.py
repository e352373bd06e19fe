"""Layers blurred widely in images of trials, on points as far apart as that allows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from microplan.optics.layers.coaxial_light import area_um, pixel_axes_um
from microplan.optics.layers.lattice import Lattice, blur
from microplan.optics.render.render import Covered, cover
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Layer, Window
from microplan.optics.render.view_range import full
from microplan.optics.transfer.microscope import Microscope

_A_BLUR = 16  # points in a blur's radius
_APART_PX = 2  # pixels from one to the next, at least


def cover_few(
    layers: Sequence[Layer],
    microscope: Microscope,
    *,
    focus_um: float,
    model: str = "exact",
    window: Window | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
    sampling: Sampling,
) -> tuple[Covered, ...]:
    """Return layers blurred as `microplan.optics.render.render.cover` does.

    Where the sampling allows `few_points`, those that are blurred widely come from
    such, on which distances from edges say what they cover.
    """
    frame = window or full(microscope)
    found: list[Covered] = []
    for layer in layers:
        away_um = layer.z_um - focus_um
        step = microscope.blur_diameter_um(away_um) / 2 / _A_BLUR
        if not sampling.few_points or step < _APART_PX * microscope.um_per_px:
            found += cover(
                [layer], microscope, focus_um=focus_um, model=model, window=frame,
                shift_um=shift_um, sampling=sampling,
            )  # fmt: skip
            continue
        points = Lattice.over(area_um(microscope, frame, shift_um, away_um), step)
        cells = points.covered(layer, 0.0).astype(np.float64)
        seen = blur(cells, step, microscope, model, away_um, cell_um=step)
        coverage = points.read(seen, *pixel_axes_um(microscope, frame, shift_um))
        coverage.setflags(write=False)
        found.append(Covered(layer=layer, coverage=coverage))
    return tuple(found)
