"""The transfer functions of `optics.transfer.otf`, in high precision by mpmath."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

Number = Any  # mpmath has no types


def mpmath() -> Any:
    """Return the module, which has no types; tests and `--page` do without it."""
    return import_module("mpmath")


def diffraction(x: float) -> Number:
    """Return the overlap of two discs: (2 / pi) (acos x - x sqrt(1 - x**2))."""
    mp = mpmath()
    s = mp.mpf(x)
    return 2 / mp.pi * (mp.acos(s) - s * mp.sqrt(1 - s * s)) if s < 1 else mp.mpf(0)


def jinc(q: Number) -> Number:
    """Return 2 J1(q) / q."""
    mp = mpmath()
    return 2 * mp.besselj(1, q) / q if q else mp.mpf(1)


def geometric(x: float, w: float) -> Number:
    """Return jinc(8 pi w x)."""
    mp = mpmath()
    return jinc(8 * mp.pi * mp.mpf(w) * mp.mpf(x))


def product(x: float, w: float) -> Number:
    """Return `diffraction` times `geometric`."""
    return diffraction(x) * geometric(x, w)


def stokseth(x: float, w: float) -> Number:
    """Return `diffraction` times jinc(8 pi w x (1 - x))."""
    mp = mpmath()
    s = mp.mpf(x)
    return diffraction(x) * jinc(8 * mp.pi * mp.mpf(w) * s * (1 - s))


def hopkins(x: float, w: float) -> Number:
    """Integrate (4 / pi) sqrt(1 - (x + t)**2) cos(b t) up the imaginary axis.

    The integral over 0..T of an analytic function is that from 0 to i infinity less
    that from T; exact, no asymptotics. Few waves are integrated on the real axis.
    """
    mp = mpmath()
    s = mp.mpf(x)
    if s >= 1:
        return mp.mpf(0)
    b = 8 * mp.pi * mp.mpf(w) * s
    T = 1 - s

    def height(t: Number) -> Number:
        return mp.sqrt((1 - s - t) * (1 + s + t))

    if b * T < 200:
        cuts = mp.linspace(0, T, 2 + int(b * T / 6))
        return 4 / mp.pi * mp.quad(lambda t: height(t) * mp.cos(b * t), cuts)

    def leg(start: Number) -> Number:
        return mp.quad(
            lambda q: height(start + 1j * q / b) * mp.exp(-q),
            [0, 1, 5, 20, 60, 130],
        )

    turned = 1j / b * (leg(mp.mpf(0)) - mp.expj(b * T) * leg(T))
    return 4 / mp.pi * mp.re(turned)


def exact(
    x: float, z_um: float, aperture: float, index: float = 1.0, lam: float = 0.6
) -> Number:
    """Integrate the pupils' overlap in two dimensions, in Cartesian coordinates."""
    mp = mpmath()
    s, A, n = mp.mpf(x), mp.mpf(aperture), mp.mpf(index)
    kz = 2 * mp.pi * mp.mpf(z_um) / mp.mpf(lam)

    def path(xi: Number, eta: Number) -> Number:
        right = mp.sqrt(n**2 - A**2 * ((xi + s) ** 2 + eta**2))
        left = mp.sqrt(n**2 - A**2 * ((xi - s) ** 2 + eta**2))
        return 4 * A**2 * xi * s / (right + left)

    top = mp.sqrt(1 - s**2)
    with mp.workdps(24):
        value = mp.quad(
            lambda xi, eta: (
                (mp.sqrt(1 - eta**2) - s)
                * mp.cos(kz * path(xi * (mp.sqrt(1 - eta**2) - s), eta))
            ),
            [0, 1],
            [0, top],
        )
    return 4 / mp.pi * value


def model_at(model: str, x: float, z_um: float, aperture: float = 0.42) -> Number:
    """Return a rung's transfer at A, n = 1 and .6 um."""
    mp = mpmath()
    A = mp.mpf(aperture)
    near = mp.mpf(z_um) * A**2 / 2 / mp.mpf(0.6)
    rim = mp.mpf(z_um) * (1 - mp.sqrt(1 - A**2)) / mp.mpf(0.6)
    models: dict[str, Callable[[], Number]] = {
        "geometric": lambda: geometric(x, near),
        "product": lambda: product(x, near),
        "stokseth": lambda: stokseth(x, rim),
        "hopkins": lambda: hopkins(x, rim),
        "exact": lambda: exact(x, z_um, aperture),
    }
    return models[model]()
