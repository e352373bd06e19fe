"""Bounds of what a model of the defocus OTF costs in an image, for any outline."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.defocus.model_error_table import BOUND, PIXEL, STEEPNESS, WAVES, Table
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import TABLE_ERROR, find_model

# Between two nodes the curves rise above their chord by up to .07 of what the table,
# rounded up by a tenth, says; those of rays and of pixels by up to .2, as they ring.
# `maps.laws.worst_bound_share` of `benchmarks/defocus/error_maps.py` then stays at most
# 1.
_BETWEEN, _BETWEEN_ROUGH = 1.1, 1.25
_RAYS_WAVES = 0.5  # W20 below which rays alone predict nothing
_WIDEST_PIXEL = 32.0  # in wavelength / A; `PIXEL` is the largest up to there


def model_error_bound(model: str, microscope: Microscope, z_um: float) -> float:
    """Return the largest image error of a defocus OTF's model, for any outline.

    Parameters
    ----------
    model : str
        A key of `microplan.optics.transfer.models.MODELS`.
    microscope : Microscope
        The optical setting; its pixels average the error.
    z_um : float
        Defocus, of either sign.

    Returns
    -------
    float
        Image error against the exact phase, of unit contrast, 0..1: half the integral
        of |difference of the two point responses|, or the same for responses
        averaged over a pixel where that is less. Concentric rings reach the integral.
        Of what is returned a disc of the worst size comes to .53, a grating to .29, a
        slot to .23 and a lone straight edge to .12 (medians over W20 and A / n;
        `benchmarks/defocus/error_maps.py`), an outline drawn at random to .17
        (`benchmarks/defocus/law_outlines.py`). 1 where it has not
        been measured, from A = .99 n on. For `exact` the error of its table.

    Raises
    ------
    ValueError
        If the model is unknown or `z_um` is not finite.

    Notes
    -----
    Logarithms of the table are read linearly in those of W20 and of A / n. Errors grow
    with W20 squared below the table and at most with W20 beyond it. Below half a wave
    that of `geometric` is 1.
    """
    find_model(model)
    if not math.isfinite(z_um):
        raise ValueError(f"z_um must be finite, got {z_um}")
    if model == "exact":
        return TABLE_ERROR
    waves = abs(microscope.rim_w20_um(z_um)) / microscope.wavelength_um
    steepness = microscope.aperture / microscope.medium_index
    rays = not find_model(model).diffracts
    if steepness > STEEPNESS[-1] or (rays and waves < _RAYS_WAVES):
        return 1.0
    between = _BETWEEN_ROUGH if rays else _BETWEEN
    bound = between * _read(BOUND[model], waves, steepness)
    side_um = microscope.um_per_px * math.sqrt(microscope.fill_factor)
    pixel = side_um * microscope.aperture / microscope.wavelength_um
    if waves <= WAVES[len(PIXEL[model]) - 1]:
        averaged = _BETWEEN_ROUGH * _read(PIXEL[model], waves, steepness)
        bound = min(bound, averaged / min(pixel, _WIDEST_PIXEL))
    return min(bound + TABLE_ERROR, 1.0)


def _read(table: Table, waves: float, steepness: float) -> float:
    """Return a table's value, whose rows are the first of `WAVES`."""
    last = WAVES[len(table) - 1]
    rows, columns = np.log(WAVES[: len(table)]), np.log(STEEPNESS)
    row = math.log(max(waves, WAVES[0]))
    column = math.log(steepness)
    along = [float(np.interp(column, columns, each)) for each in np.log(table)]
    value = math.exp(float(np.interp(row, rows, along)))
    below = min(waves / WAVES[0], 1.0)  # the change begins with the square of W20
    return value * below * below * max(waves / last, 1.0)
