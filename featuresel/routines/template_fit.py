"""Least-squares fit of a template's place, angle and scale under any even light."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from featuresel.routines import Failure, FloatArray, work
from featuresel.routines.sampling import cubic

_ROUNDS = 25  # Gauss-Newton settles in 5 to 10
_TYPICAL_ROUNDS = 3  # from one size to the next
_SETTLED_PX = 1e-4
_LEAST_IN_VIEW = 0.8  # of the template's pixels
_LEAST_GAIN = 0.05  # of the template's contrast
_SCALE_OFF = 0.05  # zoom errors stay below 2 %; what is farther off is another thing


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """Where the template's middle pixel is, how far it is turned, how well it fits."""

    column: float
    row: float
    turned_rad: float
    score: float  # correlation coefficient of image and template there


def refine(
    image: FloatArray,
    template: FloatArray,
    start: tuple[float, float, float],
    shrink: int,
) -> Fit | Failure:
    """Return the best fit, from coarse to fine.

    Parameters
    ----------
    image : (rows, columns) float array
        The image.
    template : (2 K + 1, 2 L + 1) float array
        The template at turn 0.
    start : (column, row, turn)
        Where the template's middle pixel is, px, and its turn, rad counter-clockwise
        as displayed.
    shrink : int
        Images `shrink` times smaller are fitted first, then half of that, down to 1.

    Returns
    -------
    Fit or Failure
        Fails with "diverged" if it does not settle, "outside" if too little is in view.
    """
    pose = np.array((*start, 1.0))
    score = 0.0
    while shrink >= 1:
        fitted = _fit(_smooth(image, shrink), _smooth(template, shrink), pose, shrink)
        if isinstance(fitted, Failure):
            return fitted
        pose, score = fitted
        shrink //= 2
    if abs(pose[3] - 1) > _SCALE_OFF:
        return Failure(code="scale_off", message=f"{pose[3]:.3f} times the template")
    return Fit(
        column=float(pose[0]),
        row=float(pose[1]),
        turned_rad=float(pose[2]),
        score=score,
    )


def refine_work(template: float, pixels: float, shrink: int) -> float:
    """Return the work of `refine` for a template and an image of so many pixels."""
    total = 0.0
    while shrink >= 1:
        compared = template / shrink**2
        each = work.read(compared) + work.least_squares(compared, 8)
        total += _TYPICAL_ROUNDS * each
        if shrink > 1:
            total += work.smooth(pixels + template, 0.45 * shrink)
        shrink //= 2
    return total


def _smooth(image: FloatArray, shrink: int) -> FloatArray:
    """Return the image without what a sampling `shrink` times coarser cannot show."""
    if shrink == 1:
        return image
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.45 * shrink), dtype=np.float64)


def _fit(
    image: FloatArray, template: FloatArray, start: FloatArray, stride: int
) -> tuple[FloatArray, float] | Failure:
    """Return (column, row, turn, scale) and correlation, by Gauss-Newton.

    Only every `stride`-th pixel of the template is compared.
    """
    rows, columns = template.shape
    v, u = np.mgrid[0:rows:stride, 0:columns:stride].astype(np.float64)
    u, v = u.ravel() - (columns - 1) / 2, v.ravel() - (rows - 1) / 2
    across = np.gradient(template, axis=1)[::stride, ::stride].ravel()
    down = np.gradient(template, axis=0)[::stride, ::stride].ravel()
    wanted = template[::stride, ::stride].ravel()
    size = float(np.hypot(u, v).max())
    # in the template's own axes: shifts, a turn and a scale that move the rim by 1 px,
    # then what the light may do: gain, offset and a linear gradient
    moves = (
        across,
        down,
        (across * v - down * u) / size,
        (across * u + down * v) / size,
    )
    design = np.column_stack((*moves, wanted, np.ones_like(u), u / size, v / size))
    pose = start.copy()
    for _ in range(_ROUNDS):
        c, s, scale = math.cos(pose[2]), math.sin(pose[2]), pose[3]
        # rows go down, so a counter-clockwise turn takes (u, v) to (cu + sv, cv - su)
        x, y = pose[0] + scale * (c * u + s * v), pose[1] + scale * (c * v - s * u)
        seen, inside = cubic(image, x, y)
        if inside.mean() < _LEAST_IN_VIEW:
            return Failure(
                code="outside", message=f"{inside.mean():.0%} of the template in view"
            )
        solved, *_ = np.linalg.lstsq(design[inside], seen[inside], rcond=None)
        gain = float(solved[4])
        if not gain > _LEAST_GAIN:
            return Failure(code="low_score", message=f"contrast fell to {gain:.3f}")
        # seen(pose) = gain template(. - error): the error goes on to the pose
        du, dv, turn, grow = -solved[:4] / gain
        if math.hypot(du, dv) > size:
            return Failure(code="diverged", message="a step larger than the template")
        step = (c * du + s * dv, c * dv - s * du, turn / size, grow / size)
        pose = pose + np.array(step)
        if max(abs(du), abs(dv), abs(turn), abs(grow)) < _SETTLED_PX:
            return pose, _correlation(seen[inside], wanted[inside])
    return Failure(code="diverged", message=f"not settled after {_ROUNDS} rounds")


def _correlation(a: FloatArray, b: FloatArray) -> float:
    """Return the correlation coefficient of two samples, 0 if one is constant."""
    a, b = a - a.mean(), b - b.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0 else 0.0
