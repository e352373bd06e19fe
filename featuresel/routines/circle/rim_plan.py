"""What a round rim looks like on the render: level, filter, and pull on the centre."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.circle.circle_fit import FittedCircle
from microplan.featuresel.routines.circle.rim import (
    FAINT,
    FEWEST,
    STEP_PX,
    THICK,
    rings,
)
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Target,
)
from microplan.featuresel.routines.sampling import best_width

_SPAN_PX = 20.0  # of the profile from which the filter is chosen, to both sides
_SIDE_RAD = math.radians(30)  # a bias fixed to the part is undone below this doubt
_OFF_CENTRE_PX = 0.5  # what stays of it where the angle is unknown
_PLACES_PX = (
    (0.0, 0.0),
    (0.5, 0.25),
    (0.25, 0.75),
    (0.75, 0.5),
)  # none repeats a phase


Fit = Callable[[FloatArray, Mapping[str, float], Guess], FittedCircle | Failure]


def rim_radius_um(target: Target) -> float:
    """Return the radius looked for: of toothed parts the bore, else the root."""
    if target.kind == "circle":
        return target.parameters["radius_um"]
    return target.parameters.get("bore_um", target.parameters["root_um"])


def rim_numbers(render: LookModel, target: Target) -> dict[str, float] | Failure:
    """Return radius, filter, and the level between both sides that the rim has.

    The level is what the render has at the drawn radius, as a share of the step from
    `gap_px` inside to `gap_px` outside, so that the light's level does not matter.
    """
    radius = rim_radius_um(target) * target.px_per_um
    if radius < 4:
        return Failure("too_small", f"radius of {radius:.2f} px, at least 4")
    profile = _profile(render(), target, radius)
    if profile is None:
        return Failure("outside", "less than half the rim is in view")
    width = best_width(profile)
    middle = len(profile) // 2
    gap = min(int(1.5 * width / STEP_PX) + 2, middle - THICK)
    inner = float(profile[middle - gap - THICK : middle - gap + 1].mean())
    outer = float(profile[middle + gap : middle + gap + THICK + 1].mean())
    if abs(outer - inner) < FAINT:
        return Failure(
            "no_edge",
            f"predicted step of {outer - inner:.3f} at {radius:.1f} px, "
            f"at least {FAINT}",
        )
    share = (float(profile[middle]) - inner) / (outer - inner)
    slope = float(profile[middle + 1] - profile[middle - 1]) / (2 * STEP_PX)
    if not slope * (outer - inner) > 0:
        return Failure("no_edge", "the rim is no slope from side to side")
    return {
        "radius_px": radius,
        "step": outer - inner,
        "slope_per_px": slope / (outer - inner),
        "gap_px": gap * STEP_PX,
        "level": float(np.clip(share, 0.2, 0.8)),  # a level near an end drowns in noise
        "smooth_px": 0.75 * width,
    }


def prepare_rim(render: LookModel, target: Target, fit: Fit) -> Artifact | Failure:
    """Return radius, level and filter, and where the part's shape pulls the fit.

    Parameters
    ----------
    render : LookModel
        The look.
    target : Target
        What is to be found.
    fit : callable
        Returns the curve through an image's rim, from the numbers of `rim_numbers` and
        a guess.
    """
    numbers = rim_numbers(render, target)
    if isinstance(numbers, Failure):
        return numbers
    offset = _part_offset(render, target, numbers, fit)
    if isinstance(offset, Failure):
        return offset
    return Artifact(parameters={**numbers, **offset})


def _part_offset(
    render: LookModel, target: Target, numbers: Mapping[str, float], fit: Fit
) -> dict[str, float] | Failure:
    """Return how far the fit's centre is off the reference point, and its radius.

    The mean over some sub-pixel positions, so that it holds what the part's shape does
    and not what one position on the pixels does.
    """
    um_per_px, found = 1 / target.px_per_um, []
    for dx, dy in _PLACES_PX:
        image = render(dx_um=dx * um_per_px, dy_um=dy * um_per_px)
        at = Guess(column=target.column + dx, row=target.row - dy)
        fitted = fit(image, numbers, at)
        if isinstance(fitted, Failure):
            return fitted
        off = (fitted.column - at.column, fitted.row - at.row)
        found.append((*off, fitted.radius_px))
    dx, dy, radius = np.mean(found, axis=0).tolist()
    turns = target.theta_range_rad > _SIDE_RAD
    if turns and math.hypot(dx, dy) > _OFF_CENTRE_PX:
        return Failure(
            "off_centre",
            f"the centre is {math.hypot(dx, dy):.2f} px off the reference "
            "point, in a direction that turns with the part",
        )
    c, s = math.cos(target.theta_rad), math.sin(target.theta_rad)
    return {
        "seen_px": radius,
        "offset_x_px": c * dx - s * dy,  # in the part's frame, y up
        "offset_y_px": -s * dx - c * dy,
    }


def placed(
    centre: tuple[float, float], p: Mapping[str, float], guess: Guess
) -> tuple[float, float]:
    """Return the reference point; where the angle is unknown, the centre itself."""
    if guess.theta_rad is None:
        return centre
    c, s = math.cos(guess.theta_rad), math.sin(guess.theta_rad)
    x, y = p["offset_x_px"], p["offset_y_px"]
    return centre[0] - (c * x - s * y), centre[1] + (s * x + c * y)


def _profile(image: FloatArray, target: Target, radius_px: float) -> FloatArray | None:
    """Return the median radial profile about the rim; None if too little is in view."""
    span = max(3.0, min(0.6 * radius_px, _SPAN_PX))
    count = int(span / STEP_PX)
    radii = radius_px + STEP_PX * np.arange(-count, count + 1, dtype=np.float64)
    values, inside = rings(image, (target.column, target.row), radii)
    whole = inside.all(axis=0)
    if whole.mean() < FEWEST:
        return None
    profile: FloatArray = np.median(values[:, whole], axis=1)
    return profile
