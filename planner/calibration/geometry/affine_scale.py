"""Pitch of pixels, skew and turn of a matrix from um to px."""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import FloatArray


def stretch_of(matrix: FloatArray) -> FloatArray:
    """Return the symmetric part G of a matrix G R, (2, 2) px/um, R a turn or a mirror.

    A camera whose rows and columns are not square, or not at right angles, stretches
    what a ruler shows; how the ruler lay turned before does not matter.

    References
    ----------
    Higham (1986), Computing the polar decomposition, eq. (2.1): G = (M M^T)^(1/2).
    """
    values, vectors = np.linalg.eigh(matrix @ matrix.T)
    found: FloatArray = vectors * np.sqrt(values) @ vectors.T
    return found


def pitches(stretch: FloatArray) -> FloatArray:
    """Return pitch along columns and rows, um, and their skew, rad, (3,).

    The skew is by how much less than a right angle the images of two square axes,
    x to the right and y up, have between them.
    """
    skew = 4 * stretch[0, 1] / (stretch[0, 0] + stretch[1, 1])
    return np.array([1 / stretch[0, 0], 1 / stretch[1, 1], skew])


def axes_of(matrix: FloatArray, stretch: FloatArray) -> FloatArray:
    """Return what a matrix, px/um of reading, does besides a stretch, (2, 2) [1].

    Columns are images, um in the world, of a um of each reading.
    """
    return np.asarray(np.linalg.solve(stretch, matrix), dtype=np.float64)


def scales(axes: FloatArray) -> FloatArray:
    """Return the lengths of two axes, and their skew as of `pitches`, rad, (3,).

    Of mirrored axes the skew is that of the mirrored second one.
    """
    size = np.hypot(axes[0], axes[1])
    cosine = float(axes[:, 0] @ axes[:, 1] / (size[0] * size[1]))
    side = 1.0 if np.linalg.det(axes) > 0 else -1.0
    return np.array([*size, side * math.asin(min(max(cosine, -1.0), 1.0))])
