"""Exact images to compare with: no spreading, no folding, no cut of the band.

The transfer is 0 beyond the cutoff, so a periodic image is a finite sum of waves. Here
every coefficient is a plain sum over boundary nodes and every pixel a plain sum over
all waves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from optics.clip import to_edges
from optics.microscope import Microscope
from optics.outline import Outline
from optics.spectrum import boundary_nodes

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
Transfer = Callable[[FloatArray], FloatArray]  # share of the cutoff -> transfer

_MARGIN_UM = 300.0  # over 400 wavelengths / A to the next repetition of a small part
_BATCH = 512  # nodes summed at once, to bound memory
_STEP_RAD = 0.1  # of phase between two knots: cubics then err by less than 1e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class Oracle:
    """One outline's coefficients up to the cutoff, on a tile about the origin."""

    microscope: Microscope
    u_per_um: FloatArray  # (J + 1,) from 0
    v_per_um: FloatArray  # (2 K + 1,) from -K
    values: ComplexArray  # (2 K + 1, J + 1), of exp(2 pi i (u x + v y))

    @classmethod
    def of(cls, outline: Outline, microscope: Microscope) -> Self:
        """Return the oracle for a part that lies about the origin."""
        x_min, y_min, x_max, y_max = outline.bounds_um
        field = microscope.field_um
        width, height = (
            max(field[i], 2 * max(-low, high)) + _MARGIN_UM
            for i, (low, high) in enumerate(((x_min, x_max), (y_min, y_max)))
        )
        cutoff = microscope.cutoff_per_um
        u = np.arange(int(cutoff * width) + 1) / width
        K = int(cutoff * height)
        v = np.arange(-K, K + 1) / height
        values = _transform(outline, u, v, 2 * cutoff) / (width * height)
        return cls(microscope=microscope, u_per_um=u, v_per_um=v, values=values)

    def image(self, transfer: Transfer) -> FloatArray:
        """Return the whole frame of a white part over black, (rows, columns)."""
        m = self.microscope
        x = np.hypot(self.u_per_um, self.v_per_um[:, None]) / m.cutoff_per_um
        gain = np.where(x < 1, transfer(np.minimum(x, 1.0)), 0.0)
        side = m.um_per_px * np.sqrt(m.fill_factor)
        gain *= np.sinc(self.u_per_um * side) * np.sinc(self.v_per_um * side)[:, None]
        columns = (np.arange(m.width_px) - (m.width_px - 1) / 2) * m.um_per_px
        rows = ((m.height_px - 1) / 2 - np.arange(m.height_px)) * m.um_per_px
        right = np.exp(2j * np.pi * self.u_per_um[:, None] * columns)
        right[1:] *= 2  # the other half of the waves is the conjugate
        up = np.exp(2j * np.pi * rows[:, None] * self.v_per_um)
        image: FloatArray = ((up @ (self.values * gain)) @ right).real
        return image


def tabulated(exact: Transfer, waves: float) -> Transfer:
    """Return a slow transfer as a cubic table over sqrt(1 - x), smooth to the end.

    Parameters
    ----------
    exact : callable of (N,) floats in 0..1
        The transfer.
    waves : float
        Its W20, which says how fast it turns.
    """
    knots = np.linspace(0, 1, 129 + int(16 * np.pi * abs(waves) / _STEP_RAD))
    spline = CubicSpline(knots, exact(1 - knots**2))

    def read(x: FloatArray) -> FloatArray:
        found: FloatArray = spline(np.sqrt(1 - x))
        return found

    return read


def _transform(
    outline: Outline, u: FloatArray, v: FloatArray, density_per_um: float
) -> ComplexArray:
    """Return the outline's Fourier integral at all (v, u), um2, by plain sums."""
    x, y, dx, dy = boundary_nodes(to_edges(outline), density_per_um)
    total = np.zeros((v.size, u.size), dtype=np.complex128)
    edge = np.zeros(v.size, dtype=np.complex128)
    for start in range(0, x.size, _BATCH):
        part = slice(start, start + _BATCH)
        along_y = np.exp(-2j * np.pi * v[:, None] * y[part])
        along_x = np.exp(-2j * np.pi * x[part, None] * u)
        total += (along_y * dy[part]) @ along_x
        edge -= along_y @ dx[part]
    total[:, 1:] *= 1j / (2 * np.pi * u[1:])
    away = v != 0
    total[away, 0] = edge[away] * 1j / (2 * np.pi * v[away])
    total[~away, 0] = outline.area_um2
    return total
