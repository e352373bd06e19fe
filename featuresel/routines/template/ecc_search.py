"""A template's position and rotation in an image, by OpenCV's correlation steps."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from microplan.arrays import Float32Array, FloatArray
from microplan.featuresel.routines.contract import Failure

FAINT = 0.01  # standard deviation below which a template shows nothing
REACH_PX = 6.0  # from the start: beyond, it has run away

_LAST_PX = 0.1  # the step after convergence: a larger one is no convergence
_ROUNDS, _SETTLED = 20, 1e-6  # of the correlation
_NO_BLUR = 1  # OpenCV blurs both images by 5 px otherwise, which shifts what is found
_QUARTER_RAD = math.pi / 2
_GRID = 32  # OpenCV's warp rounds coordinates to this part of a pixel


@dataclass(frozen=True, slots=True, kw_only=True)
class TemplatePose:
    """Where the template's middle pixel is, px, and how far it is turned."""

    column: float
    row: float
    turned_rad: float
    score: float


def align(
    image: FloatArray, upright: Float32Array, start: TemplatePose, *, turns: bool
) -> TemplatePose | Failure:
    """Return the pose, px, of the highest correlation in a (rows, columns) image.

    OpenCV takes the angle from its sine, so the template is turned by quarters first,
    which moves pixels onto pixels. Its warp rounds coordinates to 1/32 px and then
    steps as if it had not, so one last step starts on that grid, where rounding
    changes nothing.
    """
    quarters = round(start.turned_rad / _QUARTER_RAD)
    template = np.ascontiguousarray(np.rot90(upright, quarters))
    left, top, part = _part(image, template.shape, start)
    if min(part.shape) < 4:
        return Failure("outside", "the target is out of view")
    if not float(part.std()) > FAINT / 2:
        return Failure("no_contrast", "the image is blank")
    at = TemplatePose(
        column=start.column - left,
        row=start.row - top,
        turned_rad=start.turned_rad - quarters * _QUARTER_RAD,
        score=0.0,
    )
    found = _search(part, template, at, _ROUNDS, turns=turns)
    if isinstance(found, Failure):
        return found
    on_grid = replace(
        found,
        column=round(found.column * _GRID) / _GRID,
        row=round(found.row * _GRID) / _GRID,
    )
    last = _search(part, template, on_grid, 1, turns=turns)
    if isinstance(last, Failure):
        return last
    step = math.hypot(last.column - on_grid.column, last.row - on_grid.row)
    if not step <= _LAST_PX:
        return Failure("diverged", f"still moves by {step:.3f} px")
    return replace(
        last,
        column=last.column + left,
        row=last.row + top,
        turned_rad=last.turned_rad + quarters * _QUARTER_RAD,
    )


def _part(
    image: FloatArray, shape: tuple[int, ...], at: TemplatePose
) -> tuple[int, int, Float32Array]:
    """Return left, top and the piece of the image that the template may reach."""
    reach = math.hypot(*shape) / 2 + REACH_PX
    left, top = max(0, int(at.column - reach)), max(0, int(at.row - reach))
    right, bottom = max(0, int(at.column + reach)), max(0, int(at.row + reach))
    part = image[top : bottom + 1, left : right + 1]
    return left, top, np.ascontiguousarray(part, dtype=np.float32)


def _search(
    image: Float32Array,
    template: Float32Array,
    start: TemplatePose,
    rounds: int,
    *,
    turns: bool,
) -> TemplatePose | Failure:
    """Return the pose after `rounds` of OpenCV's steps at most.

    References
    ----------
    Evangelidis & Psarakis (2008).
    """
    motion = cv2.MOTION_EUCLIDEAN if turns else cv2.MOTION_TRANSLATION
    middle = ((template.shape[1] - 1) / 2, (template.shape[0] - 1) / 2)
    limits = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, rounds, _SETTLED)
    everywhere = np.ones(image.shape, dtype=np.uint8)
    try:
        score, warp = cv2.findTransformECC(
            template,
            image,
            _warp(start, middle),
            motion,
            limits,
            everywhere,
            _NO_BLUR,
        )
    except cv2.error as error:
        return Failure("diverged", f"no convergence: {error.err}")
    if not (math.isfinite(score) and np.isfinite(warp).all()):
        return Failure("diverged", "no finite pose")
    m = warp.astype(np.float64)
    column, row = m @ (*middle, 1.0)
    return TemplatePose(
        column=float(column),
        row=float(row),
        turned_rad=math.atan2(-m[1, 0], m[0, 0]),
        score=float(score),
    )


def _warp(pose: TemplatePose, middle: tuple[float, float]) -> Float32Array:
    """Return the map (2, 3) from the template's pixels to the image's."""
    c, s = math.cos(pose.turned_rad), math.sin(pose.turned_rad)
    x, y = turned(middle, pose.turned_rad)
    return np.array(((c, s, pose.column - x), (-s, c, pose.row - y)), dtype=np.float32)


def turned(point: tuple[float, float], turned_rad: float) -> tuple[float, float]:
    """Return (columns, rows) turned counter-clockwise as displayed: rows go down."""
    c, s = math.cos(turned_rad), math.sin(turned_rad)
    return c * point[0] + s * point[1], -s * point[0] + c * point[1]
