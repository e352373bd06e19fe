"""What each point of a drawn edge will look like: which side is brighter, how much.

A vision engineer says by hand whether a part is brighter than what is around it; here
the rendered image says it for every point of the contour, and leaves out the points
that it cannot be said of: faint ones, those blurred into or hidden by another edge, and
those whose brightness changes sides within the focus error or against the sharp image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines.contract import LookModel, Target
from microplan.featuresel.routines.sampling import (
    STEP_PX,
    WIDTHS_PX,
    cubic,
    edge_kernel,
)

_WIDTHS_PX = WIDTHS_PX[:4]  # wider filters blur edges of fine parts into each other
FAINT = 0.02  # step height below which an edge drowns in 8 bits and shot noise
_NOISES = 4.0  # standard deviations of the filtered noise that a step must reach
_WEAKEST = 0.15  # of the strongest tenth: less is the ring of another edge's blur
# of a wide filter's step through the narrowest: the widest blur leaves .8 / 2.7
_LOCAL = 0.2
_SQUARE = 0.7  # cosine between the image's gradient and the normal
_ASIDE_PX, _ASIDE = 1.0, 0.5  # the edge seen is this near: px, and of the filter
_MOVED_PX = 0.2  # to distinguish the target's edges: the images have no noise
_OWN = 0.5  # of the step must go with the target
_FOCUS_SIGMAS = 2.0  # of the focus error, through which the polarity must hold
# of the focus, where the sharpest image of the target is looked for
_SWEEP_UM = (-32.0, -16.0, -8.0, -4.0, 0.0)
_SWEEP_UM = (*_SWEEP_UM, *(-z for z in reversed(_SWEEP_UM[:-1])))
_ACROSS = 0.5  # of a step must be between points one blur off the edge
# so much at least: four standard errors of a difference in images in a ring's light,
# each of which errs by .012 rms (`microplan.optics.ledger.LIT_ERROR`), and of one
# beside edges, where it errs by .125 rms of all that lies within two blurs
_TRUSTED, _SWING = 0.07, 0.5
_CORNER = 0.7  # cosine between normals: what turns by more is another edge
_AT_ONCE = 256  # points that all are compared with: a limit to memory
_AIRY = 1.22  # radius of the first dark ring, over the period of the cutoff
_SHARP = 0.7  # of the sharpest image's gradient: no need to look for a sharper one


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """What is predicted of N contour points; arrays are (N,)."""

    step: FloatArray  # brightness outside minus inside, through the filter
    offset_px: FloatArray  # of the edge seen, outwards from the edge drawn
    kept: BoolArray  # whether polarity and place can be relied on
    width_px: float  # standard deviation of the edge filter that suits them best


def predict(
    render: LookModel, target: Target, *, image: FloatArray | None = None
) -> Prediction:
    """Return polarity, contrast and position of the target's edges at nominal pose.

    Parameters
    ----------
    render : LookModel
        The look.
    target : Target
        With its contour.
    image : (rows, columns) float array, optional
        The nominal image, if it is rendered already.

    Returns
    -------
    Prediction
        `kept` is False for all points of a target out of view or without contrast.

    Notes
    -----
    A step is the response of a Gaussian derivative of which a unit step gives 1. What
    is kept is above the noise; square to the image's gradient; near the extremum of its
    profile; there for the narrowest filter too; moves with the target; has the same
    sign at focus errors of two sigma to both sides, and where the target is sharpest
    (no spurious resolution). In a ring's light, where edges are lines and walls throw
    shadows, a step must stand between points one blur off the drawn edge, too, wherever
    in their roundings lines lie, and corners are more than half a blur away.
    """
    contour = np.array(target.contour, dtype=np.float64).reshape(-1, 4)
    image = render() if image is None else image
    where = place(contour, target)
    tried = [_through(render, image, where, width) for width in _WIDTHS_PX]
    best = max(tried, key=lambda one: worth(image, where, one))
    kept = best.kept
    if kept.any():
        kept = kept & _own(render, target, image, where, best)
        kept &= _steadfast(render, target, where, best)
        if render.nuisances.has_lines:
            kept &= _straight(where, _blur_px(render, target) / 2)
            kept &= _across(render, target, image, where, best)
            kept &= _lined(render, target, where, best)
    return replace(best, kept=kept)


def place(contour: FloatArray, target: Target) -> FloatArray:
    """Return contour points (N, 4) at the nominal pose: column, row, normal, px."""
    c, s, k = math.cos(target.theta_rad), math.sin(target.theta_rad), target.px_per_um
    x, y, nx, ny = contour.T
    return np.column_stack(
        (
            target.column + k * (c * x - s * y),
            target.row - k * (s * x + c * y),
            c * nx - s * ny,
            -(s * nx + c * ny),
        )
    )


def profiles(image: FloatArray, where: FloatArray, half_px: float) -> FloatArray:
    """Return (N, L) values along the normals outwards, nan outside the image."""
    count = math.ceil(half_px / STEP_PX)
    along = np.arange(-count, count + 1) * STEP_PX
    column, row, across, down = where.T[:, :, None]
    values, inside = cubic(image, column + across * along, row + down * along)
    found: FloatArray = np.where(inside, values, np.nan)
    return found


def worth(image: FloatArray, where: FloatArray, seen: Prediction) -> float:
    """Return the log determinant of position and rotation by the kept edges, px.

    `image` is (rows, columns), `where` (N, M) px.

    Each edge counts by the curvature of its response over the noise of the slope there,
    squared: the inverse variance of its position (Canny 1986).
    """
    if not seen.kept.any():
        return -math.inf
    kernel = edge_kernel(seen.width_px)
    own, change = where[seen.kept], np.diff(kernel)
    half = len(kernel) // 2 * STEP_PX
    bend = np.diff(profiles(image, own, half + STEP_PX), axis=1)
    curved = (bend[:, 1:] - bend[:, :-1])[:, : len(kernel)] @ kernel
    away = own[:, :2] - own[:, :2].mean(axis=0)
    lever = away[:, 0] * own[:, 3] - away[:, 1] * own[:, 2]
    size = math.sqrt(float((away**2).sum(axis=1).mean())) + 1e-9
    rows = np.column_stack((own[:, 2], own[:, 3], lever / size))
    rows *= (np.nan_to_num(curved) / np.linalg.norm(change))[:, None]
    information = rows.T @ rows
    # a direction that is not known at all decides nothing
    least = 1e-9 * float(np.trace(information)) + 1e-300
    return float(np.linalg.slogdet(information + least * np.eye(3))[1])


def _through(
    render: LookModel, image: FloatArray, where: FloatArray, width_px: float
) -> Prediction:
    """Return what one filter shows of the nominal image."""
    step, offset = _edges(image, where, width_px)
    kept = np.isfinite(step) & np.isfinite(offset)
    step, offset = np.where(kept, step, 0.0), np.where(kept, offset, 0.0)
    kept &= np.abs(step) >= _faintest(render, image, step, width_px)
    kept &= np.abs(offset) <= _ASIDE_PX + _ASIDE * width_px
    kept &= _squareness(image, where, width_px) >= _SQUARE
    kept &= _local(image, where) * np.sign(step) >= _LOCAL * np.abs(step)
    return Prediction(step=step, offset_px=offset, kept=kept, width_px=width_px)


def _edges(
    image: FloatArray, where: FloatArray, width_px: float
) -> tuple[FloatArray, FloatArray]:
    """Return (step, offset): response at the drawn position, and its nearest extremum.

    The extremum is sought uphill from the drawn position and along the response's sign
    there; it is nan where the search leaves the profile.
    """
    kernel = edge_kernel(width_px)
    reach = _ASIDE_PX + _ASIDE * width_px + 2 * STEP_PX
    lines = profiles(image, where, reach + len(kernel) // 2 * STEP_PX)
    windows = np.lib.stride_tricks.sliding_window_view(lines, len(kernel), axis=1)
    response = windows @ kernel
    middle = response.shape[1] // 2
    sign = np.where(response[:, middle] < 0, -1.0, 1.0)
    lifted = np.nan_to_num(response * sign[:, None], nan=-np.inf)
    each, at = np.arange(len(lifted)), np.full(len(lifted), middle)
    for _ in range(middle):
        near = np.clip(at[:, None] + (-1, 0, 1), 0, lifted.shape[1] - 1)
        at = near[each, lifted[each[:, None], near].argmax(axis=1)]
    inner = (at > 0) & (at < lifted.shape[1] - 1)
    at = np.clip(at, 1, lifted.shape[1] - 2)
    before, peak, after = (response[each, at + i] * sign for i in (-1, 0, 1))
    bend = 2 * peak - before - after
    inner &= bend > 0
    shift = (after - before) / (2 * np.where(inner, bend, 1.0))
    offset = (at - middle + shift) * STEP_PX
    return response[:, middle], np.where(inner, offset, np.nan)


def _faintest(
    render: LookModel, image: FloatArray, step: FloatArray, width_px: float
) -> float:
    """Return the least step that counts as an edge."""
    sigma = math.sqrt(float(render.camera.variance(image).max()))
    # along an edge as much is averaged as across it; white noise sampled each half px
    noise = sigma * float(np.linalg.norm(edge_kernel(width_px))) / math.sqrt(2)
    strong = float(np.percentile(np.abs(step), 90)) if len(step) else 0.0
    return max(FAINT, _NOISES * noise, _WEAKEST * strong)


def _local(image: FloatArray, where: FloatArray) -> FloatArray:
    """Return the steps through the narrowest filter, which sees no other edge."""
    kernel = edge_kernel(WIDTHS_PX[0])
    found: FloatArray = profiles(image, where, len(kernel) // 2 * STEP_PX) @ kernel
    return np.nan_to_num(found)


def _squareness(image: FloatArray, where: FloatArray, width_px: float) -> FloatArray:
    """Return the cosine between the image's gradient, smoothed, and the normal."""
    ahead = np.column_stack((where[:, :2], -where[:, 3], where[:, 2]))
    kernel = edge_kernel(width_px)
    half = len(kernel) // 2 * STEP_PX
    across = profiles(image, where, half) @ kernel
    along = profiles(image, ahead, half) @ kernel
    size = np.hypot(across, along)
    known = np.isfinite(size) & (size > 0)
    return np.where(known, np.abs(across) / np.where(known, size, 1.0), 0.0)


def _own(
    render: LookModel,
    target: Target,
    image: FloatArray,
    where: FloatArray,
    seen: Prediction,
) -> BoolArray:
    """Return which edges go with the target: others' stay where it is moved.

    Moved by d the image changes by -d times its gradient, which under a Gaussian of
    height 1 sums up to the step.
    """
    moved_um = _MOVED_PX / target.px_per_um
    right = render(dx_um=moved_um) - image
    up = render(dy_um=moved_um) - image
    half = 3 * seen.width_px
    count = math.ceil(half / STEP_PX)
    along = np.arange(-count, count + 1) * STEP_PX
    window = np.exp(-((along / seen.width_px) ** 2) / 2)
    across, upward = (
        np.nan_to_num(profiles(part, where, half)) @ window * STEP_PX / _MOVED_PX
        for part in (right, up)
    )
    step = -(across * where[:, 2] - upward * where[:, 3])
    found: BoolArray = step * np.sign(seen.step) >= _OWN * np.abs(seen.step)
    return found


def _straight(where: FloatArray, within_px: float) -> BoolArray:
    """Return which points have no edge of another direction that near."""
    found = np.ones(len(where), dtype=np.bool_)
    for rows in np.array_split(np.arange(len(where)), len(where) // _AT_ONCE + 1):
        apart = where[rows, None, :2] - where[None, :, :2]
        is_near = np.sum(apart**2, axis=2) < within_px**2
        turned = where[rows, 2:] @ where[:, 2:].T < _CORNER
        found[rows] = ~np.any(is_near & turned, axis=1)
    return found


def _across(
    render: LookModel,
    target: Target,
    image: FloatArray,
    where: FloatArray,
    seen: Prediction,
) -> BoolArray:
    """Return which steps are those between points one blur off the edge drawn."""
    blur_px = _blur_px(render, target)
    across = _difference(image, where, blur_px) * np.sign(seen.step)
    near = np.abs(seen.offset_px) <= blur_px
    about = np.nan_to_num(profiles(image, where, 2 * blur_px))
    least = np.maximum(_ACROSS * np.abs(seen.step), _SWING * np.ptp(about, axis=1))
    least = np.maximum(least, _TRUSTED)
    found: BoolArray = near & (across >= least)
    return found


def _lined(
    render: LookModel, target: Target, where: FloatArray, seen: Prediction
) -> BoolArray:
    """Return which steps stand wherever lines of edges lie, by half as much."""
    blur_px = _blur_px(render, target)
    found = np.ones(len(where), dtype=np.bool_)
    for image in render.line_images():
        across = _difference(image, where, blur_px) * np.sign(seen.step)
        about = np.nan_to_num(profiles(image, where, 2 * blur_px))
        least = np.maximum(_SWING * np.ptp(about, axis=1), _TRUSTED) / 2
        found &= (across >= least) & (_local(image, where) * seen.step > 0)
    return found


def _blur_px(render: LookModel, target: Target) -> float:
    """Return the radius of the blur in focus, a pixel at least."""
    return max(_AIRY / render.blur.cutoff_per_um * target.px_per_um, 1.0)


def _difference(image: FloatArray, where: FloatArray, by_px: float) -> FloatArray:
    """Return how much brighter an image is outside of edges, so far off them, (N,)."""
    outside, inside = (
        cubic(
            image,
            where[:, 0] + side * by_px * where[:, 2],
            where[:, 1] + side * by_px * where[:, 3],
        )[0]
        for side in (1, -1)
    )
    return np.nan_to_num(outside - inside)


def _steadfast(
    render: LookModel, target: Target, where: FloatArray, seen: Prediction
) -> BoolArray:
    """Return which edges are brighter on the same side in all images they may have."""
    off = _FOCUS_SIGMAS * render.nuisances.focus_sigma_um
    heights = {-off, off, _sharpest_um(render, target)} - {0.0}
    same = np.ones(len(where), dtype=np.bool_)
    for dz_um in sorted(heights):
        same &= _local(render(dz_um=dz_um), where) * np.sign(seen.step) > 0
    return same


def _sharpest_um(render: LookModel, target: Target) -> float:
    """Return the focus error that makes the target sharpest; 0 if it is sharp."""
    x, y = np.abs(np.array(target.contour)[:, :2]).max(axis=0)
    reach = math.ceil(min(math.hypot(x, y) * target.px_per_um, 200.0)) + 4
    stack = render.template(_SWEEP_UM, over=1, half_px=(reach, reach))
    down, across = np.gradient(stack, axis=(1, 2))
    sharpness = (across**2 + down**2).mean(axis=(1, 2))
    best = int(sharpness.argmax())
    if sharpness[_SWEEP_UM.index(0.0)] >= _SHARP * sharpness[best]:
        return 0.0
    return _SWEEP_UM[best]
