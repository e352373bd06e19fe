"""Focus steps of a point: aperture, zero, step and wavefront as workcell lines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from microplan.optics.lens.sensor import Sensor
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    CalibrationSeries,
    single,
)
from microplan.planner.calibration.estimates import Refused
from microplan.planner.calibration.geometry.part_finder import middle_pages
from microplan.planner.calibration.picture_intake import CODE, PictureIntake
from microplan.planner.calibration.readings import PictureReadings, readings_of_pages
from microplan.planner.calibration.through_focus.focus_series import StatedLens
from microplan.planner.calibration.through_focus.point_checks import (
    CLEAR,
    NEAR_PX,
    deviation,
    sharpest,
    why_coarse,
    why_unfit,
)
from microplan.planner.calibration.through_focus.point_picture import PointPicture
from microplan.planner.calibration.through_focus.wavefront_fit import (
    NOLLS,
    WavefrontFit,
    fit_wavefront,
)
from microplan.planner.calibration.through_focus.wavefront_values import (
    wavefront_values,
    wavefront_words,
)
from microplan.planner.measure.near import NearPlace
from microplan.planner.measure.part_task import (
    PartCall,
    magnification_of,
    point_radius_um,
)
from microplan.planner.measure.picture_light import light
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.schema import Checked
from microplan.planner.task.read_workcell import build_workcell, read_fingers
from microplan.planner.views.zooms import microscope_at

_SMALL = 0.5  # of wavelength over aperture, across: no lens shows its outline
_HALF_PX = 32  # about it that is fitted
_NOLLS = (*NOLLS, 22)  # a point shows the next order, too, where apertures are wide
_ROUNDS = 40  # from a lens without aberrations: they trade with zero and step
_HINT = (
    "photograph one bright bead, smaller than the resolution and alone in 64 x 64 px, "
    "not saturated, at nine focus readings or more on both sides of the sharpest"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PointPart:
    """A disc that no lens shows as one, and what takes pictures of it."""

    radius_um: float
    scope: Microscope
    sensor: Sensor
    near: NearPlace | None


def point_part(call: PartCall, cell: Checked) -> PointPart | None:
    """Return the point that a call's drawing is, None if it is none."""
    fingers = read_fingers(cell, Report())
    if set(fingers) != set(cell.source.mapping("tools")):
        return None
    station = build_workcell(cell, fingers)
    scope = microscope_at(station, magnification_of(station, call))
    most_um = _SMALL * scope.wavelength_um / scope.aperture
    radius_um = point_radius_um(call, most_um)
    if radius_um is None:
        return None
    sensor = station.camera.sensor
    return PointPart(radius_um=radius_um, scope=scope, sensor=sensor, near=call.near)


def point_focus(
    readings: PictureReadings,
    part: PointPart,
    intake: PictureIntake,
    stated: StatedLens,
) -> CalibrationSeries | None:
    """Return what focus steps of a point tell, None if too little.

    Parameters
    ----------
    readings : PictureReadings
        With focus readings of each picture.
    part : PointPart
        What they show.
    intake : PictureIntake
        New; its report receives MP901, MP904 and MP905.
    stated : StatedLens
        By the workcell.
    """
    report, where = intake.report, Span(file=str(readings.file))
    at = _place(readings, part)
    if at is None:
        message = "no picture in the middle of the readings has a bright point"
        message += f" within {NEAR_PX:g} px of the place" if part.near else ""
        report.error(CODE, where, message, _HINT)
        return None
    pictures = list(_pictures(readings, part, intake, at))
    if report.failed or not intake.fits(0, where):
        return None
    found = _fitted(pictures, part.scope, 1 / intake.top)
    if isinstance(found, WavefrontFit):
        return _series(found, intake, stated)
    why, hint = found
    report.error(CODE, where, f"no aperture and focus: {why}", hint)
    return None


def _fitted(
    pictures: list[PointPicture], scope: Microscope, count: float
) -> WavefrontFit | tuple[str, str]:
    """Return what pictures tell, or why they tell no lens and what to do."""
    unfit = why_unfit(pictures, count)
    if unfit:
        return unfit, _HINT
    coarse = why_coarse(scope, scope.aperture)
    if coarse:
        return coarse
    pictures.sort(key=lambda each: each.z_um)
    start = np.array([scope.aperture, sharpest(pictures).z_um, 1.0])
    found = fit_wavefront(pictures, start, _NOLLS, rounds=_ROUNDS)
    if isinstance(found, Refused):
        return found.why, _HINT
    return why_coarse(scope, float(found.numbers.values[0])) or found


def _place(readings: PictureReadings, part: PointPart) -> tuple[int, int] | None:
    """Return column and row of the brightest point in the middle pictures."""
    best: tuple[float, tuple[int, int]] | None = None
    for page in middle_pages(readings):
        counts = page.counts - float(np.median(page.counts))
        clear = CLEAR * deviation(counts, 1.0)
        row, column = np.indices(counts.shape)
        if part.near is not None:
            off = np.hypot(column - _near_px(part)[0], row - _near_px(part)[1])
            counts = np.where(off <= NEAR_PX, counts, 0.0)
        most = float(counts.max())
        if most > clear and (best is None or most > best[0]):
            down, right = np.unravel_index(int(np.argmax(counts)), counts.shape)
            best = most, (int(right), int(down))
    return None if best is None else best[1]


def _near_px(part: PointPart) -> tuple[float, float]:
    """Return column and row of where the point is said to be."""
    near, scope = part.near, part.scope
    if near is None or near.unit == "px":
        return (0.0, 0.0) if near is None else (near.x, near.y)
    column, row = (scope.width_px - 1) / 2, (scope.height_px - 1) / 2
    return column + near.x / scope.um_per_px, row - near.y / scope.um_per_px


def _pictures(
    readings: PictureReadings,
    part: PointPart,
    intake: PictureIntake,
    at: tuple[int, int],
) -> Iterator[PointPicture]:
    """Yield what surrounds the point in each picture; what is cut off is reported."""
    for row, page in readings_of_pages(readings, intake):
        down, right = (
            slice(max(middle - _HALF_PX, 0), middle + _HALF_PX) for middle in at[::-1]
        )
        counts = page.counts[down, right]
        if counts.max() >= intake.top:
            message = f"{page.name} is saturated where the point is"
            where = Span(file=str(page.path))
            intake.report.error(CODE, where, message, _HINT)
            return
        rows, columns = counts.shape
        yield PointPicture(
            z_um=row.z_um,
            scope=replace(part.scope, width_px=columns, height_px=rows),
            radius_um=part.radius_um,
            at_px=(float(at[0] - right.start - columns // 2),
                   float(at[1] - down.start - rows // 2)),
            shown=light(counts, intake.top, part.sensor),
            used=np.ones(counts.shape, dtype=np.bool_),
        )  # fmt: skip


def _series(
    fit: WavefrontFit, intake: PictureIntake, stated: StatedLens
) -> CalibrationSeries:
    """Return aperture, zero, step and wavefront with what was stated of them."""
    source, found = intake.source(), fit.numbers
    at = ("optics", "numerical_aperture") if stated.aperture is not None else None
    known = stated.aperture
    values: list[CalibratedValue] = [
        single("numerical_aperture", found.one(0), source, where=at, stated=known),
        single("focus_zero_um", found.one(1), source, unit="um"),
        single("focus_scale", found.one(2), source),
        *wavefront_values(fit, source, has_rms=stated.has_rms),
    ]
    return CalibrationSeries(
        heading=f"focus in {source.pictures} pictures of a point",
        values=tuple(values),
        notes=tuple(wavefront_words(fit, has_rms=stated.has_rms)),
    )
