"""A measurement in pixels to the target's place in the world."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Failure, Measurement


@dataclass(frozen=True, slots=True, kw_only=True)
class Located:
    """The target's reference point in the world, as one measurement has it."""

    x_um: float
    y_um: float
    theta_rad: float | None  # of the look's frame; None: not measured
    axis_rad: float | None  # the one direction in which the place is known, world


def located(case: LookCase, found: Measurement) -> Located | Failure:
    """Return where a measurement has the target's reference point.

    The angle is that of the frame that `LookCase.theta_rad` is of: the target's own may
    be turned against it, by as much as nominally. An answer with a number that is not
    finite is a failure, be it only a spread or the score: gates compare those, and a
    nan passes or fails them by chance.
    """
    endless = _not_finite(found)
    if endless:
        return Failure(code="not_finite", message=f"not finite: {', '.join(endless)}")
    turned_rad = case.target.theta_rad - case.theta_rad
    theta = None if found.theta_rad is None else found.theta_rad - turned_rad
    x, y = case.frame.to_world(found.column, found.row)
    return Located(x_um=x, y_um=y, theta_rad=theta, axis_rad=found.axis_rad)


def _not_finite(found: Measurement) -> list[str]:
    """Return the names of an answer's numbers that are nan or infinite."""
    numbers = {field.name: getattr(found, field.name) for field in fields(found)}
    return [
        name
        for name, number in numbers.items()
        if number is not None and not math.isfinite(number)
    ]


def along(error_um: tuple[float, float], axis_rad: float | None) -> tuple[float, float]:
    """Return an error, or the part of it along the direction that is known."""
    if axis_rad is None:
        return error_um
    c, s = math.cos(axis_rad), math.sin(axis_rad)
    length = c * error_um[0] + s * error_um[1]
    return (length * c, length * s)
