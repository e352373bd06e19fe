"""Optical transfer functions of a circular pupil, in focus and out of it.

All are functions of x, the radial frequency over the cutoff 2 A / wavelength, and of
w, the defocus coefficient W20 in waves. All are 1 at x = 0 and even in x and w.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.special import j1

from optics.microscope import Microscope

FloatArray = npt.NDArray[np.float64]
Curve = Callable[[FloatArray], FloatArray]  # x -> transfer

# Periods of the phase that n Gauss nodes integrate to 1e-14 (computed for all x).
_RULES = tuple(
    (limit, *np.polynomial.legendre.leggauss(size))
    for size, limit in ((12, 0.4), (16, 1.4), (24, 4.5), (32, 8.0), (48, 16.0))
)
_BATCH = 1 << 20  # quadrature points held at once
# One table step turns the phase by this much at most; the interpolation then errs
# by less than 2e-5 of the contrast for w up to 300 (tested).
_STEP_RAD = 0.15


def diffraction(x: FloatArray) -> FloatArray:
    """Return the in-focus OTF of a circular pupil.

    Parameters
    ----------
    x : (...) float array
        Radial frequency over the cutoff, f wavelength / (2 A) [1].

    Returns
    -------
    (...) float64 array
        1 at 0, falling to 0 at 1 and beyond.

    Raises
    ------
    ValueError
        If `x` holds a nan.

    References
    ----------
    Feddema & Simon (1998), eq. (12), divided by its value at 0 (pi a**2).
    """
    s = np.minimum(_checked(x), 1.0)
    y = 4 * np.arcsin(np.sqrt((1 - s) / 2))  # 2 acos(s), exact where s is near 1
    tail = y**3 / 6 * (1 - y**2 / 20 * (1 - y**2 / 42 * (1 - y**2 / 72)))
    otf: FloatArray = (
        np.where(y < 0.1, tail, y - np.sin(y)) / np.pi
    )  # y - sin y cancels
    return otf


def geometric(x: FloatArray, w: float) -> FloatArray:
    """Return the OTF of a uniform blur circle, with no diffraction.

    Parameters
    ----------
    x : (...) float array
        Radial frequency over the cutoff [1]; not zero beyond 1.
    w : float
        W20 in waves; the circle's diameter is 4 w wavelength / A.

    Returns
    -------
    (...) float64 array
        jinc(8 pi w x), between -.133 and 1.

    Raises
    ------
    ValueError
        If an argument holds a nan.

    References
    ----------
    Feddema & Simon (1998), eqs. (8, 9), with volume 1.
    """
    return _jinc(8 * np.pi * _finite(w) * _checked(x))


def product(x: FloatArray, w: float) -> FloatArray:
    """Return the paper's OTF, `diffraction` times `geometric`.

    It counts diffraction twice and is up to .25 off near w = .35; kept to compare.
    Arguments, result and errors as in `geometric`; 0 beyond x = 1.

    References
    ----------
    Feddema & Simon (1998), section 3, eq. (8) times eq. (12).
    """
    return diffraction(x) * geometric(x, w)


def stokseth(x: FloatArray, w: float) -> FloatArray:
    """Return T(x) jinc(8 pi w x (1 - x)), a close approximation of `hopkins`.

    Arguments, result and errors as in `geometric`; 0 beyond x = 1.

    References
    ----------
    Stokseth (1969), J. Opt. Soc. Am. 59, 1314, without its empirical polynomial.
    """
    s = np.minimum(_checked(x), 1.0)
    return diffraction(s) * _jinc(8 * np.pi * _finite(w) * s * (1 - s))


def hopkins(x: FloatArray, w: float) -> FloatArray:
    """Return the OTF of a circular pupil with a quadratic defocus phase.

    Parameters
    ----------
    x : (...) float array
        Radial frequency over the cutoff [1].
    w : float
        W20 in waves. The time taken grows with |w|.

    Returns
    -------
    (...) float64 array
        1 at 0, 0 at 1 and beyond; `diffraction` where w = 0. Error below 1e-13
        up to |w| = 100.

    Raises
    ------
    ValueError
        If an argument holds a nan or `w` is infinite.

    References
    ----------
    Hopkins (1955), Proc. R. Soc. Lond. A 231, 91: (4 / pi) times the integral over
    p in 0..acos x of sin(p)**2 cos(8 pi w x (cos p - x)).
    """
    s = np.minimum(_checked(x), 1.0).ravel()
    rim = 2 * np.arcsin(np.sqrt((1 - s) / 2))  # acos(s), exact where s is near 1
    periods = 4 * abs(_finite(w)) * s * np.sin(rim) * rim
    panels = np.maximum(np.ceil(periods / _RULES[-1][0]), 1).astype(int)
    rule = np.searchsorted([limit for limit, _, _ in _RULES], periods / panels)
    kind = panels * len(_RULES) + rule
    otf = np.empty_like(s)
    for each in np.unique(kind):
        count, index = divmod(int(each), len(_RULES))
        _, nodes, weights = _RULES[index]
        u = (np.arange(count)[:, None] + (1 + nodes) / 2).ravel() / count
        weight = np.tile(weights / (2 * count), count)
        where = np.flatnonzero(kind == each)
        for part in np.array_split(where, math.ceil(where.size * u.size / _BATCH)):
            otf[part] = _overlap(s[part], rim[part], w, u, weight)
    return otf.reshape(np.shape(x))


def _overlap(
    s: FloatArray, rim: FloatArray, w: float, u: FloatArray, weight: FloatArray
) -> FloatArray:
    """Integrate Hopkins' overlap with nodes `u` of 0..rim; (N,) to (N,)."""
    q = np.sin(rim[:, None] / 2 * u) ** 2  # p = rim u: cos p = 1 - 2 q
    wave = np.cos(8 * np.pi * w * s[:, None] * ((1 - s)[:, None] - 2 * q))
    otf: FloatArray = 4 / np.pi * rim * ((4 * q * (1 - q) * wave) @ weight)
    return otf


def _rim_waves(microscope: Microscope, z_um: float) -> float:
    return microscope.rim_w20_um(z_um) / microscope.wavelength_um


def _paraxial_waves(microscope: Microscope, z_um: float) -> float:
    return microscope.paraxial_w20_um(z_um) / microscope.wavelength_um


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """One rung of the ladder of defocus laws."""

    curve: Callable[[Microscope, float], Curve]  # (microscope, z_um) -> x -> transfer
    diffracts: bool  # 0 beyond the cutoff


MODELS: Mapping[str, Model] = MappingProxyType(
    {
        "geometric": Model(
            curve=lambda m, z: lambda x: geometric(x, _paraxial_waves(m, z)),
            diffracts=False,
        ),
        "product": Model(
            curve=lambda m, z: lambda x: product(x, _paraxial_waves(m, z)),
            diffracts=True,
        ),
        "stokseth": Model(
            curve=lambda m, z: lambda x: stokseth(x, _rim_waves(m, z)),
            diffracts=True,
        ),
        "hopkins": Model(
            curve=lambda m, z: lambda x: hopkins(x, _rim_waves(m, z)),
            diffracts=True,
        ),
    }
)


def find_model(model: str) -> Model:
    """Return the rung called `model`; ValueError with the known names otherwise."""
    if model not in MODELS:
        raise ValueError(f"model must be one of {', '.join(MODELS)}, got {model!r}")
    return MODELS[model]


def transfer(
    model: str, microscope: Microscope, z_um: float, f_per_um: FloatArray
) -> FloatArray:
    """Return the transfer of `model` for a defocus, without table or interpolation.

    Parameters
    ----------
    model : str
        A key of `MODELS`.
    microscope : Microscope
        The optical setting.
    z_um : float
        Height of the object minus that of the plane in focus.
    f_per_um : (...) float array
        Radial frequency in object space, cycles/um.

    Returns
    -------
    (...) float64 array
        1 at frequency 0. `product` and `geometric` take the paraxial W20, as the
        paper does, the others the rim-matched one.

    Raises
    ------
    ValueError
        If the model is unknown or an argument holds a nan.
    """
    return find_model(model).curve(microscope, z_um)(
        np.asarray(f_per_um, dtype=np.float64) / microscope.cutoff_per_um
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RadialTable:
    """A transfer function tabulated over sqrt(1 - x), where it is smooth.

    In x itself the end at x = 1 goes like (1 - x)**1.5 and spoils the interpolation.
    """

    first: float  # sqrt(1 - x) of the first node
    step: float
    pieces: FloatArray  # (4, N) cubic coefficients, the highest power first

    def read(self, x: FloatArray) -> FloatArray:
        """Return the transfer at `x` (...), held at the ends outside the table."""
        t = (np.sqrt(np.maximum(1 - x, 0)) - self.first) / self.step
        i = np.clip(t.astype(np.intp), 0, self.pieces.shape[1] - 1)
        t = np.clip(t - i, 0.0, 1.0) * self.step
        c3, c2, c1, c0 = (row[i] for row in self.pieces)
        value: FloatArray = ((c3 * t + c2) * t + c1) * t + c0
        return value


@lru_cache(maxsize=64)  # layers of one height and draws of one focus share theirs
def tabulate(
    model: str, microscope: Microscope, z_um: float, x_max: float = 1.0
) -> RadialTable:
    """Return the table of `transfer` for x in 0..`x_max`.

    Its cubic interpolation errs by less than 2e-5; see `transfer` for the rest.
    """
    if not 0 < x_max <= 1:
        raise ValueError(f"x_max must be in (0, 1], got {x_max}")
    first = math.sqrt(1 - x_max)
    rate = 16 * math.pi * abs(_rim_waves(microscope, z_um))  # rad per sqrt(1 - x)
    count = 96 + math.ceil(rate * (1 - first) / _STEP_RAD)
    s = np.linspace(first, 1.0, count)
    spline = CubicSpline(s, find_model(model).curve(microscope, z_um)(1 - s**2))
    pieces = np.asarray(spline.c)
    pieces.setflags(write=False)
    return RadialTable(first=first, step=(1 - first) / (count - 1), pieces=pieces)


def _jinc(q: FloatArray) -> FloatArray:
    """Return 2 J1(q) / q, by its series where q is small."""
    q = np.abs(q)
    small, large = np.minimum(q, 1e-3), np.maximum(q, 1e-3)
    value: FloatArray = np.where(q < 1e-3, 1 - small**2 / 8, 2 * j1(large) / large)
    return value


def _checked(x: FloatArray) -> FloatArray:
    """Return |x| as float64; a nan is refused."""
    values = np.abs(np.asarray(x, dtype=np.float64))
    if np.isnan(values).any():
        raise ValueError("x must not hold nan")
    return values


def _finite(w: float) -> float:
    """Return `w`; nan and infinity are refused."""
    if not math.isfinite(w):
        raise ValueError(f"w must be finite, got {w}")
    return w
