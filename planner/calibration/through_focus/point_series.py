"""Focus steps of a point: aperture, zero, step and wavefront as workcell lines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.lens.sensor import Sensor
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    CalibrationSeries,
    single,
)
from microplan.planner.calibration.estimates import FEWEST_BLOCKS, Refused
from microplan.planner.calibration.geometry.part_finder import middle_pages
from microplan.planner.calibration.picture_intake import CODE, PictureIntake
from microplan.planner.calibration.readings import PictureReadings, readings_of_pages
from microplan.planner.calibration.through_focus.focus_fit import FEWEST_ASIDE
from microplan.planner.calibration.through_focus.focus_series import StatedLens
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
_HALF_PX, _LEAST_PX = 32, 12  # about it that is fitted, and that must be in the picture
_NEAR_PX = 8.0  # from where it is said to be
_CLEAR = 10.0  # deviations of the picture by which a point is the brightest
_NOLLS = (*NOLLS, 22)  # a point shows the next order, too, where apertures are wide
_ROUNDS = 40  # from a lens without aberrations: they trade with zero and step
_TAKE = (
    "one bright bead, smaller than the resolution and alone within 30 px, not "
    "saturated, at nine focus readings or more on both sides of the sharpest"
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
        report.error(CODE, where, message, f"photograph {_TAKE}")
        return None
    pictures = list(_pictures(readings, part, intake, at))
    if report.failed or not intake.fits(0, where):
        return None
    why = _unfit(pictures)
    if why:
        report.error(
            CODE, where, f"no aperture and focus: {why}", f"photograph {_TAKE}"
        )
        return None
    pictures.sort(key=lambda each: each.z_um)
    start = np.array([part.scope.aperture, _sharpest_um(pictures), 1.0])
    found = fit_wavefront(pictures, start, _NOLLS, rounds=_ROUNDS)
    if isinstance(found, Refused):
        message = f"no {found.what}: {found.why}"
        report.error(CODE, where, message, f"photograph {_TAKE}")
        return None
    return _series(found, intake, stated)


def _place(readings: PictureReadings, part: PointPart) -> tuple[int, int] | None:
    """Return column and row of the brightest point in the middle pictures."""
    best: tuple[float, tuple[int, int]] | None = None
    for page in middle_pages(readings):
        counts = page.counts - float(np.median(page.counts))
        row, column = np.indices(counts.shape)
        if part.near is not None:
            off = np.hypot(column - _near_px(part)[0], row - _near_px(part)[1])
            counts = np.where(off <= _NEAR_PX, counts, 0.0)
        most = float(counts.max())
        if most > _CLEAR * float(np.median(np.abs(counts))) and (
            best is None or most > best[0]
        ):
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
            intake.report.error(CODE, where, message, f"photograph {_TAKE}")
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


def _peak(picture: PointPicture) -> float:
    """Return the light of the brightest pixel over the usual one."""
    shown: FloatArray = picture.shown
    return float(shown.max() - np.median(shown))


def _sharpest_um(pictures: list[PointPicture]) -> float:
    """Return the reading of the picture with the brightest point."""
    return max(pictures, key=_peak).z_um


def _unfit(pictures: list[PointPicture]) -> str:
    """Return why pictures tell no lens, "" if they may."""
    readings = {each.z_um for each in pictures}
    if len(readings) < FEWEST_BLOCKS:
        return f"{len(readings)} focus readings, {FEWEST_BLOCKS} are needed"
    if min(pictures[0].shown.shape) < 2 * _LEAST_PX:
        return f"the point is nearer to the border than {_LEAST_PX} px"
    best = _sharpest_um(pictures)
    sides = sum(z < best for z in readings), sum(z > best for z in readings)
    if min(sides) < FEWEST_ASIDE:
        return f"{sides[0]} readings below the sharpest, {sides[1]} above it"
    return ""


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
