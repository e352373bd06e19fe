"""Least-squares fit of a template's place and angle, with free gain and offset."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from featuresel.routines import Failure, FloatArray
from featuresel.routines.sampling import cubic

_ROUNDS = 25  # Gauss-Newton settles in 5 to 10
_SETTLED_PX = 1e-4
_LEAST_IN_VIEW = 0.8  # of the template's pixels


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
    pose = np.array(start)
    score = 0.0
    while shrink >= 1:
        fitted = _fit(_smooth(image, shrink), _smooth(template, shrink), pose, shrink)
        if isinstance(fitted, Failure):
            return fitted
        pose, score = fitted
        shrink //= 2
    return Fit(
        column=float(pose[0]),
        row=float(pose[1]),
        turned_rad=float(pose[2]),
        score=score,
    )


def _smooth(image: FloatArray, shrink: int) -> FloatArray:
    """Return the image without what a sampling `shrink` times coarser cannot show."""
    if shrink == 1:
        return image
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.45 * shrink), dtype=np.float64)


def _fit(
    image: FloatArray, template: FloatArray, start: FloatArray, stride: int
) -> tuple[FloatArray, float] | Failure:
    """Return (column, row, turn) and correlation, by Gauss-Newton on every stride."""
    rows, columns = template.shape
    v, u = np.mgrid[0:rows:stride, 0:columns:stride].astype(np.float64)
    u, v = u.ravel() - (columns - 1) / 2, v.ravel() - (rows - 1) / 2
    down, across = np.gradient(template, axis=0), np.gradient(template, axis=1)
    gu, gv = across[::stride, ::stride].ravel(), down[::stride, ::stride].ravel()
    wanted = template[::stride, ::stride].ravel()
    pose = start.copy()
    size = float(np.hypot(u, v).max())
    for _ in range(_ROUNDS):
        c, s = math.cos(pose[2]), math.sin(pose[2])
        # rows go down, so a counter-clockwise turn takes (u, v) to (cu + sv, cv - su)
        seen, inside = cubic(image, pose[0] + c * u + s * v, pose[1] + c * v - s * u)
        if inside.mean() < _LEAST_IN_VIEW:
            return Failure(
                code="outside", message=f"{inside.mean():.0%} of the template in view"
            )
        # the template's own gradient, turned, stands in for the image's
        gx, gy = c * gu + s * gv, c * gv - s * gu
        turn = gu * v - gv * u
        # shifts of the light: gain, offset and a linear gradient are fitted along
        nuisance = (wanted, np.ones_like(u), u / size, v / size)
        design = np.column_stack((gx, gy, turn / size, *nuisance))[inside]
        solved, *_ = np.linalg.lstsq(design, seen[inside], rcond=None)
        gain = solved[3]
        if not gain > 0.05:
            return Failure(code="low_score", message=f"contrast fell to {gain:.3f}")
        # seen(pose) = gain template(. - error): the error goes on to the pose
        step = -np.array([solved[0], solved[1], solved[2] / size]) / gain
        if np.hypot(step[0], step[1]) > size:
            return Failure(code="diverged", message="a step larger than the template")
        pose = pose + step
        if max(abs(step[0]), abs(step[1]), abs(step[2]) * size) < _SETTLED_PX:
            return pose, _correlation(seen[inside], wanted[inside])
    return Failure(code="diverged", message=f"not settled after {_ROUNDS} rounds")


def _correlation(a: FloatArray, b: FloatArray) -> float:
    """Return the correlation coefficient of two samples, 0 if one is constant."""
    a, b = a - a.mean(), b - b.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0 else 0.0
