"""The unit cube that trials are drawn from: Sobol points and two-level corners.

Axes come in groups. A group has dimensions of the Sobol sequence for itself and a
scramble of its own, so that a group added later moves no point of those before it;
together they are one scrambled sequence, because each dimension is scrambled
independently of the others.
"""

from __future__ import annotations

import hashlib
from functools import cache

import numpy as np
from scipy.linalg import hadamard
from scipy.stats import qmc

from microplan.arrays import FloatArray

# name -> the first dimension and the one after the last; groups are only ever appended
GROUPS: dict[str, tuple[int, int]] = {
    "design": (0, 8),  # dx, dy, theta, focus, zoom, gain, gradient, its direction
    "occluder": (8, 10),  # x, y
    # distortion, shift x, shift y, scale, curvature, edge offset
    "lens": (10, 16),
    "noise": (16, 17),
}
_CORNERS = 16  # axes of the two-level design; directions are drawn and need none


def words(key: str) -> tuple[int, ...]:
    """Return the sha256 of `key` as eight 32-bit words."""
    digest = hashlib.sha256(key.encode()).digest()
    return tuple(int.from_bytes(digest[i : i + 4], "big") for i in range(0, 32, 4))


def generator(root: int, key: str) -> np.random.Generator:
    """Return the generator of one cell."""
    return np.random.default_rng(np.random.SeedSequence([root, *words(key)]))


def interior(
    group: str, key: str, root: int, count: int, *, first: int = 0
) -> FloatArray:
    """Return points of a group's axes in the unit cube, (N, M) in 0..1.

    At least `count` points, N, of M axes.

    Point k depends on the group, `key`, `root` and k alone; the first one returned is
    number `first`, a multiple of a power of two that is at least `count`.
    """
    begin, end = GROUPS[group]
    sobol = qmc.Sobol(end, rng=generator(root, f"{key}/{group}"))
    if first:
        sobol.fast_forward(first)
    points: FloatArray = sobol.random(1 << max(1, (count - 1).bit_length()))
    return points[:, begin:]


def corner(turn: int) -> tuple[float, ...]:
    """Return the corner of the two-level design at a rotation, 16 of +-1.

    Axes 0 to 6 are those of the group design but the gradient's direction; 7 and 8 the
    occluder's, 9 to 14 the lens', 15 the noise. 32 rotations balance each axis, and no
    axis is confounded with a pair of others (resolution IV).
    """
    signs = _signs()
    return tuple(float(sign) for sign in signs[turn % len(signs)])


@cache
def _signs() -> FloatArray:
    """Return 32 corners of 16 axes, (32, 16) of +-1: 16 orthogonal ones and mirrored.

    The column of ones comes last: mirrored it is an axis like the others.
    """
    square = hadamard(_CORNERS).astype(np.float64)
    half = np.hstack((square[:, 1:], square[:, :1]))
    signs: FloatArray = np.vstack((half, -half))
    signs.setflags(write=False)
    return signs
