"""Gridding of a nonuniform Fourier transform with a Kaiser-Bessel kernel."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.special import i0

from microplan.arrays import FloatArray
from microplan.optics.render.pruned_ifft import fast_length

_WIDTH = 8  # grid points under the gridding kernel
_OVERSAMPLING = 1.25  # of the band grid
# What the kernel folds in, exp(-pi width sqrt(1 - 1 / oversampling)), of the length of
# all edges; in an image of a gear 1e-6.
KERNEL_ERROR = math.exp(-math.pi * _WIDTH * math.sqrt(1 - 1 / _OVERSAMPLING))
_BATCH = 1 << 10  # nodes gridded at once: their 64 products each stay in the cache
_DEGREE = 14  # of the kernel's polynomials: 4e-15 off it, as it is entire


def grid_size(order: int) -> int:
    """Return a fast grid length for orders up to `order`."""
    return fast_length(max(_OVERSAMPLING * (2 * order + 1), 2 * _WIDTH))


def kernel_weights(
    place: FloatArray, size: int
) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """Return grid indices and kernel values of points (N,) in 0..1, (N, M) each.

    M is the width in samples; polynomials are faster than `kernel`.
    """
    exact = place * size
    first = np.ceil(exact - _WIDTH / 2)
    grid = first[:, None] + np.arange(_WIDTH)
    share = _powers(first - exact + _WIDTH / 2) @ _KERNEL
    return grid.astype(np.intp) % size, share


@lru_cache(maxsize=256)  # tiles have few sizes
def kernel_transforms(highest: int, size: int) -> FloatArray:
    """Return the kernel's transform at 0..`highest` cycles a grid, (N,), dimensionless.

    N is `highest` + 1; not to be changed.
    """
    order = np.arange(highest + 1)
    root = np.sqrt(_BETA**2 - (np.pi * _WIDTH * order / size) ** 2)
    transform: FloatArray = _WIDTH * np.sinh(root) / (root * i0(_BETA))
    transform.setflags(write=False)
    return transform


def deposit(
    at_x: npt.NDArray[np.intp],
    share_x: FloatArray,
    at_y: npt.NDArray[np.intp],
    share_y: FloatArray,
    weight: FloatArray,
    shape: tuple[int, int],
) -> FloatArray:
    """Return a grid (rows, columns): kernels (N, M), M samples, by weights (N,)."""
    grid = np.zeros(shape[0] * shape[1])
    for begin in range(0, weight.size, _BATCH):
        part = slice(begin, begin + _BATCH)
        index = at_y[part, :, None] * shape[1] + at_x[part, None, :]
        value = (share_y[part] * weight[part, None])[:, :, None]
        value = value * share_x[part, None, :]
        np.add.at(grid, index.ravel(), value.ravel())
    return grid.reshape(shape)


def kernel(offset: FloatArray) -> FloatArray:
    """Return the kernel (...) at `offset` (...) samples from its middle; 1 there."""
    t = offset / (_WIDTH / 2)
    value: FloatArray = i0(_BETA * np.sqrt(np.maximum(1 - t**2, 0))) / i0(_BETA)
    return value


def _beta(oversampling: float) -> float:
    """Return the kernel's shape, Beatty et al. (2005), eq. (5)."""
    wide = (_WIDTH / oversampling * (oversampling - 0.5)) ** 2
    return math.pi * math.sqrt(wide - 0.8)


_BETA = _beta(_OVERSAMPLING)


def _powers(share: FloatArray) -> FloatArray:
    """Return powers of positions between grid points as -1..1, (N, degree + 1)."""
    powers = np.ones((_DEGREE + 1, share.size))
    np.multiply(share, 2, out=powers[1])
    powers[1] -= 1
    for done in (1, 2, 4, 8):  # all so far, times the highest so far
        more = powers[done + 1 : 2 * done + 1]
        np.multiply(powers[1 : len(more) + 1], powers[done], out=more)
    return powers.T


def _kernel_table() -> FloatArray:
    """Return the kernel at each of its grid points as a polynomial of the position.

    In powers, which err by as little as Chebyshev's polynomials at so low a degree.
    """
    share = (1 + np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))) / 2
    exact = kernel(share[:, None] + np.arange(_WIDTH) - _WIDTH / 2)
    return np.asarray(np.linalg.solve(_powers(share), exact), dtype=np.float64)


_KERNEL = _kernel_table()
