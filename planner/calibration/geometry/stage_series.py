"""Stage moves of a known part: pitch, skew, distortion and axes as workcell lines."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from microplan.optics.transfer.microscope import Microscope
from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    CalibrationSeries,
    PictureSource,
    single,
)
from microplan.planner.calibration.estimates import BlockEstimate, Refused
from microplan.planner.calibration.geometry.part_places import (
    PartPlaces,
    stops_of,
)
from microplan.planner.calibration.geometry.stage_fit import StageFit, fit_stage
from microplan.planner.calibration.geometry.stage_stop import StageStop
from microplan.planner.calibration.geometry.stage_words import (
    stage_residuals,
    stage_words,
)
from microplan.planner.calibration.picture_intake import CODE
from microplan.planner.calibration.readings import PictureReadings
from microplan.planner.source.diagnostics import Span

_REST = "scatter of pictures while the stage rests"
_SIGNIFICANT = 3.0  # standard deviations


def stage_axes(
    readings: PictureReadings, places: PartPlaces, stated_distortion: float | None
) -> CalibrationSeries | None:
    """Return what stage moves of a part tell, None if too little.

    Parameters
    ----------
    readings : PictureReadings
        With stage readings of each picture.
    places : PartPlaces
        New; its report receives MP901, MP904 and MP905.
    stated_distortion : float, optional
        The workcell's.
    """
    report, where = places.intake.report, Span(file=str(readings.file))
    places.read(readings)
    if report.failed or not places.intake.fits(0, where):
        return None
    if 2 * len(places.found) < places.intake.taken:
        message = (
            f"the part is in {len(places.found)} of {places.intake.taken} pictures"
        )
        hint = "is it the part of --part, in focus and whole in each picture?"
        report.error(CODE, where, message, hint)
        return None
    stops = stops_of(places.found)
    fit = fit_stage(stops, places.corner_px)
    if isinstance(fit, Refused):
        message = f"no {fit.what}: {fit.why}"
        report.error(CODE, where, message, f"photograph {fit.take}")
        return None
    scope = places.finder.series.look.case.microscope
    source = places.intake.source()
    values = [*_pitches(fit, scope, source, stated_distortion), *_stage(fit, source)]
    _doubts(fit, stops, values, places, where)
    return CalibrationSeries(
        heading=f"scale in {source.pictures} pictures at {len(stops)} stage positions",
        values=tuple(values),
        notes=tuple(stage_words(fit, places.found)),
        curves=stage_residuals(fit, stops),
    )


def _pitches(
    fit: StageFit, scope: Microscope, source: PictureSource, distortion: float | None
) -> Iterator[CalibratedValue]:
    """Yield pitches in the object, the sensor's, and what bends the image."""
    ruler = fit.ruler
    units = {"pitch_x": "um", "pitch_y": "um", "skew": "rad"}
    method = "edges against the drawing" if ruler else "stage readings"
    pair = []
    for name, unit in units.items():
        found = fit.one(ruler + name)
        if found is None:
            continue
        value = single(f"{name}_{unit}", found, source, unit=unit)
        pair.append(found)
        yield _by(value, method)
    yield _sensor(pair[0], pair[1], scope, source, method)
    if ruler:
        for name, unit in units.items():
            found = fit.one(name)
            if found is not None:
                key = f"{name}_by_stage_{unit}"
                yield _by(single(key, found, source, unit=unit), "stage readings")
    if (bent := fit.one("distortion")) is not None:
        at = ("optics", "distortion")
        kept = single("distortion", bent, source, where=at, stated=distortion)
        yield _by(kept, "kept, as stops left out are foretold better")
    if (offset := fit.one("offset_px")) is not None:
        words = "edges seen, outwards from those drawn"
        scaled = _scaled(offset, scope.um_per_px, words)
        yield single("edge_offset_um", scaled, source, unit="um")


def _scaled(found: BlockEstimate, factor: float, method: str) -> BlockEstimate:
    """Return an estimate in another unit."""
    return BlockEstimate(
        value=found.value * factor,
        sigma=None if found.sigma is None else found.sigma * factor,
        method=method,
        blocks=found.blocks,
    )


def _by(value: CalibratedValue, method: str) -> CalibratedValue:
    """Return a value with what measured it in front of its method."""
    return replace(value, method=f"{method}; {value.method}")


def _sensor(
    x: BlockEstimate,
    y: BlockEstimate,
    scope: Microscope,
    source: PictureSource,
    method: str,
) -> CalibratedValue:
    """Return the sensor's size: square pixels at the stated magnification."""
    pitch = math.sqrt(x.value * y.value) * scope.magnification
    sigma = None
    if x.sigma is not None and y.sigma is not None:
        sigma = pitch / 2 * math.hypot(x.sigma / x.value, y.sigma / y.value)
    width, height = (pitch * count for count in (scope.width_px, scope.height_px))
    return CalibratedValue(
        key="sensor_um",
        value=pitch,
        sigma=(sigma,),
        unit="um a pixel",
        method=f"{method}; at a magnification of {scope.magnification:g}",
        source=source,
        where=("camera", "sensor_um"),
        text=f"[{width:.10g}, {height:.10g}]",
        stated=scope.pitch_um,
    )


def _stage(fit: StageFit, source: PictureSource) -> Iterator[CalibratedValue]:
    """Yield the stage's scales by the drawing, and its noise."""
    for name, key, unit in (
        ("scale_x", "stage_scale_x", "1"), ("scale_y", "stage_scale_y", "1"),
        ("stage_skew", "stage_skew_rad", "rad"),
    ):  # fmt: skip
        found = fit.one(name)
        if found is not None:
            value = single(key, found, source, unit=unit)
            yield _by(value, "readings against the drawing")
    pitch = [fit.one(fit.ruler + name) for name in ("pitch_x", "pitch_y")]
    for axis, noise, um in zip("xy", fit.residual_px, pitch, strict=True):
        if um is not None:
            scaled = _scaled(noise, um.value, noise.method)
            yield single(f"stage_noise_{axis}_um", scaled, source, unit="um")
    for axis, shake_px, um in zip("xy", fit.shake_px or (), pitch, strict=False):
        if um is not None:
            shake = BlockEstimate(
                value=shake_px * um.value, sigma=None, method=_REST, blocks=1
            )
            yield single(f"vibration_{axis}_um", shake, source, unit="um")


def _doubts(
    fit: StageFit,
    stops: Sequence[StageStop],
    values: Sequence[CalibratedValue],
    places: PartPlaces,
    where: Span,
) -> None:
    """Report what the workcell has no line for, and stops far off."""
    report, by_key = places.intake.report, {value.key: value for value in values}
    if fit.ruler:
        _faint(places)
    for k in fit.off:
        message = f"the stop at {stops[k].x_um:g}, {stops[k].y_um:g} um lies far off "
        message += "the others"
        hint = "was the part moved, or the stage still on its way?"
        report.warning(CODE, where, message, hint)
    x, y = by_key["pitch_x_um"], by_key["pitch_y_um"]
    sigma = math.hypot(x.sigma[0] or math.inf, y.sigma[0] or math.inf)
    wide, high = (v.value for v in (x, y) if isinstance(v.value, float))
    if abs(wide - high) > _SIGNIFICANT * sigma:
        message = f"pixels are {wide:.6g} um wide and {high:.6g} high; a workcell has "
        message += "square ones: their mean is taken"
        report.warning(CODE, where, message, "resample the pictures to square ones")


def _faint(places: PartPlaces) -> None:
    """Report pictures that tell a place, and no scale as others do."""
    names = [p.reading.name for p in places.found if not p.tells_scale]
    if names:
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        message = (
            f"{names[0]}{more}: too few edges tell the drawing's scale; the other "
        )
        message += "pictures do"
        where = Span(file=str(places.finder.first.path.parent / names[0]))
        places.intake.report.warning(
            CODE, where, message, "is it sharp there, and whole?"
        )
