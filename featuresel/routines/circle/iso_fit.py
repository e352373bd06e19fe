"""Circle or ellipse through the iso-line at the level that the render predicts.

Good out of focus, where calipers need long lines, and under light that has a gradient:
the level is a plane between both sides of the rim. What is near the rim and blurred
into one of its sides pulls it. So does its own blur, where that is much wider than the
planned one and reaches the sides: the centre then stays near the guess, does not
settle, and is refused. The ellipse is for pixels or parts that lean.
`benchmarks/localisation` has the numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines.circle.circle_fit import FittedCircle
from microplan.featuresel.routines.circle.rim import (
    CAPTURE_PX,
    RimPoints,
    approach,
    approach_work,
)
from microplan.featuresel.routines.circle.rim_plan import placed, prepare_rim
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    Routine,
    Target,
)
from microplan.featuresel.routines.sampling import median

_RADIUS_OFF = 0.1  # of the radius, at least 1 px: as far as blur and zoom may move it
_FLAT = 1.1  # long axis over short one, at most: what leans so much is another thing
_USED = 0.5  # of the points must fit the curve
_ROUNDS = 6  # of trimming
_ELLIPSE_WORK = 0.7  # of those, in box filters


def prepare_circle(render: LookModel, target: Target) -> Artifact | Failure:
    """Return radius, level and filter, and where the notch pulls the centre."""
    return prepare_rim(render, target, _circle)


def measure_circle(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the circle's centre, px, in `image`, (rows, columns) 0..1.

    Fails if the circle is faint, cut off or of another size.
    """
    p = artifact.parameters
    circle = _circle(image, p, guess)
    if isinstance(circle, Failure):
        return circle
    if _is_off(circle, p):
        return Failure(
            "radius_off",
            f"radius {circle.radius_px:.2f} px, predicted {p['seen_px']:.2f}",
        )
    if circle.used.mean() < _USED:
        return _few(circle.used)
    return _measurement(circle, p, guess)


def circle_cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure_circle`, see `contract.Routine`."""
    return approach_work(artifact.parameters)


ISO_CIRCLE = Routine(
    name="iso_circle",
    version="2",
    kinds=("circle", "teeth"),
    principle="edges",
    provides=("xy",),
    requires=("xy",),
    capture_px=CAPTURE_PX,
    prepare=prepare_circle,
    measure=measure_circle,
    cost=circle_cost,
)


def prepare_ellipse(render: LookModel, target: Target) -> Artifact | Failure:
    """Return radius, level and filter, and where the notch pulls the centre."""
    return prepare_rim(render, target, _ellipse)


def measure_ellipse(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the ellipse's centre, px, in `image`, (rows, columns) 0..1.

    Fails if the ellipse is faint, cut off or of another size.
    """
    p = artifact.parameters
    found = _ellipse(image, p, guess)
    if isinstance(found, Failure):
        return found
    if _is_off(found, p) or not found.flat <= _FLAT:
        return Failure(
            "radius_off",
            f"radius {found.radius_px:.2f} px, predicted {p['seen_px']:.2f}, "
            f"axes {found.flat:.3f} to 1",
        )
    return _measurement(found, p, guess)


def ellipse_cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure_ellipse`, see `contract.Routine`."""
    return approach_work(artifact.parameters) + _ELLIPSE_WORK


ISO_ELLIPSE = replace(
    ISO_CIRCLE,
    name="iso_ellipse",
    prepare=prepare_ellipse,
    measure=measure_ellipse,
    cost=ellipse_cost,
)


def _is_off(curve: FittedCircle, p: Mapping[str, float]) -> bool:
    """Return whether the radius is another one than blur and zoom explain."""
    off = abs(curve.radius_px - p["seen_px"])
    return off > max(1.0, _RADIUS_OFF * p["radius_px"])


def _measurement(
    curve: FittedCircle, p: Mapping[str, float], guess: Guess
) -> Measurement:
    """Return the position of the reference point by a curve through the rim."""
    column, row = placed((curve.column, curve.row), p, guess)
    return Measurement(
        column=column,
        row=row,
        score=float(curve.used.mean()),
        spread_px=curve.spread_px,
    )


def _few(used: BoolArray) -> Failure:
    """Return the failure of a curve that too few points fit."""
    message = f"{used.mean():.0%} of the points fit, at least {_USED:.0%}"
    return Failure("few_points", message)


def _circle(
    image: FloatArray, p: Mapping[str, float], guess: Guess
) -> FittedCircle | Failure:
    """Return the circle through the rim."""
    found = approach(image, p, guess)
    if isinstance(found, Failure):
        return found
    points, circle = found
    return replace(circle, spread_px=points.spread_px(circle.spread_px))


def _ellipse(
    image: FloatArray, p: Mapping[str, float], guess: Guess
) -> FittedCircle | Failure:
    """Return the ellipse, from the circle's points."""
    found = approach(image, p, guess)
    if isinstance(found, Failure):
        return found
    points, circle = found
    return _trimmed(points, (circle.column, circle.row), circle.used)


def _trimmed(
    points: RimPoints, at: tuple[float, float], used: BoolArray
) -> FittedCircle | Failure:
    """Return the direct least-squares ellipse through all but stray points.

    References
    ----------
    Fitzgibbon, Pilu & Fisher (1999), as in OpenCV's `fitEllipseDirect`.
    """
    # single precision is kept for what is small: points about the circle's centre
    u, v = points.columns - at[0], points.rows - at[1]
    for _ in range(_ROUNDS):
        if used.sum() < max(6, _USED * len(u)):
            return _few(used)
        pairs = np.column_stack((u, v))[used].astype(np.float32)
        (x, y), axes, turn_deg = cv2.fitEllipseDirect(pairs)
        if not (min(axes) > 0 and math.isfinite(x + y + sum(axes) + turn_deg)):
            return Failure("no_edge", "the points make no ellipse")
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
    return FittedCircle(
        column=at[0] + x,
        row=at[1] + y,
        radius_px=math.sqrt(axes[0] * axes[1]) / 2,
        flat=max(axes) / min(axes),
        used=used,
        rms_px=rms,
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
