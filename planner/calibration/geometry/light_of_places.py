"""The light's gradient as values of a series of places, or why they do not tell it."""

from __future__ import annotations

from dataclasses import replace

from microplan.planner.calibration.calibrated_value import CalibrationSeries
from microplan.planner.calibration.estimates import Refused
from microplan.planner.calibration.geometry.light_field import (
    gradient_values,
    light_gradient,
)
from microplan.planner.calibration.geometry.part_places import PartPlaces, gains_of
from microplan.planner.calibration.picture_intake import CODE
from microplan.planner.source.diagnostics import Span


def with_light_gradient(
    series: CalibrationSeries | None,
    places: PartPlaces,
    where: Span,
    stated: float | None,
) -> CalibrationSeries | None:
    """Return a series with the gradient of its light, None if there is none.

    Parameters
    ----------
    series : CalibrationSeries, optional
        What the same pictures tell besides.
    places : PartPlaces
        Of these pictures; its report receives MP904 if they tell no gradient.
    where : Span
        Of the series, for findings.
    stated : float, optional
        By the workcell.
    """
    if series is None:
        return None
    found = light_gradient(gains_of(places.found))
    if isinstance(found, Refused):
        message = f"no {found.what}: {found.why}"
        places.intake.report.warning(CODE, where, message, f"photograph {found.take}")
        return series
    values = tuple(gradient_values(found, places.intake.source(), stated))
    return replace(series, values=series.values + values)
