"""Circle through the iso-line at the level that the render predicts for its rim.

Good out of focus, where calipers need long lines, and under light that has a gradient:
the level is a plane between both sides of the rim. What is near the rim and blurred
into one of its sides pulls it. So does its own blur, where that is much wider than the
planned one and reaches the sides: the centre then stays near the guess, does not
settle, and is refused. `benchmarks/localisation` has the numbers.
"""

from __future__ import annotations

from collections.abc import Mapping

from microplan.arrays import FloatArray
from microplan.featuresel.routines.circle.circle_fit import FittedCircle
from microplan.featuresel.routines.circle.rim import CAPTURE_PX as _AWAY_PX
from microplan.featuresel.routines.circle.rim import approach, approach_work
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

NAME = "iso_circle"
VERSION = "2"
KINDS: tuple[TargetKind, ...] = ("circle", "teeth")
PROVIDES: tuple[PoseTerm, ...] = ("xy",)
REQUIRES: tuple[PoseTerm, ...] = ("xy",)
CAPTURE_PX = _AWAY_PX
BASELINE = False
EXPENSIVE = False

_RADIUS_OFF = 0.1  # of the radius, at least 1 px: as far as blur and zoom may move it
_USED = 0.5  # of the points must fit the circle


def prepare(render: Render, target: Target) -> Artifact | Failure:
    """Return radius, level and filter, and where the notch pulls the centre."""
    return prepare_rim(render, target, _centre)


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the circle's centre; fails if it is faint, cut off or of another size."""
    p = artifact.parameters
    fitted = _fit(image, p, guess)
    if isinstance(fitted, Failure):
        return fitted
    circle, spread_px = fitted
    off = abs(circle.radius_px - p["seen_px"])
    if off > max(1.0, _RADIUS_OFF * p["radius_px"]):
        return Failure(
            code="radius_off",
            message=f"radius {circle.radius_px:.2f} px, predicted {p['seen_px']:.2f}",
        )
    if circle.used.mean() < _USED:
        return Failure(
            code="few_points",
            message=f"{circle.used.mean():.0%} of the points fit, at least {_USED:.0%}",
        )
    column, row = placed((circle.column, circle.row), p, guess)
    return Measurement(
        column=column,
        row=row,
        theta_rad=None,
        score=float(circle.used.mean()),
        spread_px=spread_px,
    )


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    return approach_work(artifact.parameters)


def _centre(
    image: FloatArray, p: Mapping[str, float], guess: Guess
) -> tuple[float, float, float] | Failure:
    """Return column, row and radius of the circle."""
    fitted = _fit(image, p, guess)
    if isinstance(fitted, Failure):
        return fitted
    circle, _ = fitted
    return circle.column, circle.row, circle.radius_px


def _fit(
    image: FloatArray, p: Mapping[str, float], guess: Guess
) -> tuple[FittedCircle, float] | Failure:
    """Return the circle and the spread of its centre."""
    found = approach(image, p, guess)
    if isinstance(found, Failure):
        return found
    points, circle = found
    return circle, points.spread_px(circle.spread_px)
