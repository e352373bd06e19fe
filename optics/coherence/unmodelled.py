"""Errors of a monochromatic, scalar model of the light at a straight edge.

Both are predicted as the largest error in the image of a straight edge, of its step.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import transfer

FLAT_BAND = 0.3  # full width over its mean, of a light whose spectrum is not stated
_WAVELENGTHS = 16  # Gauss nodes over the band
_FREQUENCIES = 128  # Gauss nodes up to the cutoff
_PLACES = 200  # where the edge is looked at, up to `_REACH` wavelength / A from it
_REACH = 8.0
_OVERLAP = 32  # Gauss nodes along each axis of two pupils' overlap


def spectrum_error(
    microscope: Microscope, z_um: float, bandwidth: float = FLAT_BAND
) -> float:
    """Return the image error of a single wavelength, of an edge's step.

    Parameters
    ----------
    microscope : Microscope
        The optical setting; its wavelength is the mean.
    z_um : float
        Defocus, the same for all colours: an achromatic lens.
    bandwidth : float
        Full width of a flat spectrum over its mean, 0 <= bandwidth < 1.

    Raises
    ------
    ValueError
        If `bandwidth` or `z_um` is out of range.
    """
    if not 0 <= bandwidth < 1:
        raise ValueError(f"bandwidth must be in 0..1, got {bandwidth}")
    if not math.isfinite(z_um):
        raise ValueError(f"z_um must be finite, got {z_um}")
    mean = microscope.wavelength_um
    nodes, weights = np.polynomial.legendre.leggauss(_WAVELENGTHS)
    colours = [
        replace(microscope, wavelength_um=float(mean * (1 + bandwidth / 2 * node)))
        for node in nodes
    ]
    reach = max(c.cutoff_per_um for c in (microscope, *colours))
    f, share = _frequencies(reach)
    band = sum(
        w / 2 * _transfer(f, colour, z_um)
        for w, colour in zip(weights, colours, strict=True)
    )
    difference = band - _transfer(f, microscope, z_um)
    return _edge_error(f, share, difference, mean / microscope.aperture)


def vectorial_error(microscope: Microscope) -> float:
    """Return the image error of a scalar field in focus, of an edge's step.

    Unpolarised light through an aplanatic objective into a camera of small aperture,
    its amplitude as in Richards and Wolf, Proc. R. Soc. A 253 (1959) 358; against the
    even pupil of the scalar models.
    """
    return _vectorial_error(microscope.aperture / microscope.medium_index)


@lru_cache(maxsize=64)
def _vectorial_error(sine: float) -> float:
    """Return the error by the sine alone: with wavelength / A goes all of the edge."""
    f, share = _frequencies(2.0)
    x = f / 2
    scalar = (np.arccos(x) - x * np.sqrt(1 - x * x)) * 2 / math.pi
    return _edge_error(f, share, vectorial_otf(x, sine) - scalar, 1.0)


def vectorial_otf(x: FloatArray, sine: float) -> FloatArray:
    """Return the in-focus transfer function of unpolarised light, 1 at 0.

    Parameters
    ----------
    x : (...) float array
        Frequency over the cutoff, 0..1 [1].
    sine : float
        Of the largest angle to the axis, aperture over index, 0 < sine < 1.

    Notes
    -----
    The sum over the field's three components of the autocorrelations of their pupils.
    Components of x- and y-polarised light that differ by a quarter rotation are
    averaged.
    """
    if not 0 < sine < 1:
        raise ValueError(f"sine must be between 0 and 1, got {sine}")
    whole = _autocorrelation(0.0, sine)
    return np.array([_autocorrelation(float(s), sine) / whole for s in x])


def _autocorrelation(shift: float, sine: float) -> float:
    """Return the pupils' autocorrelation at a shift of 2 `shift` radii."""
    if shift >= 1:
        return 0.0
    nodes, weights = np.polynomial.legendre.leggauss(_OVERLAP)
    # across: y = top sin(t), so that both ends of the overlap are smooth
    t = (nodes + 1) * math.pi / 4
    top = math.sqrt(1 - shift * shift)
    y = top * np.sin(t)
    half = np.sqrt(1 - y * y) - shift
    x = half[:, None] * nodes
    area = top * np.cos(t) * math.pi / 4 * weights * half
    field = _product(x + shift, x - shift, y[:, None], sine)
    return 2 * float(area @ (field @ weights))


def _product(
    x: FloatArray, other: FloatArray, y: FloatArray, sine: float
) -> FloatArray:
    """Return the scalar product of the fields at two points of the pupil."""
    one, two = _components(x, y, sine), _components(other, y, sine)
    return sum((a * b for a, b in zip(one, two, strict=True)), np.zeros_like(x))


def _components(x: FloatArray, y: FloatArray, sine: float) -> tuple[FloatArray, ...]:
    """Return the field at a point of the pupil for x- and then y-polarised light."""
    sx, sy = sine * x, sine * np.broadcast_to(y, x.shape)
    cosine = np.sqrt(np.maximum(1 - sx**2 - sy**2, 1e-300))
    apodised = 1 / np.sqrt(cosine)
    bend = 1 / (1 + cosine)  # (1 - cos) / sin**2
    return tuple(
        apodised * part
        for part in (
            1 - bend * sx**2, -bend * sx * sy, -sx,
            -bend * sx * sy, 1 - bend * sy**2, -sy,
        )
    )  # fmt: skip


@lru_cache(maxsize=1)
def _nodes() -> tuple[FloatArray, FloatArray]:
    return np.polynomial.legendre.leggauss(_FREQUENCIES)


def _frequencies(reach: float) -> tuple[FloatArray, FloatArray]:
    """Return frequencies from 0 to `reach` and their weights."""
    nodes, weights = _nodes()
    return (nodes + 1) / 2 * reach, weights / 2 * reach


def _transfer(f: FloatArray, microscope: Microscope, z_um: float) -> FloatArray:
    return transfer("exact", microscope, z_um, f)


def _edge_error(
    f: FloatArray, share: FloatArray, difference: FloatArray, airy_um: float
) -> float:
    """Return the largest difference of two images of an edge."""
    places = np.linspace(0, _REACH * airy_um, _PLACES)
    wave = np.sin(2 * np.pi * places[:, None] * f)
    return float(np.abs(wave @ (share * difference / (np.pi * f))).max())
