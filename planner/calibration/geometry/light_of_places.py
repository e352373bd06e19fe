"""Gradient and faces' ratio of light as values of a series, or why it tells none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from microplan.optics.coherence.degree import Coherence
from microplan.planner.calibration.calibrated_value import (
    CalibrationSeries,
    PictureSource,
    single,
)
from microplan.planner.calibration.estimates import BlockEstimate, Refused
from microplan.planner.calibration.geometry.coherence_words import coherence_words
from microplan.planner.calibration.geometry.face_ratio import ABSOLUTE, face_ratios
from microplan.planner.calibration.geometry.light_field import (
    gradient_values,
    light_gradient,
)
from microplan.planner.calibration.geometry.part_places import PartPlaces, gains_of
from microplan.planner.calibration.picture_intake import CODE
from microplan.planner.source.diagnostics import Span


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedLight:
    """What a workcell states of light."""

    gradient: float | None
    has_black: bool  # the camera's counts without light
    coherence: Coherence | None  # None: incoherent


def with_light(
    series: CalibrationSeries | None,
    places: PartPlaces,
    where: Span,
    stated: StatedLight,
) -> CalibrationSeries | None:
    """Return a series with the light's gradient and the faces' ratio, None for none.

    Parameters
    ----------
    series : CalibrationSeries, optional
        What the same pictures tell besides.
    places : PartPlaces
        Of these pictures; its report receives MP904 if they tell no gradient.
    where : Span
        Of the series, for findings.
    stated : StatedLight
        By the workcell.
    """
    if series is None:
        return None
    gains, case = gains_of(places.found), places.finder.first.region.case
    source = places.intake.source()
    series = _with_ratios(
        series, face_ratios(gains, case, has_black=stated.has_black), source
    )
    offset = next((v for v in series.values if v.key == "edge_offset_um"), None)
    faces = case.moving[0].reflectance, case.background
    words = coherence_words(offset, faces, case.microscope, stated.coherence)
    series = replace(series, notes=(*series.notes, *words))
    found = light_gradient(gains)
    if isinstance(found, Refused):
        message = f"no {found.what}: {found.why}"
        places.intake.report.warning(CODE, where, message, f"photograph {found.take}")
        return series
    values = tuple(gradient_values(found, source, stated.gradient))
    return replace(series, values=series.values + values)


def _with_ratios(
    series: CalibrationSeries,
    ratios: Mapping[str, BlockEstimate | Refused],
    source: PictureSource,
) -> CalibrationSeries:
    """Return a series with reflectances over the part's, or why there are none."""
    values, notes = [], []
    for name, ratio in ratios.items():
        if isinstance(ratio, Refused):
            why = f"no {ratio.what}: {ratio.why}; photograph {ratio.take}"
            notes.append(why)
        else:
            values.append(single(f"reflectance_{name}_over_part", ratio, source))
    said = (*notes, ABSOLUTE) if values else tuple(notes)
    return replace(
        series, values=(*series.values, *values), notes=(*series.notes, *said)
    )
