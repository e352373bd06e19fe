"""Image Jacobian: how an image follows the axes, by least squares, with its limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray, Point
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.station import ALIGNED
from microplan.schemas.plan import Look

LIMIT = 4.5  # sigmas: of eight numbers one is beyond it in 20 000 probes

# what a matrix near one of these means; the other four signs are the rotations
_TWISTS: dict[tuple[int, int, int, int], str] = {
    (-1, 0, 0, 1): "x is mirrored: a mirrored camera, or x of the axes is reversed",
    (1, 0, 0, -1): "y is mirrored: a mirrored camera, or y of the axes is reversed",
    (0, 1, 1, 0): "x and y are swapped",
    (0, -1, -1, 0): "x and y are swapped and both reversed",
    (-1, 0, 0, -1): "it is turned by 180 deg: the camera is, or both axes are reversed",
    (0, -1, 1, 0): "it is turned by 90 deg",
    (0, 1, -1, 0): "it is turned by -90 deg",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageJacobian:
    """Measured image Jacobian over the calibrated one: the identity is right."""

    matrix: FloatArray  # (2, 2), a move of the axes to one of the image
    sigma: FloatArray  # (2, 2), one standard deviation of each number


def fit_jacobian(
    readings: Sequence[Point], positions: Sequence[Point], sigma_um: float
) -> ImageJacobian:
    """Return the (2, 2) matrix from moves to positions by least squares, with sigma.

    Parameters
    ----------
    readings, positions : (N, 2) sequence of float
        um; N >= 3, not on one line.
    sigma_um : float
        Of each position per axis, the axes' landing included.
    """
    moves, seen = np.array(readings), np.array(positions)
    moves, seen = moves - moves.mean(axis=0), seen - seen.mean(axis=0)
    inverse = np.linalg.inv(moves.T @ moves)
    sigma = sigma_um * np.sqrt(np.diag(inverse))
    return ImageJacobian(
        matrix=(inverse @ moves.T @ seen).T, sigma=np.stack((sigma, sigma))
    )


def check_directions(found: ImageJacobian, look: Look) -> None:
    """Raise MP833 unless the image goes in the direction of the axes."""
    flat = found.matrix.ravel()
    nearest = min(
        ((1, 0, 0, 1), *_TWISTS), key=lambda twist: float(np.hypot.reduce(flat - twist))
    )
    if nearest in _TWISTS:
        raise ExecutorError("MP833", f"{_seen(found, look)}: {_TWISTS[nearest]}")
    across = np.abs(found.matrix - np.diag(np.diag(found.matrix)))
    if (across > ALIGNED + LIMIT * found.sigma).any():
        turn_rad = math.atan2(flat[2] - flat[1], flat[0] + flat[3])
        raise ExecutorError(
            "MP833",
            f"{_seen(found, look)}: it is turned by {math.degrees(turn_rad):.3g} deg",
        )


def check_scale(found: ImageJacobian, look: Look) -> None:
    """Raise MP834 unless the image goes as far as the axes, in x, y and on average."""
    scales, sigma = np.diag(found.matrix), np.diag(found.sigma)
    for name, scale, sigma_of in (
        ("x", scales[0], sigma[0]),
        ("y", scales[1], sigma[1]),
        ("both", scales.mean(), np.hypot(*sigma) / 2),
    ):
        limit = ALIGNED + LIMIT * sigma_of
        if not abs(scale - 1) <= limit:
            raise ExecutorError(
                "MP834",
                f"{_seen(found, look)}: {name} {scale:.4g} of the calibrated scale, "
                f"within {limit:.2g} of 1",
            )


def check_turn(told_rad: float, seen_rad: float, sigma_rad: float, look: Look) -> None:
    """Raise MP833 unless the image rotates as the axes were ordered to."""
    apart_rad = abs(math.remainder(seen_rad - told_rad, math.tau))
    if not apart_rad <= ALIGNED * abs(told_rad) + LIMIT * sigma_rad:
        told, seen = math.degrees(told_rad), math.degrees(seen_rad)
        how = "the other way: an axis is reversed" if told * seen < 0 else "too far off"
        raise ExecutorError(
            "MP833",
            f"look {look.id}: told to turn by {told:.3g} deg, the image turned by "
            f"{seen:.3g} deg, {how}",
        )


def _seen(found: ImageJacobian, look: Look) -> str:
    """Return what was seen, in words."""
    (a, b), (c, d) = found.matrix
    return (
        f"look {look.id}: by a move of 1 um in x the image goes ({a:.3g}, {c:.3g}) um, "
        f"in y ({b:.3g}, {d:.3g}) um"
    )
