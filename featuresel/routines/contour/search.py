"""Where a drawing's gradients lie best on an image's, from coarse to fine.

The score of a pose is the weighted mean, over the model's points, of the dot product of
the gradient expected there with the image's, of which the size is taken out: as in
generalised Hough voting or shape-based matching (Ulrich, Steger & Baumgartner 2003),
but with the polarity of each point predicted, so that it cannot match the opposite.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from microplan.arrays import Float32Array, FloatArray
from microplan.featuresel.routines import work
from microplan.featuresel.routines.contour.model import turned

_Samples = npt.NDArray[np.intp]
_Directions = tuple[FloatArray, FloatArray]

_SMOOTH_PX = 0.8  # before gradients are taken, px of the level
_DIRECTION = 6e-5  # work of one sample of a field
_ANGLE = 0.05  # of one angle, however few points are turned
_LOOKED_UP = 8e-6  # of one point at one pose
# Points looked up for each sample of a transform that takes as long.
_MANY = 16
_TRIED = 6  # best poses of the coarsest level that are followed
_WORTH = 0.7  # of the best score there: what is less is not followed


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredPose:
    """A pose and its score: column and row px of the image, -1..1."""

    column: float
    row: float
    theta_rad: float
    score: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """Directions of an image's gradients, 0 where there is none, `shrink` px apart."""

    right: FloatArray  # (rows, columns) part of the direction to the right
    up: FloatArray  # (rows, columns)
    shrink: int

    def at(self, column: FloatArray, row: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the directions (right, up) at the nearest samples, (...); else 0."""
        i, j = self.samples(column, row)
        rows, columns = self.right.shape
        outside = (i < 0) | (i >= columns) | (j < 0) | (j >= rows)
        flat = np.where(outside, 0, j * columns + i)
        seen = ~outside
        return self.right.ravel()[flat] * seen, self.up.ravel()[flat] * seen

    def samples(
        self, column: FloatArray, row: FloatArray
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Return the nearest samples' (column, row), (...), of points in px."""
        half = (self.shrink - 1) / 2
        i = np.rint((column - half) / self.shrink).astype(np.intp)
        j = np.rint((row - half) / self.shrink).astype(np.intp)
        return i, j


@dataclass(frozen=True, slots=True, kw_only=True)
class _Tried:
    """Poses that are scored: angles, and shifts by samples about a position."""

    found: Field
    points: FloatArray  # (N, 5), px of the image
    near: tuple[float, float]  # column, row, px of the image
    steps: int  # samples to every side
    angles_rad: FloatArray  # (A,)

    def placed(self, angle_rad: float) -> tuple[_Samples, _Samples, _Directions]:
        """Return the samples (column, row) of the unshifted points, and directions."""
        x, y, right, up, _ = turned(self.points, angle_rad).T
        i, j = self.found.samples(self.near[0] + x, self.near[1] - y)
        return i, j, (right, up)

    def weight(self) -> FloatArray:
        """Return the points' weights (N,), 1 in all."""
        weight: FloatArray = self.points[:, 4] / self.points[:, 4].sum()
        return weight


def gradients(image: FloatArray, shrink: int) -> tuple[FloatArray, FloatArray]:
    """Return the gradient (right, up), (rows, columns) each, per px of small images."""
    small: Float32Array = image.astype(np.float32)
    if shrink > 1:
        rows, columns = image.shape
        size = (max(columns // shrink, 1), max(rows // shrink, 1))
        whole = small[: size[1] * shrink, : size[0] * shrink]
        shrunk = cv2.resize(whole, size, interpolation=cv2.INTER_AREA)
        small = np.asarray(shrunk, dtype=np.float32)
    smooth = cv2.GaussianBlur(small, (0, 0), _SMOOTH_PX)
    right = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    down = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    return np.asarray(right, np.float64), -np.asarray(down, np.float64)


def gradient_noise() -> float:
    """Return the noise of a gradient's part, over that of the image's pixels."""
    impulse = np.zeros((17, 17))
    impulse[8, 8] = 1.0
    return float(np.linalg.norm(gradients(impulse, 1)[0]))


def field(image: FloatArray, shrink: int, floor: float) -> Field:
    """Return the directions of gradients of a (rows, columns) image, 0..1.

    Those below `floor` count for their part.
    """
    right, up = gradients(image, shrink)
    size = np.maximum(np.hypot(right, up), floor)
    return Field(right=right / size, up=up / size, shrink=shrink)


def score(
    found: Field, points: FloatArray, column: float, row: float, theta_rad: float
) -> float:
    """Return the score of the points (N, 5), N >= 1, at one pose."""
    x, y, right, up, weight = turned(points, theta_rad).T
    seen = found.at(column + x, row - y)
    agreed = (right * seen[0] + up * seen[1]) @ weight
    return float(agreed / weight.sum())


def search(
    found: Field,
    points: FloatArray,
    near: tuple[float, float],
    reach_px: float,
    angles_rad: FloatArray,
    *,
    closed: bool,
) -> tuple[ScoredPose, ...]:
    """Return the best poses apart from each other, the best first.

    Parameters
    ----------
    found : Field
        Of the coarsest level.
    points : (N, 5) float array
        The model, px of the image.
    near : (column, row)
        About which to search, px of the image.
    reach_px : float
        To both sides, px of the image.
    angles_rad : (A,) float array
        To be tried, evenly spaced.
    closed : bool
        Whether the last angle is next to the first.
    """
    steps = math.ceil(reach_px / found.shrink)
    tried = _Tried(
        found=found, points=points, near=near, steps=steps, angles_rad=angles_rad
    )
    scores = _scores(tried)
    poses: list[ScoredPose] = []
    for _ in range(_TRIED):
        a, j, i = np.unravel_index(int(scores.argmax()), scores.shape)
        best = float(scores[a, j, i])
        if poses and best < _WORTH * poses[0].score:
            break
        poses.append(
            ScoredPose(
                column=near[0] + (int(i) - steps) * found.shrink,
                row=near[1] + (int(j) - steps) * found.shrink,
                theta_rad=float(angles_rad[a]),
                score=best,
            )
        )
        _strike(scores, (int(a), int(j), int(i)), closed=closed)
    return tuple(poses)


def climb(
    found: Field, points: FloatArray, start: ScoredPose, turn_rad: float, *, turns: bool
) -> ScoredPose:
    """Return the best pose near `start`, by steps of one sample and `turn_rad`.

    Points are (N, 4) px.
    """
    angles = start.theta_rad + turn_rad * np.arange(-2.0, 3.0)
    if not turns:
        angles = angles[2:3]
    near = (start.column, start.row)
    tried = _Tried(found=found, points=points, near=near, steps=2, angles_rad=angles)
    scores = _scores(tried)
    a, j, i = np.unravel_index(int(scores.argmax()), scores.shape)
    return ScoredPose(
        column=start.column + (int(i) - 2) * found.shrink,
        row=start.row + (int(j) - 2) * found.shrink,
        theta_rad=float(angles[a]),
        score=float(scores[a, j, i]),
    )


def field_work(pixels: float) -> float:
    """Return the work of one field of `pixels` samples, see `Routine.cost`."""
    return work.CALLS / 2 + _DIRECTION * pixels


def search_work(points: float, angles: float, shifts: float) -> float:
    """Return the work of scoring so many poses."""
    return angles * (_ANGLE + _LOOKED_UP * points * shifts)


def climb_work(points: float, *, turns: bool) -> float:
    """Return the work of climbing from all poses that are followed, one level."""
    return _TRIED * (work.CALLS / 4 + search_work(points, 5 if turns else 1, 25))


def scan(
    found: Field, points: FloatArray, at: ScoredPose, angles_rad: Sequence[float]
) -> FloatArray:
    """Return the scores (A,) of the angles at one position."""
    return np.array([score(found, points, at.column, at.row, a) for a in angles_rad])


def _scores(tried: _Tried) -> FloatArray:
    """Return (A, 2 steps + 1, 2 steps + 1) scores of angles and shifts by samples."""
    rows, columns = tried.found.right.shape
    steps = tried.steps
    transformed = (rows + 2 * steps) * (columns + 2 * steps)
    if len(tried.points) * (2 * steps + 1) ** 2 > _MANY * transformed:
        return _correlated(tried)
    return _looked_up(tried)


def _correlated(tried: _Tried) -> FloatArray:
    """Return the same by the correlation theorem: faster, where shifts are many."""
    found, steps = tried.found, tried.steps
    rows, columns = found.right.shape
    # what shifts beyond the border must not come in again from the other side
    size = [cv2.getOptimalDFTSize(count + 2 * steps) for count in (rows, columns)]
    waves = np.fft.fft2(found.right + 1j * found.up, size)
    weight = tried.weight()
    shifts = np.arange(-steps, steps + 1)
    scores = np.empty((len(tried.angles_rad), shifts.size, shifts.size))
    for k, angle in enumerate(tried.angles_rad.tolist()):
        i, j, (across, upward) = tried.placed(angle)
        seen = (i >= -steps) & (i < columns + steps)
        seen &= (j >= -steps) & (j < rows + steps)
        model = np.zeros(size, dtype=np.complex128)
        share = (across + 1j * upward) * weight
        np.add.at(model, (j[seen], i[seen]), share[seen])
        agreed = np.fft.ifft2(waves * np.fft.fft2(model).conj()).real
        scores[k] = agreed[np.ix_(shifts, shifts)]
    return scores


def _looked_up(tried: _Tried) -> FloatArray:
    """Return scores point by point."""
    found, steps = tried.found, tried.steps
    side, pad = 2 * steps + 1, 2 * steps
    right, up = (np.pad(part, pad) for part in (found.right, found.up))
    rows, columns = right.shape
    shifted = [sliding_window_view(part, (side, side)) for part in (right, up)]
    weight = tried.weight()
    scores = np.empty((len(tried.angles_rad), side * side))
    for k, angle in enumerate(tried.angles_rad.tolist()):
        i, j, (across, upward) = tried.placed(angle)
        i, j = i + steps, j + steps  # of the first shift, in the padded field
        # what no shift brings into the image counts as without gradient
        seen = (i >= 0) & (i <= columns - side) & (j >= 0) & (j <= rows - side)
        own = weight[seen]
        scores[k] = 0.0
        for part, share in zip(shifted, (across, upward), strict=True):
            met = part[j[seen], i[seen]].reshape(own.size, side * side)
            scores[k] += (share[seen] * own) @ met
    return scores.reshape(-1, side, side)


def _strike(scores: FloatArray, at: tuple[int, int, int], *, closed: bool) -> None:
    """Put the neighbourhood of a pose out of the scores, an array of our own."""
    a, j, i = at
    turns = np.arange(a - 2, a + 3)
    turns = (
        turns % len(scores) if closed else turns[(turns >= 0) & (turns < len(scores))]
    )
    rows, columns = slice(max(j - 2, 0), j + 3), slice(max(i - 2, 0), i + 3)
    for turn in turns.tolist():
        scores[turn, rows, columns] = -1.0
