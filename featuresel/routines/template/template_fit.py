"""Least-squares fit of a template's position, angle and scale under any even light."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from microplan.arrays import BoolArray, Float32Array, FloatArray
from microplan.featuresel.routines import work
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.sampling import cubic

_ROUNDS = 25  # Gauss-Newton settles in 5 to 10
_TYPICAL_ROUNDS = 3  # from one size to the next
_SETTLED_PX = 5e-3  # the next is far shorter; slopes rounded to 1/32 px hop by .002
_LEAST_IN_VIEW = 0.8  # of the template's pixels
_LEAST_GAIN = 0.05  # of the template's contrast
_SLOPING = 0.1  # of the steepest slope: an edge
_MOST_READ = 32766  # values at a time: `remap` counts rows in short integers
_BESIDE_PX = 10  # of an edge, compared: as far as defocus of 10 um and more may blur it
# Of what has nothing behind it, about its edges. A template in focus keeps .97 with
# fingers 10 um out of it (A = .42); at 25 um .92 is left, and some answers are wrong.
SURE_SCORE = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class TemplateFit:
    """Where the template's middle pixel is, how far it is turned, how well it fits."""

    column: float
    row: float
    turned_rad: float
    score: float  # correlation coefficient of image and template about its edges


def refine(
    image: FloatArray,
    template: FloatArray,
    start: tuple[float, float, float],
    shrink: int,
    *,
    least_score: float,
    scale_off: float,
    turns: bool = True,
) -> TemplateFit | Failure:
    """Return the best fit, from coarse to fine.

    Parameters
    ----------
    image : (rows, columns) float array
        The image.
    template : (2 K + 1, 2 L + 1) float array
        The template at rotation 0.
    start : (column, row, turn)
        Where the template's middle pixel is, px, and its rotation, rad
        counter-clockwise as displayed.
    shrink : int
        Images `shrink` times smaller are fitted first, then half of that, down to 1.
    least_score : float
        Correlation of image and template about its edges, below which they differ.
    scale_off : float
        How far from 1 the scale may be.
    turns : bool
        Whether the angle is sought.

    Returns
    -------
    TemplateFit or Failure
        Fails with "diverged" if it does not settle, "outside" if too little is in view,
        "scale_off" and "low_score" beyond the limits.
    """
    pose = np.array((*start, 1.0))
    score = 0.0
    while shrink >= 1:
        fitted = _fit(
            _smooth(image, shrink), _smooth(template, shrink), pose, shrink, turns=turns
        )
        if isinstance(fitted, Failure):
            return fitted
        pose, score = fitted
        shrink //= 2
    if abs(pose[3] - 1) > scale_off:
        return Failure("scale_off", f"{pose[3]:.3f} times the template")
    if score < least_score:
        return Failure("low_score", f"correlation {score:.3f}, at least {least_score}")
    return TemplateFit(
        column=float(pose[0]),
        row=float(pose[1]),
        turned_rad=float(pose[2]),
        score=score,
    )


def refine_work(template: FloatArray, pixels: float, shrink: int) -> float:
    """Return the work of `refine` on so many pixels, (2 R + 1, 2 C + 1) template."""
    total, near = 0.0, int(_near_edges(template).sum())
    while shrink >= 1:
        compared = near / shrink**2
        each = work.read(compared) + work.least_squares(compared, 8)
        total += _TYPICAL_ROUNDS * each
        if shrink > 1:
            total += work.smooth(pixels + template.size, 0.45 * shrink)
        shrink //= 2
    return total


def _smooth(image: FloatArray, shrink: int) -> FloatArray:
    """Return the image without what a sampling `shrink` times coarser cannot show."""
    if shrink == 1:
        return image
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.45 * shrink), dtype=np.float64)


def _fit(
    image: FloatArray,
    template: FloatArray,
    start: FloatArray,
    stride: int,
    *,
    turns: bool,
) -> tuple[FloatArray, float] | Failure:
    """Return (column, row, rotation, scale) and correlation, by Gauss-Newton.

    Only every `stride`-th pixel of the template is compared. Slopes are the image's: a
    template sharper than it would be stepped along too shortly to settle.
    """
    (u, v), wanted = _compared(template, stride)
    size = float(np.hypot(u, v).max())
    # what the light may do: gain, offset and a linear gradient
    light = np.column_stack((wanted, np.ones_like(u), u / size, v / size))
    slopes = _slopes(image)
    pose = start.copy()
    for _ in range(_ROUNDS):
        x, y = _moved(u, v, pose)
        seen, inside = cubic(image, x, y)
        if inside.mean() < _LEAST_IN_VIEW:
            return Failure("outside", f"{inside.mean():.0%} of the template in view")
        moves = _moves(slopes, (x, y), (u / size, v / size), pose)
        solved = _solved(np.hstack((-moves, light))[inside], seen[inside], turns=turns)
        if not solved[4] > _LEAST_GAIN:
            return Failure("low_score", f"contrast fell to {solved[4]:.3f}")
        step = solved[:4]
        if math.hypot(step[0], step[1]) > size:
            return Failure("diverged", "a step larger than the template")
        pose = pose + step / np.array((1.0, 1.0, size, size))
        if float(np.abs(step).max()) < _SETTLED_PX:
            even = seen - light[:, 2:] @ solved[6:]
            return pose, _correlation(even[inside], wanted[inside])
    return Failure("diverged", f"not settled after {_ROUNDS} rounds")


def _compared(
    template: FloatArray, stride: int
) -> tuple[tuple[FloatArray, FloatArray], FloatArray]:
    """Return (columns, rows) from the middle and values of the pixels that tell.

    Every `stride`-th of those about edges.
    """
    rows, columns = template.shape
    v, u = np.nonzero(_near_edges(template)[::stride, ::stride])
    u, v = stride * u, stride * v
    at = (u - (columns - 1) / 2, v - (rows - 1) / 2)
    return at, template[v, u]


def _near_edges(template: FloatArray) -> BoolArray:
    """Return the pixels whose value changes when the template moves or is blurred."""
    down, across = np.gradient(template)
    slope = np.hypot(across, down)
    edges = (slope > _SLOPING * slope.max()).astype(np.uint8)
    side = 2 * _BESIDE_PX + 1
    return np.asarray(cv2.dilate(edges, np.ones((side, side), np.uint8)) > 0)


def _moved(
    u: FloatArray, v: FloatArray, pose: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return where the template's pixels are in the image.

    Rows go down, so a counter-clockwise rotation takes (u, v) to (c u + s v, c v - s
    u).
    """
    c, s = pose[3] * math.cos(pose[2]), pose[3] * math.sin(pose[2])
    return pose[0] + c * u + s * v, pose[1] + c * v - s * u


def _slopes(image: FloatArray) -> Float32Array:
    """Return the image's slopes along columns and rows, (rows, columns, 2)."""
    down, across = np.gradient(image)
    return np.stack((across, down), axis=2).astype(np.float32)


def _moves(
    slopes: Float32Array,
    at: tuple[FloatArray, FloatArray],
    unit: tuple[FloatArray, FloatArray],
    pose: FloatArray,
) -> FloatArray:
    """Return how the values change with column, row, rotation and scale, (N, 4).

    The last two move the rim by 1 px. `remap` rounds to 1/32 px: enough for a slope.
    """
    x, y = (np.asarray(values, dtype=np.float32)[:, None] for values in at)
    found = [
        cv2.remap(
            slopes, x[k : k + _MOST_READ], y[k : k + _MOST_READ], cv2.INTER_LINEAR
        )
        for k in range(0, len(x), _MOST_READ)
    ]
    across, down = np.concatenate(found)[:, 0].T.astype(np.float64)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    out, over = c * unit[0] + s * unit[1], c * unit[1] - s * unit[0]
    turn = pose[3] * (across * over - down * out)
    return np.column_stack((across, down, turn, across * out + down * over))


def _solved(design: FloatArray, seen: FloatArray, *, turns: bool) -> FloatArray:
    """Return the least-squares solution; the rotation stays where it is not sought."""
    if not turns:
        design[:, 2] = 0.0
    gram = design.T @ design
    return np.asarray(
        np.linalg.lstsq(gram, design.T @ seen, rcond=1e-12)[0], dtype=np.float64
    )


def _correlation(a: FloatArray, b: FloatArray) -> float:
    """Return the correlation coefficient of two samples, 0 if one is constant."""
    a, b = a - a.mean(), b - b.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0 else 0.0
