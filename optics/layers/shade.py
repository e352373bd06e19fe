"""Light through the objective, and the shade that higher bodies throw on lower faces.

Coaxial light reaches a face through the pupil of the lamp, and what the face sends back
leaves through that of the objective. A body h above shades the face within h times the
slope of the marginal ray: once on the way down, once more on the way up. The way up is
what `microplan.optics.layers.occlusion` traces; here is the way down, and both in
closed form for the floor of a round bore.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.layers.rays import Grid, hard, slopes, trace
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
    tangents = slopes(lamp, samples)
    # black bodies before a white background: what a ray sees is what it lets through
    return trace(stack, 1.0, grid.shape, grid.step_um, tangents, z_um).image


def bore_aperture(radius_um: float, depth_um: float, microscope: Microscope) -> float:
    """Return the aperture left to a point on the axis of a round bore.

    Parameters
    ----------
    radius_um : float
        Of the bore's upper rim.
    depth_um : float
        Of the point below the rim, >= 0.
    microscope : Microscope
        The optical setting.

    Returns
    -------
    float
        min(A, n sin atan(R / h)).
    """
    if not (radius_um > 0 and depth_um >= 0):
        raise ValueError(
            f"need radius_um > 0 and depth_um >= 0, got {radius_um}, {depth_um}"
        )
    sine = radius_um / math.hypot(radius_um, depth_um)
    return min(microscope.aperture, microscope.medium_index * sine)


def bore_brightness(
    radius_um: float,
    depth_um: float,
    microscope: Microscope,
    *,
    lamp_aperture: float | None = None,
) -> float:
    """Return how bright a point on a bore's axis is, compared with an open one.

    Parameters
    ----------
    radius_um, depth_um, microscope
        As in `bore_aperture`.
    lamp_aperture : float, optional
        Numerical aperture of light through the objective. Default: light from all
        around, which the bore is taken not to shade.

    Returns
    -------
    float
        (a / A)**2, times (a / A_lamp)**2 for light through the objective, with a the
        smaller of the aperture left and the pupil's. The sine form is exact: the pupil
        is filled evenly by area, and its radius is the sine. In tangents this is
        (R / (h tan alpha))**2 (1 + tan(alpha)**2) / (1 + (R / h)**2), sin alpha = A/n.
    """
    seen = bore_aperture(radius_um, depth_um, microscope) / microscope.aperture
    if lamp_aperture is None:
        return seen**2
    lamp = replace(microscope, aperture=lamp_aperture)
    return (seen * bore_aperture(radius_um, depth_um, lamp) / lamp_aperture) ** 2
