"""Least-squares fit of a pose to the edges found along a drawing's normals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines import work
from microplan.featuresel.routines.contour.model import turned
from microplan.featuresel.routines.contour.search import ScoredPose
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.sampling import (
    LineEdges,
    edge_kernel,
    find_edges,
    line_samples,
    median,
)

_WEAKEST = 0.3  # of the predicted step: light falls to .7, focus errors take the rest
_FEWEST = 0.5  # of the points in view must carry an edge, and of those half must fit
_LEAST_IN_VIEW = 0.6  # of the points
_ROUNDS = 6  # of trimming
_FLOOR_PX = 0.1  # edges nearer to the fit than this are never trimmed
_FIRST_PX, _LATER_PX = 2.5, 1.5  # search along the normals; the match is a pixel off
_WIDER = 0.5  # of the filter: where that is wide, noise moves edges farther
_NOISE_PX = 0.05  # of one edge, which a known zoom is weighed against


@dataclass(frozen=True, slots=True, kw_only=True)
class ContourFit:
    """A pose by least squares, with its standard deviations."""

    column: float
    row: float
    theta_rad: float
    scale: float  # over nominal
    spread_px: float  # the larger of the two axes
    spread_theta_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Lines:
    """What is known of the edges to be found, one for each of N points."""

    points: FloatArray  # (N, 5), see `contour_model`
    step: FloatArray  # (N,) predicted height
    offset_px: FloatArray  # (N,) of the edge seen from the edge drawn, dark to bright
    width_px: float
    zoom_sigma: float  # of the scale about 1
    turns: bool  # whether the angle is fitted


def fit(image: FloatArray, lines: Lines, start: ScoredPose) -> ContourFit | Failure:
    """Return the pose, px and rad, of edges near `start`, in (rows, columns) pixels.

    Fails with "outside" if too little is in view, "few_edges" if too few edges agree.
    """
    pose = np.array((start.column, start.row, start.theta_rad, 1.0))
    for least_px in (_FIRST_PX, _LATER_PX):
        half_px = max(least_px, _WIDER * lines.width_px)
        edges, in_view = cast(image, lines, pose, half_px)
        if in_view.mean() < _LEAST_IN_VIEW:
            return Failure("outside", f"{in_view.mean():.0%} of the contour in view")
        good = edges.found & (edges.strength > _WEAKEST * lines.step)
        good &= np.abs(edges.offset_px) < half_px
        if good.sum() < max(6, _FEWEST * in_view.sum()):
            return _few(good, in_view)
        design = _design(lines, pose)
        moved = edges.offset_px - lines.offset_px
        solved = _trimmed(design, moved, good, lines, pose[3] - 1)
        if solved is None or solved[1].sum() < max(6, _FEWEST * good.sum()):
            return _few(good if solved is None else solved[1], in_view)
        change, used, inverse = solved
        pose = pose + (change[0], -change[1], change[2], change[3])
    rms = math.sqrt(float(np.mean((moved - design @ change)[used] ** 2)))
    variance = rms**2 * np.diag(inverse)
    return ContourFit(
        column=float(pose[0]),
        row=float(pose[1]),
        theta_rad=float(pose[2]),
        scale=float(pose[3]),
        spread_px=math.sqrt(float(max(variance[0], variance[1]))),
        spread_theta_rad=math.sqrt(float(variance[2])),
    )


def fit_work(lines: Lines) -> float:
    """Return the work of one fit, see `Routine.cost`."""
    count, kernel = len(lines.points), len(edge_kernel(lines.width_px))
    total = 0.0
    for least_px in (_FIRST_PX, _LATER_PX):
        half_px = max(least_px, _WIDER * lines.width_px)
        length = len(line_samples(half_px, lines.width_px))
        total += work.edges(count, length, kernel) + 6 * work.CALLS
    return total


def cast(
    image: FloatArray, lines: Lines, pose: FloatArray, half_px: float
) -> tuple[LineEdges, BoolArray]:
    """Return the edges from dark to bright through N points, px; (N,) in view.

    `image` is (rows, columns).

    `pose` is (column, row, angle, scale); offsets are from the edges drawn.
    """
    x, y, right, up, _ = turned(lines.points, float(pose[2])).T
    along = line_samples(half_px, lines.width_px)
    columns = pose[0] + pose[3] * x
    rows = pose[1] - pose[3] * y
    in_view = (columns >= 0) & (columns <= image.shape[1] - 1)
    in_view &= (rows >= 0) & (rows <= image.shape[0] - 1)
    edges = find_edges(
        image,
        columns[:, None] + right[:, None] * along,
        rows[:, None] - up[:, None] * along,
        width_px=lines.width_px,
        rising=True,
    )
    return edges, in_view


def _design(lines: Lines, pose: FloatArray) -> FloatArray:
    """Return (N, 4): what x, y (up), rotation and scale move each edge by on its line.

    A column of zeros stands for what is not fitted.
    """
    x, y, right, up, _ = turned(lines.points, float(pose[2])).T
    lever = (up * x - right * y) * pose[3] if lines.turns else np.zeros_like(x)
    grow = right * x + up * y if lines.zoom_sigma > 0 else np.zeros_like(x)
    return np.column_stack((right, up, lever, grow))


def _trimmed(
    design: FloatArray, moved: FloatArray, good: BoolArray, lines: Lines, grown: float
) -> tuple[FloatArray, BoolArray, FloatArray] | None:
    """Return (change, used, inverse normal matrix) without the edges that stray."""
    weight = lines.points[:, 4]
    used = good
    for _ in range(_ROUNDS):
        if used.sum() < 6:
            return None
        normal = design[used].T @ (design[used] * weight[used, None])
        right = design[used].T @ (moved * weight)[used]
        if lines.zoom_sigma > 0:  # the scale is known to be near 1
            known = (_NOISE_PX / lines.zoom_sigma) ** 2
            normal[3, 3] += known
            right[3] -= known * grown
        inverse = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
        change: FloatArray = inverse @ right
        residual = np.abs(moved - design @ change)
        limit = max(3 * 1.4826 * median(residual[used]), _FLOOR_PX)
        before, used = used, good & (residual <= limit)
        if np.array_equal(before, used):
            break
    return change, used, np.asarray(inverse, dtype=np.float64)


def _few(good: BoolArray, in_view: BoolArray) -> Failure:
    return Failure(
        "few_edges",
        f"{int(good.sum())} of {int(in_view.sum())} edges agree, "
        f"at least {_FEWEST:.0%}",
    )
