"""Shade of higher bodies on lower faces in coaxial light, by rays.

Coaxial light reaches a face through the pupil of the lamp, and what the face sends back
leaves through that of the objective. A body h above shades the face within h times the
slope of the marginal ray: once as illumination, once more as image. The image is what
`microplan.optics.layers.occlusion` traces; here is the illumination.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.layers.rays import Fan, Grid, hard, slopes, trace
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.microscope import Microscope


def light_share(
    layers: Sequence[Layer],
    lamp: Microscope,
    grid: Grid,
    z_um: float,
    *,
    samples: int = 256,
) -> FloatArray:
    """Return the share of the light that reaches a face through the layers above it.

    Parameters
    ----------
    layers : sequence of Layer
        The scene; those at `z_um` and below do not count.
    lamp : Microscope
        Whose pupil the light fills evenly by area, as a Lambertian source or a Koehler
        condenser does.
    grid : Grid
        Cells in the plane of the face.
    z_um : float
        World height of the face.
    samples : int
        Rays a cell.

    Returns
    -------
    (rows, columns) float64 array
        0..1: the mean over the pupil of what the layers above leave open.
    """
    above = [replace(layer, reflectance=0.0) for layer in layers if layer.z_um > z_um]
    if not above:
        return np.ones(grid.shape)
    stack = hard(above, grid, lamp, z_um)
    fan = Fan(
        shape=grid.shape, step_um=grid.step_um, tangents=slopes(lamp, samples),
        focus_um=z_um,
    )  # fmt: skip
    # black bodies before a white background: what a ray sees is what it lets through
    return trace(stack, 1.0, fan)
