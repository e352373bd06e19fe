"""Pictures of an even field as workcell lines of the light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.lens.response import Response
from microplan.planner.calibration.calibrated_value import CalibrationSeries, single
from microplan.planner.calibration.estimates import Refused
from microplan.planner.calibration.even_field.field_light import (
    TAKE,
    WHAT,
    FieldLight,
    field_light,
)
from microplan.planner.calibration.even_field.field_pictures import (
    FieldPictures,
    rounding_sigma,
)
from microplan.planner.calibration.geometry.light_field import gradient_values
from microplan.planner.calibration.picture_intake import CODE, PictureIntake
from microplan.planner.calibration.readings import PictureReadings, readings_of_pages
from microplan.planner.measure.picture_files import PictureCounts
from microplan.planner.source.diagnostics import Span

_CUT = 0.001  # share of counts at full scale that a few odd pixels have
_ALL_OF_IT = "photograph with all of the camera, or mend camera.pixels in the workcell"


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldCell:
    """What a workcell states of camera and light."""

    response: Response | None  # None: straight, from 0 to full scale
    lacks: str  # what makes light of counts and is not stated, in words; "": nothing
    white: float | None  # count of saturation; None: full scale
    gradient: float | None
    size_px: tuple[int, int]  # (rows, columns) of the camera


def even_field(
    readings: PictureReadings, intake: PictureIntake, stated: FieldCell
) -> CalibrationSeries | None:
    """Return what pictures of an even field tell of the light, None if nothing.

    Parameters
    ----------
    readings : PictureReadings
        Of the kind "field".
    intake : PictureIntake
        New; its report receives MP901, MP904 and MP905.
    stated : FieldCell
        By the workcell.
    """
    where, report = Span(file=str(readings.file)), intake.report
    if stated.lacks:
        message = f"no {WHAT}: the workcell states {stated.lacks}: counts that are not "
        message += "proportional to light look like another gradient"
        hint = "photograph one scene in several lights first"
        report.error(CODE, where, message, hint)
        return None
    pictures = _added(readings, intake, stated)
    if pictures is None or pictures.mean is None:
        return None
    found = field_light(pictures.mean, rounding=pictures.rounding)
    if isinstance(found, Refused):
        message = f"no {found.what}: {found.why}"
        report.error(CODE, where, message, f"photograph {found.take}")
        return None
    return _series(found, intake, stated.gradient)


def _added(
    readings: PictureReadings, intake: PictureIntake, stated: FieldCell
) -> FieldPictures | None:
    """Return the light of all pictures, None if in doubt."""
    pictures = FieldPictures()
    highest, where = 0.0, Span(file=str(readings.file))
    for _, page in readings_of_pages(readings, intake):
        at = Span(file=str(page.path))
        if page.counts.shape != stated.size_px:
            message = _other_size(page, stated.size_px)
            intake.report.error(CODE, at, message, _ALL_OF_IT)
            return None
        white = float(intake.top) if stated.white is None else stated.white
        cut = float(np.mean(page.counts >= white))
        if cut > _CUT:
            message = f"{page.name} is saturated: {cut:.1%} of it counts {white:g}"
            intake.report.error(CODE, at, message, f"expose less: photograph {TAKE}")
        highest = max(highest, float(page.counts.max()))
        light = _light(page.counts, intake.top, stated.response)
        off = pictures.add(light, _rounding(page.counts, intake.top, stated.response))
        if off and not intake.report.failed:
            message = f"{page.name} contradicts the first picture: {off}"
            intake.report.error(CODE, at, message, f"photograph {TAKE}, in one light")
    if not pictures.taken and not intake.report.failed:
        intake.report.error(CODE, where, "no picture of the table can be used")
    if intake.report.failed or not intake.fits(highest, where):
        return None
    return pictures


def _other_size(page: PictureCounts, size_px: tuple[int, int]) -> str:
    """Return in words that a picture has another size than (rows, columns)."""
    (rows, columns), (high, wide) = page.counts.shape, size_px
    words = f"{page.name} is {columns} x {rows} px"
    return f"{words}, the workcell's camera has {wide} x {high}"


def _light(counts: FloatArray, top: int, response: Response | None) -> FloatArray:
    """Return light, 1 at full scale, of counts (rows, columns)."""
    return counts / top if response is None else response.share_of(counts)


def _rounding(counts: FloatArray, top: int, response: Response | None) -> float:
    """Return what rounding does to the mean of counts (rows, columns), over light."""
    middle = np.median(counts) + np.array([-0.5, 0.0, 0.5])
    below, level, above = _light(middle, top, response).tolist()
    return rounding_sigma(counts) * (above - below) / level if level > 0 else 0.0


def _series(
    found: FieldLight, intake: PictureIntake, stated: float | None
) -> CalibrationSeries:
    """Return gradient and departure as values."""
    source = intake.source()
    rest = single("light_departure_rms", found.departure, source)
    x, y = found.hidden.tolist()
    notes = [f"edges out of focus that noise hides may move it by {x:.2g}, {y:.2g}"]
    if found.dust:
        words = f"dust and what is around it, left out: {found.dust:.1%} of the field"
        notes.append(words)
    values = gradient_values(found.gradient, source, stated, found.hidden)
    return CalibrationSeries(
        heading=f"light in {source.pictures} pictures of an even field",
        values=(*values, rest),
        notes=tuple(notes),
    )
