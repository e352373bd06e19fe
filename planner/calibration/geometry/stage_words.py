"""A stage's ruler and axes in words, and what its stops are off by."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from microplan.planner.calibration.calibrated_value import CalibrationCurve
from microplan.planner.calibration.geometry.affine_scale import axes_of, stretch_of
from microplan.planner.calibration.geometry.part_places import PartPlace
from microplan.planner.calibration.geometry.stage_fit import StageFit
from microplan.planner.calibration.geometry.stage_stop import StageStop


def stage_words(fit: StageFit, places: Sequence[PartPlace]) -> Iterator[str]:
    """Yield ruler and axes in words."""
    stretch = stretch_of(fit.matrix())
    if fit.ruler:
        yield "the ruler is the drawing: the part has edges of several features"
        yield from _agreement(fit)
        drawn = [fit.one(f"drawn_{name}") for name in ("pitch_x", "pitch_y", "skew")]
        x, y, skew = (each.value for each in drawn if each is not None)
        slant = skew * (1 / x + 1 / y) / 4
        stretch = np.array([[1 / x, slant], [slant, 1 / y]])
    elif 2 * sum(place.drawn is None for place in places) < len(places):
        yield (
            "the ruler is the stage: one outline without others inside or beside it "
            "does not tell the drawing's scale apart from an offset of its edges"
        )
    else:
        yield "the ruler is the stage: most pictures show too few of the part's edges"
    (a, b), (c, d) = axes_of(fit.matrix(), stretch).tolist()
    yield f"station: camera_from_stage = [[{a:.6f}, {b:.6f}], [{c:.6f}, {d:.6f}]]"


def _agreement(fit: StageFit) -> Iterator[str]:
    """Yield how drawing and stage agree, in standard deviations."""
    for name in ("scale_x", "scale_y"):
        found = fit.one(name)
        if found is not None and found.sigma:
            off, pull = found.value - 1, abs(found.value - 1) / found.sigma
            words = f"stage against drawing, {name[-1]}: {off:+.2g}"
            yield f"{words}, {pull:.2g} standard deviations"


def stage_residuals(
    fit: StageFit, stops: Sequence[StageStop]
) -> dict[str, CalibrationCurve]:
    """Return each stop's misfit, 1/1000 px to the right and up, over its reading."""
    readings = {"x": [s.x_um for s in stops], "y": [s.y_um for s in stops]}
    found = {}
    for (axis, um), off in zip(readings.items(), 1000 * fit.misfits_px.T, strict=True):
        points = list(zip(um, off.tolist(), strict=True))
        found[f"residuals {axis}"] = CalibrationCurve(points=points)
    return found
