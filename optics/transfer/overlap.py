"""The overlap of two shifted pupils: OTFs with a defocus phase, as one integral.

Where two pupils overlap, the defocus phase is b t with t = 0 on the line between their
centres. The OTF collects the overlap by t, (4 / pi) times the integral over 0..T of
m(t) cos(b t), with m and T depending on the frequency alone. For the exact phase too
m is elementary (`HighAperture`), so that it costs little more than the paraxial one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import roots_genlaguerre

from microplan.arrays import FloatArray

# real on the axis, complex on the paths of steepest descent
Values = npt.NDArray[np.float64] | npt.NDArray[np.complex128]

# Phase b T, rad, that n Gauss nodes in sqrt(1 - t / T) integrate to 1e-15 (tested).
_RULES = tuple(
    (limit, *np.polynomial.legendre.leggauss(size))
    for size, limit in ((16, 2.0), (24, 10.0), (32, 22.0), (48, 50.0), (64, 80.0))
)
_LIMITS = np.array([limit for limit, _, _ in _RULES])
_NEAR_RULE = 2  # the least rule where a panel is as wide as a pole is far
_BATCH = 1 << 14  # quadrature points held at once: they stay in the cache
# From this phase to the nearest singularity of m on, steepest descent errs by < 1e-14
# (tested); from 40 on six nodes do as well as 32.
_STEEP_RAD = 60.0
_FLAT_NODES, _FLAT_WEIGHTS = roots_genlaguerre(10, 0.0)  # where m is smooth
_ROOT_NODES, _ROOT_WEIGHTS = roots_genlaguerre(10, 0.5)  # where m goes like a root
_ROOT_WEIGHTS = _ROOT_WEIGHTS / np.sqrt(_ROOT_NODES)


@dataclass(frozen=True, slots=True)
class Paraxial:
    """A quadratic phase: t = e, the distance along the shift, and m the half height."""

    @property
    def scale(self) -> float:
        """Return infinity: m has no pole."""
        return math.inf

    def top(self, s: FloatArray) -> FloatArray:
        """Return T = 1 - s, (N, 1) [1]."""
        return 1 - s

    def rise(self, s: FloatArray, _t: FloatArray, dt: Values) -> Values:
        """Return e's change from t to t + dt, `dt`, (N, M) [1]."""
        return dt + np.zeros_like(s)

    def density(self, _s: FloatArray, _t: Values, half: Values) -> Values:
        """Return m, the half height of the overlap, (N, M) [1]."""
        return half


@dataclass(frozen=True, slots=True, kw_only=True)
class HighAperture:
    """The exact phase, s t = sqrt(n**2 - A**2 rho_1**2) - sqrt(n**2 - A**2 rho_2**2).

    rho_1, rho_2 are the distances from the two pupils' centres. The lines of equal t
    are xi = t / (2 A) sqrt((E - 4 A**2 eta**2) / d) with E = 4 n**2 - 4 A**2 s**2 -
    s**2 t**2 and d = 4 A**2 + t**2, and m is the integral of d xi / d t over eta up to
    the rim, which is elementary.
    """

    aperture: float
    index: float

    @property
    def scale(self) -> float:
        """Return 2 A: d = 0 at t = 2 i A."""
        return 2 * self.aperture

    @property
    def _axial(self) -> float:
        """Return sqrt(n**2 - A**2)."""
        n, A = self.index, self.aperture
        return math.sqrt((n - A) * (n + A))

    def top(self, s: FloatArray) -> FloatArray:
        """Return T, t at the rim on the axis of the shift, (N, 1) [1]."""
        A, c = self.aperture, self._axial
        top: FloatArray = (
            4 * A**2 * (1 - s) / (np.sqrt(c**2 + 4 * A**2 * s * (1 - s)) + c)
        )
        return top

    def rise(self, s: FloatArray, t: FloatArray, dt: Values) -> Values:
        """Return e's change from t to t + dt, (N, M) [1].

        e = t (s t + 2 sqrt(n**2 - A**2)) / (4 A**2), from 0 to 1 - s.
        """
        rise: Values = (
            dt * (s * (2 * t + dt) + 2 * self._axial) / (4 * self.aperture**2)
        )
        return rise

    def density(self, s: FloatArray, t: Values, half: Values) -> Values:
        """Return m at t, (N, M) [1], with `half` = sqrt(1 - (s + e)**2)."""
        A = self.aperture
        d = 4 * A**2 + t**2
        edge = s * t + 2 * self._axial
        root = np.sqrt(d)
        rim = edge * root / (2 * A)  # sqrt(E - 4 A**2 half**2), uncancelled
        across = 2 * A * half
        E = rim**2 + across**2
        angle = _arc_tangent(across, rim)
        flat = half * edge / (2 * d) + E * angle / (2 * d * root)
        bent = (s * t) ** 2 * angle / (4 * A**2 * root)
        density: Values = flat - bent
        return density


Overlap = Paraxial | HighAperture  # two pupils' overlap by its coordinate t


def overlap(pupils: Overlap, s: FloatArray, phase: FloatArray) -> FloatArray:
    """Return the OTF at frequencies `s` with the phase `phase` t.

    Parameters
    ----------
    pupils : Overlap
        The overlap with its phase.
    s : (N,) float64 array
        Radial frequencies over the cutoff, 0..1.
    phase : (N,) float64 array
        b >= 0, rad per unit of t.

    Returns
    -------
    (N,) float64 array
        Within 1e-13 of the exact value; the cost does not grow with the phase once
        that is large.

    References
    ----------
    Huybrechs & Vandewalle (2006), SIAM J. Numer. Anal. 44, 1026, for the paths of
    steepest descent.
    """
    otf = np.empty_like(s)
    top = pupils.top(s[:, None])[:, 0]
    steep = phase * np.minimum(top, pupils.scale) > _STEEP_RAD
    for part in _batches(np.flatnonzero(steep), 2 * _FLAT_NODES.size):
        otf[part] = _descend(pupils, s[part, None], phase[part, None])
    whole = phase * top
    # a panel no wider than a pole's distance, and with a phase that a rule can take
    panels = np.maximum(np.ceil(whole / _LIMITS[-1]), np.ceil(top / pupils.scale))
    panels = np.maximum(panels, 1).astype(int)
    rule = np.searchsorted(_LIMITS, np.minimum(whole / panels, _LIMITS[-1]))
    rule = np.where(top > pupils.scale / 4, np.maximum(rule, _NEAR_RULE), rule)
    kind = panels * len(_RULES) + rule
    for each in np.unique(kind[~steep]):
        count, index = divmod(int(each), len(_RULES))
        v, weight = _panels(count, index)
        for part in _batches(np.flatnonzero(~steep & (kind == each)), v.size):
            otf[part] = _collect(pupils, s[part, None], phase[part, None], v) @ weight
    return 4 / np.pi * otf


def _batches(where: npt.NDArray[np.intp], nodes: int) -> list[npt.NDArray[np.intp]]:
    """Cut indices into parts that bound the memory taken."""
    if not where.size:
        return []
    return np.array_split(where, math.ceil(where.size * nodes / _BATCH))


def _panels(count: int, index: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes 0..1 and weights of `count` panels, finer towards 1."""
    _, nodes, weights = _RULES[index]
    # equal steps of t = T (1 - v**2): the phase of each panel is the same
    bounds = np.sqrt(np.arange(count + 1) / count)
    width = np.diff(bounds)[:, None]
    v = bounds[:-1, None] + width * (1 + nodes) / 2
    return v.ravel(), (width * weights / 2).ravel()


def _collect(
    pupils: Overlap, s: FloatArray, phase: FloatArray, v: FloatArray
) -> FloatArray:
    """Return the integrand over v, t = T (1 - v**2), (N, nodes)."""
    top = pupils.top(s)
    down = -top * v**2
    fall = np.real(pupils.rise(s, top, down))
    half = np.sqrt(np.maximum(-fall * (2 + fall), 0))
    t = top + down
    value: FloatArray = (
        2 * top * v * np.real(pupils.density(s, t, half)) * np.cos(phase * t)
    )
    return value


def _descend(pupils: Overlap, s: FloatArray, phase: FloatArray) -> FloatArray:
    """Integrate along the paths of steepest descent from both ends, (N, 1) to (N,)."""
    top, low = pupils.top(s), np.zeros_like(s)
    step = np.asarray(1j * _FLAT_NODES / phase, dtype=np.complex128)
    e = pupils.rise(s, low, step)
    half = np.sqrt((1 - s - e) * (1 + s + e))
    first = pupils.density(s, step, half) @ _FLAT_WEIGHTS
    step = np.asarray(1j * _ROOT_NODES / phase, dtype=np.complex128)
    fall = pupils.rise(s, top, step)
    half = np.sqrt(-fall * (2 + fall))
    last = pupils.density(s, top + step, half) @ _ROOT_WEIGHTS
    b = phase[:, 0]
    total: FloatArray = np.real(1j / b * (first - last * np.exp(1j * b * top[:, 0])))
    return total


def _arc_tangent(across: Values, along: Values) -> Values:
    """Return atan(across / along) in 0..pi/2, or its continuation.

    Real lengths are not negative.
    """
    if not (np.iscomplexobj(across) or np.iscomplexobj(along)):
        return np.asarray(np.arctan2(across, along), dtype=np.float64)
    steep = np.abs(across) > np.abs(along)
    ratio = np.where(steep, along, across) / np.where(steep, across, along)
    angle = np.arctan(ratio)
    value: Values = np.where(steep, np.pi / 2 - angle, angle)
    return value
