"""A GDSII path as the polygons that it covers: a stroke with mitred bends."""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.drawings.gds.cells import ROUND_POINTS
from microplan.planner.drawings.gds.library import AreaElement
from microplan.planner.drawings.gds.records import GdsError

CHORD = 0.1  # largest sagitta of round ends, database units
SHARP = -1e-9  # cosine of a bend: a right angle is still drawn alike by all programs


def stroke(shape: AreaElement, points: FloatArray, width: float) -> list[FloatArray]:
    """Return convex polygons whose union is the path, in database units [1].

    Parameters
    ----------
    shape : AreaElement
        The path; its type and extensions are used.
    points : (N, 2) float array
        Its middle line, database units.
    width : float
        Its width, database units.

    Returns
    -------
    list of (M, 2) float arrays
        A rectangle for each piece, a kite for each bend, a fan for each round end.

    Raises
    ------
    GdsError
        MP233 for a path without width or length, of another type than 0, 1, 2 and 4,
        with ends drawn in beyond its first or last piece, or with a bend sharper than
        a right angle, which programs draw differently.
    """
    line = points[np.r_[True, (np.diff(points, axis=0) != 0).any(axis=1)]]
    if not width > 0 or len(line) < 2:
        raise _unreadable(shape, f"has width {width:g} and {len(line)} distinct points")
    steps = np.diff(line, axis=0)
    lengths = np.hypot(*steps.T)
    along = steps / lengths[:, None]
    half = width / 2
    before, behind = _extensions(shape, half)
    lone = before + behind if len(steps) == 1 else 0.0
    if min(before + lengths[0], behind + lengths[-1], lone + lengths[0]) <= 0:
        raise _unreadable(shape, "has ends drawn in by more than a piece")
    middle = line.copy()
    middle[0] -= before * along[0]
    middle[-1] += behind * along[-1]
    across = half * np.column_stack([-along[:, 1], along[:, 0]])
    found = [
        np.array([a - n, b - n, b + n, a + n])
        for a, b, n in zip(middle[:-1], middle[1:], across, strict=True)
    ]
    for k in range(len(steps) - 1):
        found += _bend(shape, line[k + 1], along[k], along[k + 1], half)
    if shape.path_type == 1:
        found += [_cap(line[0], across[0], half), _cap(line[-1], -across[-1], half)]
    return found


def sagitta(radius: float) -> float:
    """Return by how much the chords of a round end miss it, in the unit of `radius`."""
    return radius * (1 - math.cos(math.pi / 2 / _chords(radius)))


def _extensions(shape: AreaElement, half: float) -> tuple[float, float]:
    """Return how far the path goes on before its first point and behind its last."""
    if shape.path_type in (0, 1):
        return 0.0, 0.0
    if shape.path_type == 2:
        return half, half
    if shape.path_type == 4:
        return float(shape.begin), float(shape.end)
    raise _unreadable(shape, f"is of type {shape.path_type}; read are 0, 1, 2 and 4")


def _bend(
    shape: AreaElement,
    at: FloatArray,
    before: FloatArray,
    behind: FloatArray,
    half: float,
) -> list[FloatArray]:
    """Return the kite between two pieces, up to where their outer borders meet."""
    cos = float(before @ behind)
    sin = float(before[0] * behind[1] - before[1] * behind[0])
    if cos < SHARP:
        x, y = at
        message = f"bends by {math.degrees(math.atan2(abs(sin), cos)):.4g} degrees at "
        raise _unreadable(shape, f"{message}({x:g}, {y:g}) database units, 90 allowed")
    if not sin:
        return []
    side = -math.copysign(half, sin)  # the outer side is opposite to the bend
    first = side * np.array([-before[1], before[0]])
    last = side * np.array([-behind[1], behind[0]])
    tip = (first + last) / (1 + cos)
    return [np.array([at, at + first, at + tip, at + last])]


def _cap(at: FloatArray, across: FloatArray, half: float) -> FloatArray:
    """Return half a disc about `at`, to the left of `across`."""
    count = _chords(half)
    angle = math.atan2(across[1], across[0]) + np.linspace(0, math.pi, count + 1)
    rim: FloatArray = at + half * np.column_stack([np.cos(angle), np.sin(angle)])
    rim[0], rim[-1] = at + across, at - across  # the corners of the piece, exactly
    return rim


def _chords(radius: float) -> int:
    """Return into how many chords a half circle is split."""
    half = math.acos(max(1 - CHORD / radius, 0.5))
    return min(max(2, math.ceil(math.pi / (2 * half))), ROUND_POINTS)


def _unreadable(shape: AreaElement, why: str) -> GdsError:
    return GdsError("MP233", shape.offset, f"a PATH on layer '{shape.layer}' {why}")
