"""Ellipse through the iso-line of a round rim, for pixels or parts that lean."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines.circle.rim import CAPTURE_PX as _AWAY_PX
from microplan.featuresel.routines.circle.rim import RimPoints, approach, approach_work
from microplan.featuresel.routines.circle.rim_plan import placed, prepare_rim
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    Measurement,
    PoseTerm,
    Render,
    Target,
    TargetKind,
)
from microplan.featuresel.routines.sampling import median

NAME = "iso_ellipse"
VERSION = "2"
KINDS: tuple[TargetKind, ...] = ("circle", "teeth")
PROVIDES: tuple[PoseTerm, ...] = ("xy",)
REQUIRES: tuple[PoseTerm, ...] = ("xy",)
CAPTURE_PX = _AWAY_PX
BASELINE = False
EXPENSIVE = False

_RADIUS_OFF = 0.1  # of the radius, at least 1 px: as far as blur and zoom may move it
_FLAT = 1.1  # long axis over short one, at most: what leans so much is another thing
_USED = 0.5  # of the points must fit the ellipse
_ROUNDS = 6  # of trimming
_ELLIPSE_WORK = 0.7  # of those, in box filters


@dataclass(frozen=True, slots=True, kw_only=True)
class _Ellipse:
    """An ellipse and the points that made it."""

    column: float
    row: float
    radius_px: float  # geometric mean of the half axes
    flat: float  # long axis over short one
    used: BoolArray  # (N,)
    spread_px: float


def prepare(render: Render, target: Target) -> Artifact | Failure:
    """Return radius, level and filter, and where the notch pulls the centre."""
    return prepare_rim(render, target, _centre)


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the ellipse's centre; fails if it is faint, cut off or of another size."""
    p = artifact.parameters
    found = _fit(image, p, guess)
    if isinstance(found, Failure):
        return found
    off = abs(found.radius_px - p["seen_px"])
    if off > max(1.0, _RADIUS_OFF * p["radius_px"]) or not found.flat <= _FLAT:
        return Failure(
            code="radius_off",
            message=f"radius {found.radius_px:.2f} px, predicted {p['seen_px']:.2f}, "
            f"axes {found.flat:.3f} to 1",
        )
    column, row = placed((found.column, found.row), p, guess)
    return Measurement(
        column=column,
        row=row,
        theta_rad=None,
        score=float(found.used.mean()),
        spread_px=found.spread_px,
    )


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    return approach_work(artifact.parameters) + _ELLIPSE_WORK


def _centre(
    image: FloatArray, p: Mapping[str, float], guess: Guess
) -> tuple[float, float, float] | Failure:
    """Return column, row and radius of the ellipse."""
    found = _fit(image, p, guess)
    if isinstance(found, Failure):
        return found
    return found.column, found.row, found.radius_px


def _fit(image: FloatArray, p: Mapping[str, float], guess: Guess) -> _Ellipse | Failure:
    """Return the ellipse, from the circle's points."""
    found = approach(image, p, guess)
    if isinstance(found, Failure):
        return found
    points, circle = found
    return _trimmed(points, (circle.column, circle.row), circle.used)


def _trimmed(
    points: RimPoints, at: tuple[float, float], used: BoolArray
) -> _Ellipse | Failure:
    """Return the direct least-squares ellipse through all but stray points.

    References
    ----------
    Fitzgibbon, Pilu & Fisher (1999), as in OpenCV's `fitEllipseDirect`.
    """
    # single precision is kept for what is small: points about the circle's centre
    u, v = points.columns - at[0], points.rows - at[1]
    for _ in range(_ROUNDS):
        if used.sum() < max(6, _USED * len(u)):
            return Failure(
                code="few_points",
                message=f"{used.mean():.0%} of the points fit, at least {_USED:.0%}",
            )
        pairs = np.column_stack((u, v))[used].astype(np.float32)
        (x, y), axes, turn_deg = cv2.fitEllipseDirect(pairs)
        if not (min(axes) > 0 and math.isfinite(x + y + sum(axes) + turn_deg)):
            return Failure(code="no_edge", message="the points make no ellipse")
        residual = _residual(u - x, v - y, axes, turn_deg)
        limit = max(3 * 1.4826 * median(np.abs(residual[used])), 0.05)
        before, used = used, np.abs(residual) <= limit
        if np.array_equal(used, before):
            break
    angles = np.arctan2(v - y, u - x)[used]
    waves = [f(k * angles) for k in (1, 2) for f in (np.cos, np.sin)]
    design = np.column_stack((np.ones_like(angles), *waves))
    inverse = np.linalg.pinv(design.T @ design)
    rms = float(np.sqrt(np.mean(residual[used] ** 2)))
    scatter = rms * math.sqrt(float(inverse[1, 1] + inverse[2, 2]) / 2)
    return _Ellipse(
        column=at[0] + x,
        row=at[1] + y,
        radius_px=math.sqrt(axes[0] * axes[1]) / 2,
        flat=max(axes) / min(axes),
        used=used,
        spread_px=points.spread_px(scatter),
    )


def _residual(
    u: FloatArray, v: FloatArray, axes: Sequence[float], turn_deg: float
) -> FloatArray:
    """Return how far points about the centre are out of the ellipse along the ray."""
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    scaled = np.hypot((c * u + s * v) * 2 / axes[0], (c * v - s * u) * 2 / axes[1])
    distance: FloatArray = np.hypot(u, v) * (1 - 1 / np.maximum(scaled, 1e-9))
    return distance
