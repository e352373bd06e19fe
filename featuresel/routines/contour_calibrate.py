"""What a contour's edges look like on the nominal images: sizes, places, filters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from featuresel.routines import FloatArray, LookModel, Target
from featuresel.routines.contour_fit import Fit, Lines, cast, fit
from featuresel.routines.contour_model import ROUND, Model, rim_px, turned
from featuresel.routines.contour_search import Field, Pose, field, gradients, score
from featuresel.routines.polarity import Prediction, place, worth
from featuresel.routines.sampling import WIDTHS_PX, median

SHRINKS = (4, 2, 1)  # of the images in which the search may begin
_COARSE_PX = 12.0  # radius of the target there
_AGREE = 0.5  # of the points must be seen there
_RING_PX = 0.5  # radii nearer than this are one ring
# sub-pixel poses whose mean calibrates the places of the edges, px and px of the rim
_POSES = (
    (0.0, 0.0, 0.0),
    (0.31, 0.52, 0.37),
    (0.48, -0.33, -0.42),
    (-0.37, 0.18, 0.81),
    (-0.16, -0.44, -0.87),
    (0.14, 0.27, 0.63),
)


def floor(image: FloatArray, points: FloatArray, at: Pose, shrink: int) -> float:
    """Return the size below which gradients count for their part: the middle one.

    Of the points on the nominal image. Lower, and directions alone would agree all over
    a wide blur.
    """
    right, up = gradients(image, shrink)
    sizes = Field(right=np.hypot(right, up), up=up, shrink=shrink)
    x, y = turned(points, at.theta_rad).T[:2]
    seen, _ = sizes.at(at.column + x, at.row - y)
    return max(float(np.median(seen)), 1e-4)


def coarsest(
    image: FloatArray, points: FloatArray, at: Pose, floors: dict[int, float]
) -> int:
    """Return how far the image may be shrunk for most points to be seen."""
    extent = rim_px(points)
    for shrink in SHRINKS:
        if extent / shrink < _COARSE_PX:
            continue
        seen = field(image, shrink, floors[shrink])
        if score(seen, points, at.column, at.row, at.theta_rad) > _AGREE:
            return shrink
    return 1


def calibrated(
    render: LookModel,
    target: Target,
    model: Model,
    seen: Prediction,
    *,
    tells_turn: bool,
) -> tuple[Lines, float]:
    """Return the edges' mean places at several sub-pixel poses, and what that misses.

    At one pose alone, edges along pixel rows would all have one sampling error. The
    number is the rms per axis, px, that it still makes in the fitted places; where
    turns cannot be told, it has what breaks the symmetry unseen too.
    """
    k = target.px_per_um
    lines = Lines(
        points=model.points,
        step=np.zeros(len(model.points)),
        offset_px=np.zeros(len(model.points)),
        width_px=_fit_width(render(), target, seen),
        zoom_sigma=render.drifts.zoom_sigma,
        turns=model.order != ROUND,
    )
    offsets, steps, shown = [], [], []
    for dx, dy, rolled in _POSES:
        turn = seen_turn = rolled / rim_px(model.points)
        if not tells_turn:
            turn = rolled * target.theta_range_rad
            period = 2 * math.pi / model.order if model.order != ROUND else 0.0
            seen_turn = math.remainder(turn, period) if period else 0.0
        image = render(dx_um=dx / k, dy_um=dy / k, theta_rad=turn)
        pose = Pose(
            column=target.column + dx,
            row=target.row - dy,
            theta_rad=target.theta_rad + seen_turn,
            score=1.0,
        )
        at = np.array((pose.column, pose.row, pose.theta_rad, 1.0))
        edges, _ = cast(image, lines, at, 2.0 + lines.width_px / 2)
        shown.append((image, pose))
        offsets.append(np.where(edges.found, edges.offset_px, np.nan))
        steps.append(edges.strength)
    missing = np.isnan(offsets).any(axis=0)
    mean = np.where(missing, 0.0, np.mean(np.nan_to_num(offsets), axis=0))
    # what is not found at one of the poses is never strong enough
    step = np.where(missing, np.inf, np.mean(steps, axis=0))
    if not lines.turns:
        mean = _on_rings(model.points, mean)
    lines = replace(lines, step=step, offset_px=mean)
    return lines, _locked_px(lines, shown)


def _locked_px(lines: Lines, shown: Sequence[tuple[FloatArray, Pose]]) -> float:
    """Return the rms error per axis of fits to images without noise, px."""
    errors = []
    for image, pose in shown:
        found = fit(image, lines, pose)
        if isinstance(found, Fit):
            errors.append((found.column - pose.column, found.row - pose.row))
    if len(errors) < 2:
        return math.inf
    # their own mean is part of the calibration
    each = np.square(errors).sum(axis=0) / (len(errors) - 1)
    return math.sqrt(float(each.max()))


def _fit_width(image: FloatArray, target: Target, seen: Prediction) -> float:
    """Return the filter that fixes the pose best; all that is seen moves as one.

    It may thus be wider than the one that tells an edge from its neighbours.
    """
    where = place(np.array(target.contour), target)
    wide = [width for width in WIDTHS_PX if width >= seen.width_px]
    return max(wide, key=lambda w: worth(image, where, replace(seen, width_px=w)))


def _on_rings(points: FloatArray, offset_px: FloatArray) -> FloatArray:
    """Return the middle offset of all points as far from the centre as each.

    Where the angle is not known, no point can be told from another on its ring.
    """
    radius = np.hypot(points[:, 0], points[:, 1])
    alike = np.abs(radius[:, None] - radius) < _RING_PX
    return np.array([median(offset_px[row]) for row in alike])
