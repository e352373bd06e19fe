"""Quadrature points of the condenser's aperture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray

SAMPLES = 16  # rings to a radius of the pupil by default
_GOLDEN = (math.sqrt(5) - 1) / 2  # of a step: no two rings have the same angles


@dataclass(frozen=True, slots=True, kw_only=True)
class LightSource:
    """Weighted points of a disc, in radii of the objective's pupil."""

    x: FloatArray  # (N,)
    y: FloatArray  # (N,)
    weight: FloatArray  # (N,), adding up to 1 over the points within the pupil


def source_error(samples: int) -> float:
    """Return what `samples` rings cost in an image, of unit contrast.

    1.5 / samples**2. Points at a distance d of each other light up spots 1 / d
    wavelengths over A apart as if they were one, so edges that far from each other
    interfere when they should not; the bound holds for a gear of 100 um, a field of
    81 small discs and a rectangle (measured by `benchmarks.optics.coherence`).
    """
    if samples < 1:
        raise ValueError(f"samples must be at least 1, got {samples}")
    return 1.5 / samples**2


def disc_source(coherence: float, samples: int, *, half: bool = False) -> LightSource:
    """Return rings of points that fill the condenser's disc evenly.

    Parameters
    ----------
    coherence : float
        Radius of the disc, in radii of the pupil.
    samples : int
        Rings to a radius of the pupil; each disc or annulus has two more.
    half : bool
        Only one point of each pair s, -s, with the weight of both.

    Returns
    -------
    LightSource
        Gauss nodes over the squared radius, from 0 to 1 and from there on, as the
        direct light ends at 1; the points of a ring are even in number and equally far
        apart, and each ring is rotated against the last.

    Raises
    ------
    ValueError
        If `coherence` is not positive and finite, or `samples` below 1.
    """
    if not (coherence > 0 and math.isfinite(coherence)):
        raise ValueError(f"coherence must be positive and finite, got {coherence}")
    if samples < 1:
        raise ValueError(f"samples must be at least 1, got {samples}")
    direct = min(coherence, 1.0)
    rings = _disc(direct, samples)
    if coherence > 1:
        rings += _annulus(coherence, samples)
    x, y, weight = [], [], []
    for i, (radius, share, apart) in enumerate(rings):
        count = 2 * max(1, math.ceil(math.pi * radius / apart))
        pick = count // 2 if half else count
        turn = 2 * np.pi / count * (np.arange(pick) + (i + 0.5) * _GOLDEN)
        x.append(radius * np.cos(turn))
        y.append(radius * np.sin(turn))
        weight.append(np.full(pick, share / pick))
    return LightSource(
        x=np.concatenate(x), y=np.concatenate(y), weight=np.concatenate(weight)
    )


def _disc(radius: float, samples: int) -> list[tuple[float, float, float]]:
    """Return radius, weight and distance of a disc's rings; weights add to 1."""
    count = math.ceil(radius * samples) + 2
    nodes, weights = np.polynomial.legendre.leggauss(count)
    radii = radius * np.sqrt((1 + nodes) / 2)
    return [
        (float(r), float(w) / 2, radius / count)
        for r, w in zip(radii, weights, strict=True)
    ]


def _annulus(outer: float, samples: int) -> list[tuple[float, float, float]]:
    """Return the same of the annulus from 1 on, weighted by area over the pupil's."""
    count = math.ceil((outer - 1) * samples) + 2
    nodes, weights = np.polynomial.legendre.leggauss(count)
    area = outer**2 - 1
    radii = np.sqrt(1 + area * (1 + nodes) / 2)
    return [
        (float(r), float(w) / 2 * area, (outer - 1) / count)
        for r, w in zip(radii, weights, strict=True)
    ]
