"""What a contour's edges look like on the nominal images: sizes, positions, filters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contour.fit import ContourFit, Lines, cast, fit
from microplan.featuresel.routines.contour.model import (
    ROUND,
    ContourModel,
    rim_px,
    turned,
)
from microplan.featuresel.routines.contour.polarity import Prediction, place, worth
from microplan.featuresel.routines.contour.search import (
    Field,
    ScoredPose,
    field,
    gradients,
    score,
)
from microplan.featuresel.routines.contract import LookModel, Target
from microplan.featuresel.routines.sampling import WIDTHS_PX, median

SHRINKS = (4, 2, 1)  # of the images in which the search may begin
_COARSE_PX = 12.0  # radius of the target there
_AGREE = 0.5  # of the points must be seen there
_RING_PX = 0.5  # radii nearer than this are one ring
# sub-pixel poses whose mean calibrates the positions of the edges, px and px of the rim
_POSES = (
    (0.0, 0.0, 0.0),
    (0.31, 0.52, 0.37),
    (0.48, -0.33, -0.42),
    (-0.37, 0.18, 0.81),
    (-0.16, -0.44, -0.87),
    (0.14, 0.27, 0.63),
)
_NEVER = 9.0  # step of what is not found at one of them: none is as strong
_AWAY = 0.5  # of the search: so far the static scene is seen elsewhere by the target
_WAYS = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))


def floor(image: FloatArray, points: FloatArray, at: ScoredPose, shrink: int) -> float:
    """Return the gradient below which points count for their part: the median.

    Of (N, 4) points, px, on the nominal image, (rows, columns).

    Of the points on the nominal image. Lower, and directions alone would agree all over
    a wide blur.
    """
    right, up = gradients(image, shrink)
    sizes = Field(right=np.hypot(right, up), up=up, shrink=shrink)
    x, y = turned(points, at.theta_rad).T[:2]
    seen, _ = sizes.at(at.column + x, at.row - y)
    return max(float(np.median(seen)), 1e-4)


def coarsest(
    image: FloatArray, points: FloatArray, at: ScoredPose, floors: dict[int, float]
) -> int:
    """Return how far the image may be shrunk for most points to be seen.

    Points are (N, 4) px, the image is (rows, columns).
    """
    extent = rim_px(points)
    for shrink in SHRINKS:
        if extent / shrink < _COARSE_PX:
            continue
        seen = field(image, shrink, floors[shrink])
        if score(seen, points, at.column, at.row, at.theta_rad) > _AGREE:
            return shrink
    return 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Views:
    """Renders a target moved in px of the image, and says where its model is then."""

    render: LookModel
    target: Target
    model: ContourModel
    tells_turn: bool

    def at(
        self, dx_px: float, dy_px: float, rolled_px: float, dz_um: float = 0.0
    ) -> tuple[FloatArray, ScoredPose]:
        """Return the image, (rows, columns) 0..1, and the pose it shows.

        A rotation that is not observable is drawn anyhow.

        `rolled_px` is that of the rim, or, of rotations that are not observable, the
        share of their range.
        """
        target, order, k = self.target, self.model.order, self.target.px_per_um
        turn = seen_turn = rolled_px / rim_px(self.model.points)
        if not self.tells_turn:
            turn = rolled_px * target.theta_range_rad
            period = 2 * math.pi / order if order != ROUND else 0.0
            seen_turn = math.remainder(turn, period) if period else 0.0
        image = self.render(
            dx_um=dx_px / k, dy_um=dy_px / k, theta_rad=turn, dz_um=dz_um
        )
        pose = ScoredPose(
            column=target.column + dx_px,
            row=target.row - dy_px,
            theta_rad=target.theta_rad + seen_turn,
            score=1.0,
        )
        return image, pose


def calibrated(
    views: Views, seen: Prediction, image: FloatArray
) -> tuple[Lines, tuple[float, float]] | None:
    """Return the edges' mean positions at several sub-pixel poses, steps and bias.

    `image` is the nominal one, (rows, columns).

    At one pose alone, edges along pixel rows would all have one sampling error. The
    bias is the rms of what is not noise in a fit, px per axis and rad: of sampling, of
    what moves against the target, and of focus errors of one sigma; where rotations are
    not observable, of what breaks the symmetry unseen too. `image` is the nominal one.
    None if the fit fails on the target's own images.
    """
    shown = [views.at(*moved) for moved in _POSES]
    lines = _mean_lines(views, shown, _fit_width(image, views.target, seen))
    bias = _bias(views, lines, shown)
    return None if bias is None else (lines, bias)


def _mean_lines(
    views: Views, shown: Sequence[tuple[FloatArray, ScoredPose]], width_px: float
) -> Lines:
    """Return the edges as they are in the mean of the images."""
    points = views.model.points
    lines = Lines(
        points=points,
        step=np.zeros(len(points)),
        offset_px=np.zeros(len(points)),
        width_px=width_px,
        zoom_sigma=views.render.nuisances.zoom_sigma,
        turns=views.model.order != ROUND,
    )
    offsets, steps = [], []
    for image, pose in shown:
        at = np.array((pose.column, pose.row, pose.theta_rad, 1.0))
        edges, _ = cast(image, lines, at, 2.0 + lines.width_px / 2)
        offsets.append(np.where(edges.found, edges.offset_px, np.nan))
        steps.append(edges.strength)
    missing = np.isnan(offsets).any(axis=0)
    mean = np.where(missing, 0.0, np.mean(np.nan_to_num(offsets), axis=0))
    step = np.where(missing, _NEVER, np.mean(steps, axis=0))
    if not lines.turns:
        mean = _on_rings(points, mean)
    return replace(lines, step=step, offset_px=mean)


def _bias(
    views: Views, lines: Lines, shown: Sequence[tuple[FloatArray, ScoredPose]]
) -> tuple[float, float] | None:
    """Return the rms of a fit's bias, px per axis and rad, see `calibrated`."""
    off_px = _AWAY * views.target.search_px
    sigma_um = views.render.nuisances.focus_sigma_um
    away = [views.at(x * off_px, y * off_px, 0.0) for x, y in _WAYS]
    blurred = [views.at(0.0, 0.0, 0.0, z * sigma_um) for z in (-1, 1)]
    total = np.zeros(3)
    for images in (shown, away, blurred if sigma_um > 0 else []):
        errors = [_error(lines, *one) for one in images]
        known = [one for one in errors if one is not None]
        if 2 * len(known) < len(images):
            return None
        if known:
            total += np.square(known).mean(axis=0)
    return math.sqrt(float(total[:2].max())), math.sqrt(float(total[2]))


def _error(
    lines: Lines, image: FloatArray, pose: ScoredPose
) -> tuple[float, float, float] | None:
    """Return how far a fit is off, px and rad; None if it fails."""
    found = fit(image, lines, pose)
    if not isinstance(found, ContourFit):
        return None
    turn = found.theta_rad - pose.theta_rad
    return (found.column - pose.column, found.row - pose.row, turn)


def _fit_width(image: FloatArray, target: Target, seen: Prediction) -> float:
    """Return the filter that fixes the pose best; all that is seen moves as one.

    It may thus be wider than the one that separates an edge from its neighbours.
    """
    where = place(np.array(target.contour), target)
    wide = [width for width in WIDTHS_PX if width >= seen.width_px]
    return max(wide, key=lambda w: worth(image, where, replace(seen, width_px=w)))


def _on_rings(points: FloatArray, offset_px: FloatArray) -> FloatArray:
    """Return the middle offset of all points as far from the centre as each.

    Where the angle is not known, no point is distinguished from another on its ring.
    """
    radius = np.hypot(points[:, 0], points[:, 1])
    alike = np.abs(radius[:, None] - radius) < _RING_PX
    return np.array([median(offset_px[row]) for row in alike])
