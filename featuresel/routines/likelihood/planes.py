"""Planes of a target's light over position, focus and rotation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from microplan.arrays import BoolArray, FloatArray, IntArray
from microplan.featuresel.routines.contract import (
    Artifact,
    CameraNoise,
    LookModel,
    Target,
)
from microplan.featuresel.routines.likelihood.appearance import AGAIN_PX, BEYOND
from microplan.featuresel.routines.likelihood.spline import (
    depth_coefficients,
    plane_coefficients,
)

FOCUS_SIGMAS = 3.0  # of focus, that the planes reach to
# Of a wave depth of field: the light at a point of the image then turns by less than a
# radian from plane to plane, at all frequencies.
_STEP_DEPTHS = 0.4
_MOST_PLANES = 48
_EVEN = 1e-4  # of full scale, that images on both sides of focus may differ by
_SAMPLES = 1.9  # a period of the finest detail; what is finer has no contrast
_MOST_BITS = 20  # that 32-bit floats hold exactly, and to spare
_MARGIN_PX = 10.0  # around the target, beyond its blur
_FINGER = 1.2  # of a finger's width, taken in beside the opening: all of it
_BEHIND = 2.0  # of the distance from grip to tips: far ends determine the angle
_WANTED = 3  # column, row and turn keep their limits; focus and zoom come with them
_SUPPORT = 2  # cells around one that a cubic spline needs


@dataclass(frozen=True, slots=True)
class _TemplateGrid:
    """Samples of a template."""

    over: int  # per pixel
    middle: tuple[float, float]  # (column, row) of the reference point

    @property
    def around(self) -> int:
        """Return the samples about a chosen one that a fit may read."""
        # a spline's, as many as pixels move by, and one as pixels are between samples
        return _SUPPORT + math.ceil(AGAIN_PX * self.over + 0.5)


@dataclass(frozen=True, slots=True)
class _Stops:
    """Focus heights of the planes, at equal steps."""

    first_um: float
    step_um: float
    count: int
    is_even: bool  # images on both sides of focus are alike

    @property
    def heights_um(self) -> FloatArray:
        """Return all of them, (count,), without a sign where that does not show."""
        heights = self.first_um + self.step_um * np.arange(self.count)
        return np.asarray(np.abs(heights) if self.is_even else heights)


def prepare_planes(
    model: LookModel,
    target: Target,
    shape: tuple[int, ...],
    *,
    turns: bool,
    reach_um: float,
    ignored: BoolArray | None = None,
    also_px: FloatArray | None = None,
) -> Artifact:
    """Return the planes of a target as an artifact, see `read_appearance`.

    Parameters
    ----------
    model : LookModel
        The look.
    target : Target
        What is to be found.
    shape : (rows, columns)
        Of the region.
    turns : bool
        Whether the target may lie at an angle to the nominal one.
    reach_um : float
        How far from nominal the focus may be.
    ignored : (rows, columns) bool array, optional
        Pixels of the nominal image that are not the target's.
    also_px : (2, N) float array, optional
        Positions, right and down of the reference point, that are read in any case.
    """
    half = _half_px(model, target, shape, reach_um)
    over = _over(model, target)
    grid = _TemplateGrid(
        over=over,
        middle=(
            over * (half[0] + target.column - round(target.column)),
            over * (half[1] + target.row - round(target.row)),
        ),
    )
    stops = _stops(model, half, reach_um)
    distinct, back = np.unique(np.round(stops.heights_um, 9), return_inverse=True)
    stack = model.template(tuple(distinct.tolist()), over=over, half_px=half)
    side = math.sqrt(model.camera.fill_factor)
    planes = np.stack(
        [plane_coefficients(t, over=over, side=side, turns=turns) for t in stack]
    )
    few = np.unique(np.linspace(0, len(distinct) - 1, _MOST_BITS).round().astype(int))
    own = _own(ignored, target, half)
    used = _used(planes[:, :2].sum(axis=1), distinct, model, grid, own)[few]
    return Artifact(
        parameters={
            "over": float(over),
            "middle_column": grid.middle[0],
            "middle_row": grid.middle[1],
            "first_um": stops.first_um,
            "step_um": stops.step_um,
            "is_even": float(stops.is_even),
            "heights": float(len(used)),
        },
        arrays=_packed(
            planes, back, used, _read(also_px, grid, used.shape[1:]), grid.around
        ),
    )


def _packed(
    planes: FloatArray,
    back: IntArray,
    used: BoolArray,
    also: BoolArray,
    around: int,
) -> dict[str, npt.NDArray[np.float32]]:
    """Return coefficients of the cells that are read, where they are, and their use."""
    kept = _grown(used.any(axis=0) | also, around)
    cells = np.where(kept, np.cumsum(kept).reshape(kept.shape), 0)
    deep = depth_coefficients(planes[back].reshape(*back.shape, planes.shape[1], -1))
    packed = np.zeros((len(back), planes.shape[1], int(kept.sum()) + 1), np.float32)
    packed[:, :, 1:] = deep[:, :, kept.ravel()]
    uses = np.tensordot(2.0 ** np.arange(len(used)), used, axes=1)
    return {
        "planes": packed,
        "cells": cells.astype(np.float32),
        "uses": uses.astype(np.float32),
    }


def _half_px(
    model: LookModel, target: Target, shape: tuple[int, ...], reach_um: float
) -> tuple[int, int]:
    """Return half the template's sides: the target and its blur, or all in reach."""
    names = ("radius_um", "outer_um", "extent_um")
    far = (
        max(target.column, shape[1] - 1 - target.column) + target.search_px,
        max(target.row, shape[0] - 1 - target.row) + target.search_px,
    )
    reach = reach_um * model.blur.cone
    if target.kind == "jaws":  # the tips and what is behind them between the faces
        p = target.parameters
        wide = p["opening_um"] / 2 + _FINGER * p["finger_width_um"]
        size = (wide, _BEHIND * p["grip_from_tip_um"])
    else:
        extent = next(target.parameters[n] for n in names if n in target.parameters)
        size = (extent, extent)
    want = [(side + reach) * target.px_per_um + _MARGIN_PX for side in size]
    return math.ceil(min(want[0], far[0])), math.ceil(min(want[1], far[1]))


def _over(model: LookModel, target: Target) -> int:
    """Return samples per pixel, odd: enough for the finest detail in the image."""
    finest = model.blur.cutoff_per_um / target.px_per_um
    return 2 * math.ceil((_SAMPLES * finest - 1) / 2) + 1 if finest > 0.5 else 1


def _stops(model: LookModel, half: tuple[int, int], reach_um: float) -> _Stops:
    """Return the focus heights of the planes."""
    depth = model.blur.depth_um
    reach = max(reach_um, step := _STEP_DEPTHS * depth)
    # far out no wavefront error is in images: nearer they may differ all the same
    offs = reach / 2, min(reach / 2, depth)
    shown = model.template((*offs, -offs[0], -offs[1]), over=1, half_px=half)
    is_even = bool(np.abs(shown[:2] - shown[2:]).max() < _EVEN)
    span = reach if is_even else 2 * reach
    step = span / (steps := min(math.ceil(span / step), _MOST_PLANES))
    first = -BEYOND * step - (0.0 if is_even else reach)
    return _Stops(first, step, steps + 1 + 2 * BEYOND, is_even)


def _own(
    ignored: BoolArray | None, target: Target, half: tuple[int, int]
) -> FloatArray:
    """Return 1 for pixels of the template that are the target's, else 0."""
    own = np.ones((2 * half[1] + 1, 2 * half[0] + 1))
    if ignored is None:
        return own
    rows = np.arange(len(own)) + round(target.row) - half[1]
    columns = np.arange(own.shape[1]) + round(target.column) - half[0]
    inner_rows = (rows >= 0) & (rows < ignored.shape[0])
    inner_columns = (columns >= 0) & (columns < ignored.shape[1])
    part = ignored[np.ix_(rows[inner_rows], columns[inner_columns])]
    own[np.ix_(inner_rows, inner_columns)] = ~part
    return own


def _used(
    light: FloatArray,
    depths: FloatArray,
    model: LookModel,
    grid: _TemplateGrid,
    own: FloatArray,
) -> BoolArray:
    """Return cells worth comparing; none so near the border that support is missing.

    One cell of a pixel's width stands for its neighbours.
    """
    over = grid.over
    rows, columns = light.shape[1:]
    first = over // 2
    v, u = np.mgrid[first:rows:over, first:columns:over].astype(np.float64)
    u, v = u - grid.middle[0], v - grid.middle[1]
    down, across = (
        over * np.gradient(light, axis=axis)[:, first::over, first::over]
        for axis in (1, 2)
    )
    seen = light[:, first::over, first::over]
    focus = np.gradient(seen, depths, axis=0) if len(depths) > 1 else 0 * seen
    inner, edge = np.zeros((rows, columns), dtype=bool), grid.around
    inner[edge:-edge, edge:-edge] = True
    # by the middle of its block: what is determined in vain would else be counted on
    own = own[: seen.shape[1], : seen.shape[2]] * inner[first::over, first::over]
    used = np.zeros(light.shape, dtype=bool)
    for k, mean in enumerate(seen):
        turn, grow = across[k] * v - down[k] * u, across[k] * u + down[k] * v
        rest = (focus[k], grow, mean, mean * u, mean * v)
        slopes = np.stack((across[k], down[k], turn, *rest))
        few = informative(mean, slopes * own, model.camera, wanted=_WANTED)
        block = few.repeat(over, axis=0).repeat(over, axis=1)
        block = block[:rows, :columns]
        used[k, : block.shape[0], : block.shape[1]] = block
    return np.asarray(used & inner)


def _read(
    places_px: FloatArray | None, grid: _TemplateGrid, shape: tuple[int, ...]
) -> BoolArray:
    """Return the cells that pixels nearest to some positions, (2, N), may fall on."""
    read = np.zeros(shape, np.uint8)
    if places_px is not None:
        cells = np.rint(grid.over * places_px + np.array(grid.middle)[:, None])
        column, row = cells.astype(np.intp)
        inside = (column >= 0) & (column < shape[1]) & (row >= 0) & (row < shape[0])
        read[row[inside], column[inside]] = 1
    size = 2 * grid.over + 1
    return np.asarray(cv2.dilate(read, np.ones((size, size), np.uint8)) > 0)


def _grown(used: BoolArray, around: int) -> BoolArray:
    """Return the cells and those `around` them."""
    size = 2 * around + 1
    kernel = np.ones((size, size), np.uint8)
    return np.asarray(cv2.dilate(used.astype(np.uint8), kernel) > 0)


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
        few = goal[:, None] > 0
        rank = np.where(few, influence**2 / np.where(few, goal[:, None], 1.0), 0.0)
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
