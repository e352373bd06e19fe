"""How much band and how much margin an image needs for a given error."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import find_model
from microplan.optics.transfer.otf import diffraction

BAND_ERROR = 5e-4  # of unit contrast, what cutting the band may cost by `band_error`
# The edge spread of an Airy pattern nears its end as (wavelength / A) / (pi**3 d):
# at 40 wavelength / A it is 8e-4 away from it, for an endless straight edge.
MARGIN = 40.0
NEAR = 10.0  # wavelengths / A, the part of the margin that a transform's period has
# What making up for it leaves, of unit contrast: seen 2.4e-5 at most for edges, corners
# and parts in and about frames of 160 to 640 pixels, in focus, where it is worst
# (tested).
FAR_ERROR = 3e-5
SINGLE_ERROR = 1e-6  # of unit contrast, what single precision adds (tested)
CUTS: FloatArray = np.geomspace(1e-6, 1.0, 1200)  # shares of the cutoff


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampling:
    """How much band and how much margin an image is computed with."""

    band_error: float = BAND_ERROR  # of unit contrast, what cutting the band may cost
    margin: float = MARGIN  # around all that spreads light, in wavelengths / A
    single: bool = False  # transforms in single precision: `SINGLE_ERROR` more
    # the margin beyond it is made up for by `microplan.optics.render.far_field`
    near: float = NEAR

    def __post_init__(self) -> None:
        for name in ("band_error", "margin", "near"):
            value = getattr(self, name)
            if not (value > 0 and math.isfinite(value)):
                raise ValueError(f"{name} must be positive and finite, got {value}")


def margin_um(microscope: Microscope, z_um: float, margin: float = MARGIN) -> float:
    """Return how far light spreads sideways from a layer `z_um` out of focus, um.

    The radius of the marginal ray's blur circle, and `margin` wavelengths over A.
    """
    tail = margin * microscope.wavelength_um / microscope.aperture
    return microscope.blur_diameter_um(z_um) / 2 + tail


def margin_error(margin: float = MARGIN) -> float:
    """Return what the margin costs where an endless edge leaves the tile [1]."""
    return float(1 / (np.pi**3 * margin))


def band_error(model: str, microscope: Microscope, z_um: float) -> FloatArray:
    """Return what cutting the band costs, at the cuts of `CUTS`.

    Parameters
    ----------
    model : str
        A key of `microplan.optics.transfer.models.MODELS`.
    microscope : Microscope
        The optical setting.
    z_um : float
        Defocus of the layer.

    Returns
    -------
    (len(CUTS),) float64 array
        Predicted image error of unit contrast, falling. Three times the integral of
        the transfer over pi x beyond the cut: one edge costs the integral, and a
        corner or a narrow slot joins two or three. The transfer is replaced by its
        envelope: |jinc q| <= 1.6 q**-1.5, as 2 J1(q) / q <= 2 sqrt(2 / pi) q**-1.5.

    Notes
    -----
    A prediction for edges, corners and slots, no bound: in the middle of a circle what
    is cut off comes from all of the rim in phase and adds up, to 1.75 times the
    prediction for a disc of 2 um at 20 x (A .42, pixels of 7.5 um, 5e-3 asked for).
    Where that matters an image of all of the band tells, as in
    `microplan.optics.render.fidelity`.
    """
    rung = find_model(model)
    # the smaller W20 of the two, and x (1 - x) for the product too: the safe side
    waves = abs(microscope.paraxial_w20_um(z_um)) / microscope.wavelength_um
    q = 8 * np.pi * waves * CUTS * (1 - CUTS if rung.diffracts else 1.0)
    envelope = 1 / np.maximum(1.0, q**1.5 / 1.6)
    if rung.diffracts:
        envelope = envelope * diffraction(CUTS)
    a = CUTS * microscope.cutoff_per_um * microscope.um_per_px
    a = a * np.sqrt(microscope.fill_factor)
    pixel = np.maximum(np.abs(np.sinc(a)), np.sinc(a / np.sqrt(2)) ** 2)
    terms = envelope * pixel
    steps = (terms[1:] + terms[:-1]) / 2 * np.diff(np.log(CUTS))
    beyond = np.concatenate([np.cumsum(steps[::-1])[::-1], [0.0]])
    total: FloatArray = 3 / np.pi * beyond
    return total


@lru_cache(maxsize=256)
def band_cut(
    model: str, microscope: Microscope, z_um: float, error: float = BAND_ERROR
) -> float:
    """Return the smallest share of the cutoff that costs `error` at most, 0..1."""
    cost = band_error(model, microscope, z_um)
    return float(CUTS[np.flatnonzero(cost <= error)[0]])
