"""Which pixels of a template are worth comparing: few that tell nearly as much."""

from __future__ import annotations

import cv2
import numpy as np

from microplan.arrays import BoolArray, FloatArray, IntArray
from microplan.featuresel.routines.contract import CameraNoise

LOSS = 1.06  # of the limits, by leaving pixels out; neighbours halve it
_WEAK = 1e-10  # of the strongest direction: what is weaker is not determined at all
_NEAR_PX = 1.0  # standard deviation of what counts as near
_ROUNDS = 2  # of ranking: the information of a pixel depends on what else is taken


def informative(
    mean: FloatArray,
    slopes: FloatArray,
    camera: CameraNoise,
    *,
    wanted: int,
) -> BoolArray:
    """Return few pixels whose Cramer-Rao limits are nearly those of all.

    Parameters
    ----------
    mean : (rows, columns) float array
        Light of the pixels, 0..1 of full scale.
    slopes : (P, rows, columns) float array
        What they change by with each number that the fit leaves free.
    camera : CameraNoise
        Its noise.
    wanted : int
        How many of the numbers, the first, must keep their limits within `LOSS`.

    Returns
    -------
    (rows, columns) bool array
        Pixels are taken in falling order of what they and their neighbours tell about
        the numbers wanted, all others being unknown. Neighbours, because the pixels of
        an image do not lie where the template's do.

    Notes
    -----
    The influence of a pixel on an estimate is a row of F^-1 times its slopes; its
    square over the variance is the pixel's part of 1 / limit**2.
    """
    scores = (slopes / np.sqrt(camera.variance(mean))).reshape(len(slopes), -1)
    scale = np.sqrt((scores**2).sum(axis=1))
    scores = scores / np.where(scale > 0, scale, 1.0)[:, None]
    known = _inverse(scores)
    goal = np.diag(known)[:wanted] * LOSS**2
    taken: IntArray = np.arange(mean.size)
    for _ in range(_ROUNDS):
        influence = known[:wanted] @ scores
        told = goal[:, None] > 0
        rank = np.where(told, influence**2 / np.where(told, goal[:, None], 1.0), 0.0)
        density = cv2.GaussianBlur(
            rank.sum(axis=0).reshape(mean.shape), (0, 0), _NEAR_PX
        )
        order = np.argsort(-density, axis=None, kind="stable")
        count = _fewest(scores, order, goal)
        if count < len(taken):
            taken = order[:count]
        known = _inverse(scores[:, order[:count]])
    used = np.zeros(mean.size, dtype=bool)
    used[taken] = True
    return used.reshape(mean.shape)


def _fewest(scores: FloatArray, order: IntArray, goal: FloatArray) -> int:
    """Return how many pixels, in order, keep the limits."""
    few, many = 0, len(order)
    while many - few > 1:
        middle = (few + many) // 2
        kept = np.diag(_inverse(scores[:, order[:middle]]))[: len(goal)]
        # what is lost altogether has no variance left either
        meets = bool(((kept <= goal) & ((kept > 0) | (goal <= 0))).all())
        few, many = (few, middle) if meets else (middle, many)
    return many


def _inverse(scores: FloatArray) -> FloatArray:
    """Return the covariance over the directions that (P, N) scores tell."""
    values, vectors = np.linalg.eigh(scores @ scores.T)
    good = values > _WEAK * max(float(values[-1]), 1e-300)
    turned = vectors[:, good]
    covariance: FloatArray = (turned / values[good]) @ turned.T
    return covariance
