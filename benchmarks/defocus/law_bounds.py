"""Bounds of what a defocus law costs in an image, for any outline: the law table.

`python -m benchmarks.defocus.law_bounds` writes `model_error_table.py` beside it anew.
An image of a part of unit contrast is off by the integral of dh, the difference of two
point spreads, over the part; as dh has no volume, no part makes that more than half the
integral of |dh|, and concentric rings make it just that. With pixels p wide the same
holds for dh averaged over a pixel."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy import fft
from scipy.interpolate import CubicSpline
from scipy.special import j0

from microplan.arrays import FloatArray
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import MODELS

TARGET = Path(__file__).with_name("model_error_table.py")
LAWS = tuple(model for model in MODELS if model != "exact")
WAVES = np.geomspace(0.01, 1000, 21)
STEEPNESS = np.array([0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.75, 0.85, 0.95, 0.99])  # A / n
PIXEL_WAVES = WAVES[:13]  # up to 10: further out blurs outgrow pixels
PIXELS: FloatArray = np.array(
    [0.25, 0.5, 1, 2, 4, 8, 16, 32]
)  # widths in wavelengths over A
ROUND_UP = 1.1  # for what interpolation between the nodes errs by (tested)
_DENSE = 40.0  # radius up to which every ripple is sampled
_SPARSE = 5000  # rings at random places beyond it: 1.5 % of the integral, one sigma
_GRID = 0.25  # sampling of the plane, the Nyquist distance


def setting(steepness: float) -> Microscope:
    """Return optics whose unit of length, wavelength over A, is 1 um and n is 1."""
    return Microscope(
        aperture=steepness,
        wavelength_um=steepness,
        medium_index=1.0,
        magnification=1.0,
        pitch_um=1e-3,
        width_px=1,
        height_px=1,
    )


def defocus_um(optics: Microscope, waves: float) -> float:
    """Return the defocus with that W20, matched at the rim, in waves."""
    return waves * optics.wavelength_um / optics.rim_w20_um(1.0)


def differences(
    optics: Microscope, z_um: float, x: FloatArray
) -> dict[str, FloatArray]:
    """Return each law's transfer minus the exact one's at shares `x` of the cutoff."""
    exact = MODELS["exact"].curve(optics, z_um)(x)
    return {law: MODELS[law].curve(optics, z_um)(x) - exact for law in LAWS}


def reach_um(optics: Microscope, z_um: float) -> float:
    """Return the radius within which nearly all of any law's difference lies."""
    return 1.3 * optics.blur_diameter_um(z_um) / 2 + 20 / optics.cutoff_per_um * 2


def frequencies(cutoff: float, radius: float) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights over 0..cutoff for waves out to a radius.

    Gauss nodes, six to a period, in v with f = cutoff (1 - v**2), smooth at cutoff.
    """
    nodes, weights = np.polynomial.legendre.leggauss(32)
    count = 8 + math.ceil(2 * cutoff * radius * 6 / 32)
    v = ((np.arange(count)[:, None] + (1 + nodes) / 2) / count).ravel()
    weight = np.tile(weights / (2 * count), count)
    return cutoff * (1 - v**2), 2 * cutoff * v * weight


def bounds(waves: float, steepness: float) -> dict[str, float]:
    """Return half the integral of |dh| of each law."""
    optics = setting(steepness)
    z_um = defocus_um(optics, waves)
    f, weight = frequencies(optics.cutoff_per_um, reach_um(optics, z_um))
    changes = differences(optics, z_um, f / optics.cutoff_per_um)
    terms = np.stack([2 * np.pi * f * weight * changes[law] for law in LAWS], axis=1)
    r, ring = _rings(reach_um(optics, z_um))
    total = np.zeros(len(LAWS))
    for part in np.array_split(np.arange(r.size), 1 + r.size * f.size // 4_000_000):
        spread = j0(2 * np.pi * r[part, None] * f) @ terms
        total += np.abs(spread).T @ (2 * np.pi * r[part] * ring[part])
    return dict(zip(LAWS, total / 2, strict=True))


def pixel_bounds(
    waves: float, steepness: float, pixels: FloatArray = PIXELS
) -> dict[str, FloatArray]:
    """Return half the integral of |dh averaged over a pixel|, for each pixel."""
    optics = setting(steepness)
    z_um = defocus_um(optics, waves)
    s = np.linspace(0, 1, 400 + int(400 * waves))
    curves = differences(optics, z_um, 1 - s**2)
    found: dict[str, list[float]] = {law: [] for law in LAWS}
    for pixel in pixels:
        half = reach_um(optics, z_um) + pixel
        count = fft.next_fast_len(math.ceil(2 * half / _GRID), real=True)
        u, v = fft.rfftfreq(count, _GRID), fft.fftfreq(count, _GRID)[:, None]
        x = np.hypot(u, v) / optics.cutoff_per_um
        box = np.where(x < 1, np.sinc(u * pixel) * np.sinc(v * pixel), 0)
        root = np.sqrt(np.maximum(1 - x, 0))
        for law in LAWS:
            change = CubicSpline(s, curves[law])(root) * box
            spread = fft.irfft2(change, s=(count, count), overwrite_x=True)
            found[law].append(float(np.abs(spread).sum()) / 2)
    return {law: np.array(values) for law, values in found.items()}


def _rings(radius: float) -> tuple[FloatArray, FloatArray]:
    """Return radii and widths of rings: all near the axis, a sample farther out."""
    dense = np.arange(0.02, min(radius, _DENSE), 0.04)
    if radius <= _DENSE + 0.04 * _SPARSE:
        dense = np.arange(0.02, radius, 0.04)
        return dense, np.full_like(dense, 0.04)
    start = float(dense[-1]) + 0.02
    width = (radius - start) / _SPARSE
    jitter = np.random.default_rng(1).random(_SPARSE)
    far = start + (np.arange(_SPARSE) + jitter) * width
    widths = np.concatenate([np.full_like(dense, 0.04), np.full_like(far, width)])
    return np.concatenate([dense, far]), widths


def _tables() -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Measure both tables, law by law: (waves, steepness)."""
    plain = {law: np.zeros((WAVES.size, STEEPNESS.size)) for law in LAWS}
    pixel = {law: np.zeros((PIXEL_WAVES.size, STEEPNESS.size)) for law in LAWS}
    for i, waves in enumerate(WAVES):
        for j, steepness in enumerate(STEEPNESS):
            for law, bound in bounds(waves, steepness).items():
                plain[law][i, j] = bound
            if i < PIXEL_WAVES.size:
                for law, each in pixel_bounds(waves, steepness).items():
                    pixel[law][i, j] = np.max(each * PIXELS)
        print(f"{waves:.3g} waves done", file=sys.stderr, flush=True)
    return plain, pixel


def _lines(name: str, what: str, tables: dict[str, FloatArray]) -> Iterator[str]:
    """Write tables as the source of a mapping, rounded up to three digits."""
    yield f"# {what}"
    yield f"{name}: Mapping[str, Table] = MappingProxyType("
    yield "    {"
    for law, table in tables.items():
        yield f'        "{law}": ('
        for row in table:
            cells = ", ".join(_up(float(value) * ROUND_UP) for value in row)
            yield f"            ({cells}),"
        yield "        ),"
    yield "    }"
    yield ")"


def _up(value: float) -> str:
    """Write a positive number with two digits, rounded up."""
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.ceil(value / digit - 1e-9) * digit:.2g}"


def main() -> None:
    """Measure and write the table."""
    plain, pixel = _tables()
    waves = ", ".join(f"{value:.17g}" for value in WAVES)
    steep = ", ".join(f"{value:g}" for value in STEEPNESS)
    lines = [
        '"""Error bounds of OTF models, from `benchmarks/defocus/law_bounds.py`."""',
        "",
        "from collections.abc import Mapping",
        "from types import MappingProxyType",
        "",
        "Table = tuple[tuple[float, ...], ...]  # a row per W20, a column per A / n",
        "",
        "# ruff: noqa: E501",
        "# fmt: off",
        f"WAVES = ({waves})",
        f"STEEPNESS = ({steep})",
        *_lines(
            "BOUND", "Half the integral of |difference of point responses|.", plain
        ),
        *_lines("PIXEL", "That times the pixel in wavelength / A, largest.", pixel),
        "# fmt: on",
    ]
    TARGET.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
