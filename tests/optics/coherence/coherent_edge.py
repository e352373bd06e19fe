"""A straight edge in partially coherent light, in one dimension: slow, to compare with.

Lengths are in wavelengths over A and frequencies in A over wavelengths, so the pupil's
radius is 1, that of the condenser is the coherence. The bright half is x > 0.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import sici

from microplan.arrays import ComplexArray, FloatArray

Phase = Callable[[FloatArray], FloatArray]  # squared pupil radius -> rad


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeImage:
    """The two parts of every edge's image, (N,) each.

    A step of the amplitude from a to b has the intensity
    a**2 + 2 a (b - a) linear + (b - a)**2 full.
    """

    linear: FloatArray  # of the weak edge
    full: FloatArray  # of the edge over black

    def intensity(self, contrast: float) -> FloatArray:
        """Return the image of a step from 1 - contrast to 1 in amplitude."""
        dark = 1 - contrast
        image: FloatArray = (
            dark**2 + 2 * dark * contrast * self.linear + contrast**2 * self.full
        )
        return image


def no_phase(rho2: FloatArray) -> FloatArray:
    """Return the phase in focus, 0."""
    return np.zeros_like(rho2)


def quadratic(waves: float) -> Phase:
    """Return the phase of a defocus W20 in waves."""
    return lambda rho2: 2 * np.pi * waves * rho2


def abbe_edge(
    x: FloatArray, coherence: float, phase: Phase = no_phase, *, nodes: int = 40
) -> EdgeImage:
    """Return the image of an edge, source point by source point.

    Parameters
    ----------
    x : (N,) float array
        Distance from the edge, wavelength / A.
    coherence : float
        Condenser over objective aperture, > 0.
    phase : callable
        Phase of the pupil over the squared radius.
    nodes : int
        Gauss nodes on each axis of each piece of the source, and three times as many
        along the pupil.

    Notes
    -----
    Along one source point's chord of the pupil the amplitude is the principal value of
    exp(2 pi i f x) / (2 pi i f), whose integral is closed where the phase is constant.
    What the phase adds has no pole, and Gauss nodes take it.
    """
    linear, full = np.zeros_like(x), np.zeros_like(x)
    total = 0.0
    for sx, sy, weight in _source(coherence, nodes):
        half = np.sqrt(1 - sy**2)
        edge = _amplitude(x, sx, half, sy, phase, 3 * nodes)
        full += weight * np.abs(edge) ** 2
        if abs(sx) < half:  # the uniform field passes
            total += weight
            turn = np.exp(-1j * phase(np.array([sx**2 + sy**2])))
            linear += weight * (edge * turn).real
    return EdgeImage(linear=linear / total, full=full / total)


def _source(coherence: float, nodes: int) -> Iterator[tuple[float, float, float]]:
    """Yield (sx, sy, weight) over the half y > 0 of the condenser's disc."""
    t, wt = np.polynomial.legendre.leggauss(nodes)
    t, wt = (1 + t) * np.pi / 4, wt * np.pi / 4
    ends, share = np.sin(t) ** 2, wt * np.sin(2 * t)  # 0..1, close at both ends
    top = min(coherence, 1.0)
    for sy, wy in zip(top * ends, top * share, strict=True):
        right, half = np.sqrt(coherence**2 - sy**2), np.sqrt(1 - sy**2)
        stops = [-right, right]
        if right > half:  # beyond lies the dark field, with a logarithm at the border
            stops = [-right, -half, half, right]
        for low, high in itertools.pairwise(stops):
            for e, w in zip(ends, share, strict=True):
                yield low + (high - low) * e, sy, wy * w * (high - low)


def _amplitude(
    x: FloatArray, sx: float, half: float, sy: float, phase: Phase, nodes: int
) -> ComplexArray:
    """Return the amplitude image of one source point, (N,)."""
    low, high = -half - sx, half - sx
    nearest = min(max(0.0, low), high)  # where the pole is, or next to it
    held = phase(np.array([(nearest + sx) ** 2 + sy**2]))[0]
    # the principal value of the integral of exp(2 pi i f x) / (2 pi i f)
    si_high, ci_high = _sici(2 * np.pi * x, high)
    si_low, ci_low = _sici(2 * np.pi * x, low)
    image = (si_high - si_low) / (2 * np.pi) - 0.5j * (ci_high - ci_low) / np.pi
    if low < 0 < high:
        image = image + 0.5
    image = image * np.exp(1j * held)
    if phase is no_phase:
        return np.asarray(image, dtype=np.complex128)
    f, w = np.polynomial.legendre.leggauss(nodes)
    f, w = low + (high - low) * (1 + f) / 2, w * (high - low) / 2
    rest = np.exp(1j * phase((f + sx) ** 2 + sy**2)) - np.exp(1j * held)
    waves = np.exp(2j * np.pi * x[:, None] * f)
    extra: ComplexArray = image + waves @ (w * rest / (2j * np.pi * f))
    return extra


def _sici(x: FloatArray, f: float) -> tuple[FloatArray, FloatArray]:
    """Return Si(f x) and Ci(|f x|) without its ln |x|, which cancels between ends."""
    q = np.abs(f * x)
    si, ci = sici(np.maximum(q, 1e-9))
    flat = np.euler_gamma + np.log(abs(f))
    log = np.log(np.where(x == 0, 1.0, np.abs(x)))
    return np.sign(f * x) * si, np.where(q < 1e-9, flat, ci - log)
