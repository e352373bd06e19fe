"""Pictures of one still scene in several lights, and the response that they tell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from microplan.optics.lens.response import Response, power_rows
from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    CalibrationCurve,
    CalibrationSeries,
    PictureSource,
    single,
)
from microplan.planner.calibration.count_levels import CountLevels, count_levels
from microplan.planner.calibration.estimates import BlockEstimate, Refused
from microplan.planner.calibration.light_scenes import LightScenes
from microplan.planner.calibration.noise_line import NoiseLine
from microplan.planner.calibration.photon_transfer import pooled_rows
from microplan.planner.calibration.picture_intake import CODE, PictureIntake
from microplan.planner.calibration.picture_series import (
    FEWEST_FRAMES,
    NoiseByLevel,
    doubts,
)
from microplan.planner.calibration.readings import PictureReadings, readings_of_pages
from microplan.planner.calibration.response.code_levels import black_level, code_use
from microplan.planner.calibration.response.light_levels import LightStep
from microplan.planner.calibration.response.response_fit import (
    ResponseFit,
    fit_response,
)
from microplan.planner.source.diagnostics import Span

_MOST_LIGHTS = 256  # 4 MiB each
_STRAIGHT = 3.0  # standard deviations of a power from 1
_LEVELS = 60  # of a drawn curve


def camera_response(
    readings: PictureReadings,
    intake: PictureIntake,
    stated: Mapping[str, float],
) -> CalibrationSeries | None:
    """Return what pictures in several lights tell of a camera, None if too little.

    Parameters
    ----------
    readings : PictureReadings
        With a light reading of each picture.
    intake : PictureIntake
        New; its report receives MP901, MP904 and MP905.
    stated : mapping
        Numbers of the workcell's camera, by key.
    """
    found, where = LightScenes(), Span(file=str(readings.file))
    for row, page in readings_of_pages(readings, intake):
        found.add(row.light, page.counts, intake)
        if len(found.scenes) > _MOST_LIGHTS:
            message = f"more than {_MOST_LIGHTS} different lights"
            hint = "ten to fifty tell as much; state a light's reading as it was set"
            intake.report.error(CODE, where, message, hint)
            return None
    if not found.scenes:
        intake.report.error(CODE, where, "no picture of the table can be used")
        return None
    codes = np.sum([scene.codes for scene in found.scenes.values()], axis=0)
    levels = count_levels(codes, found.top)
    if not intake.fits(levels.highest, where):
        return None
    fit = fit_response(found.steps, found.top, _white(levels, stated, intake, where))
    if isinstance(fit, Refused):
        message = f"no {fit.what}: {fit.why}"
        intake.report.error(CODE, where, message, f"photograph {fit.take}")
        return None
    doubts(levels, code_use(codes, intake.camera_bits), where, intake.report)
    noise = _noise(found, intake, fit.black.value)
    return _series(fit, found, noise, intake.source(), stated)


def _white(
    levels: CountLevels,
    stated: Mapping[str, float],
    intake: PictureIntake,
    where: Span,
) -> float | None:
    """Return the stated count of saturation, None if counts contradict it."""
    white, message = stated.get("white_level"), ""
    if white is None:
        return None
    if levels.white_level is None and levels.highest > white:
        message = f"counts reach {levels.highest}"
    elif levels.white_level is not None and levels.white_level != white:
        message = f"counts are saturated at {levels.white_level}"
    if not message:
        return white
    message += f", the workcell's white_level is {white:g}"
    hint = "mend camera.white_level in the workcell"
    intake.report.warning(CODE, where, message, hint)
    return None


def _series(
    fit: ResponseFit,
    found: LightScenes,
    noise: NoiseByLevel | None,
    source: PictureSource,
    stated: Mapping[str, float],
) -> CalibrationSeries:
    """Return a response as lines of a workcell, with the noise where it is told."""
    values = [_response(fit, source, stated)]
    values.append(_level("black_level", fit.black, source, stated))
    if fit.white_is_seen:
        method = "count at which pixels pile up"
        white = BlockEstimate(value=fit.white, sigma=None, method=method, blocks=1)
        values.append(_level("white_level", white, source, stated))
    curves = {"response": _curve(fit, found.steps)}
    if noise is not None:
        values += [*noise.series.values, *_full_well(noise, fit, stated)]
        curves |= noise.series.curves
    return CalibrationSeries(
        heading=f"response in {source.pictures} pictures of {fit.lights} lights",
        values=tuple(values),
        notes=(*_words(fit, found), *(noise.series.notes if noise else ())),
        curves=curves,
    )


def _level(
    key: str, found: BlockEstimate, source: PictureSource, stated: Mapping[str, float]
) -> CalibratedValue:
    """Return a level, counts, as a line of the workcell."""
    at, known = ("camera", key), stated.get(key)
    return single(key, found, source, unit="counts", where=at, stated=known)


def _full_well(
    noise: NoiseByLevel,
    fit: ResponseFit,
    stated: Mapping[str, float],
) -> Iterator[CalibratedValue]:
    """Yield the electrons of full scale, where noise and response are those of photons.

    Beside the table, which has all of the noise.
    """
    line, gamma = noise.line, fit.gamma
    straight = abs(gamma.value - 1) <= _STRAIGHT * (gamma.sigma or 0.0)
    if isinstance(line, NoiseLine) and line.suffices and straight:
        well = line.full_well_e(fit.black.value, fit.white)
        at = ("camera", "full_well_e")
        known, source = stated.get("full_well_e"), noise.source
        yield single("full_well_e", well, source, unit="e", where=at, stated=known)


def _response(
    fit: ResponseFit, source: PictureSource, stated: Mapping[str, float]
) -> CalibratedValue:
    """Return the power or the table of a response."""
    where = ("camera", "response")
    if fit.kind == "power":
        power = stated.get("response")
        return single("response", fit.gamma, source, where=where, stated=power)
    return CalibratedValue(
        key="response",
        value=fit.rows,
        sigma=fit.row_sigmas,
        unit="light, level",
        method=fit.gamma.method,
        source=source,
        where=where,
    )


def _noise(
    found: LightScenes, intake: PictureIntake, black_level: float
) -> NoiseByLevel | None:
    """Return the noise of lights with enough frames, None if there are none."""
    used = {k: s for k, s in found.scenes.items() if s.frames >= FEWEST_FRAMES}
    if not used:
        return None
    scenes = list(used.values())
    levels = count_levels(np.sum([scene.codes for scene in scenes], axis=0), found.top)
    rows = pooled_rows(scenes, levels)
    frames = sum(scene.frames for scene in scenes)
    if not rows:
        return None
    return NoiseByLevel(
        frames=frames,
        levels=levels,
        rows=rows,
        source=intake.source({n for light in used for n in found.numbers[light]}),
        black_level=black_level,
    )


def _words(fit: ResponseFit, found: LightScenes) -> list[str]:
    """Return how well a response predicts lights left out, and what darkness says."""
    words = [f"levels of a light left out: off by {fit.held_out_power:.3g} counts rms"]
    if fit.held_out_table is not None:
        words[0] += f" by the power, {fit.held_out_table:.3g} by a table"
    low, high = fit.seen
    words.append(f"seen from {low:.0%} to {high:.0%} of its range")
    dark = found.scenes.get(0.0)
    level = None if dark is None else black_level(dark)
    if isinstance(level, BlockEstimate):
        sigma = "" if level.sigma is None else f" +- {level.sigma:.2g}"
        words.append(f"frames without light: {level.value:.4g}{sigma} counts")
    elif level is not None:
        words.append(f"no {level.what}: {level.why}; photograph {level.take}")
    return words


def _curve(fit: ResponseFit, steps: Sequence[LightStep]) -> CalibrationCurve:
    """Return the median level by light, and the response through it."""
    most = max(step.light for step in steps)
    points = [(s.light / most, float(np.median(s.scene.mean))) for s in steps]
    rows = fit.rows or power_rows(fit.gamma.value)
    response = Response.from_levels(rows, fit.black.value, fit.white)
    lights, levels = np.array(points).T
    shares = response.share_of(levels)
    use = (lights > 0) & (levels < fit.white) & (shares > 0)
    factor = float(np.median(shares[use] / lights[use])) if use.any() else 1.0
    grid = np.linspace(0.0, 1.0, _LEVELS)
    drawn = response.counts_of(np.minimum(factor * grid, 1.0))
    line = list(zip(grid.tolist(), drawn.tolist(), strict=True))
    return CalibrationCurve(points=points, line=line)
