"""Focus steps of a known part: aperture, zero and step as workcell lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    CalibrationCurve,
    CalibrationSeries,
    PictureSource,
    single,
)
from microplan.planner.calibration.estimates import FEWEST_BLOCKS, Refused
from microplan.planner.calibration.geometry.part_finder import PartFinder
from microplan.planner.calibration.picture_intake import CODE, PictureIntake
from microplan.planner.calibration.readings import PictureReadings, readings_of_pages
from microplan.planner.calibration.through_focus.edge_picture import (
    EdgePicture,
    edge_picture,
)
from microplan.planner.calibration.through_focus.edge_profile import (
    EdgePoints,
    across_px,
    mean_profile,
    points_seen,
)
from microplan.planner.calibration.through_focus.focus_fit import (
    FocusFit,
    fit_focus,
    most_defocus_um,
    suited,
    unfit_steps,
    unsettled,
)
from microplan.planner.calibration.through_focus.focus_step import (
    FocusStep,
    in_light_of,
    sharpest_um,
)
from microplan.planner.calibration.through_focus.profile_table import (
    ProfileTable,
    profile_table,
)
from microplan.planner.calibration.through_focus.wavefront_fit import (
    WavefrontFit,
    fit_wavefront,
)
from microplan.planner.calibration.through_focus.wavefront_values import (
    wavefront_values,
    wavefront_words,
)
from microplan.planner.measure.measuring import MeasuredPicture
from microplan.planner.source.diagnostics import Report, Span

_BEYOND = 1.25  # times the largest distance from the sharpest: a zero off it
_TABLES = 5  # about what suited the last: an aperture up to some three times as stated
_DRAWN = 3  # profiles that are shown
_MOST = 3  # pictures of one reading that a wavefront is fitted to: they take time


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedLens:
    """What a workcell states of its lens."""

    aperture: float | None  # None: a table, that is not replaced
    has_rms: bool = False  # of all aberrations together


def focus_axis(
    readings: PictureReadings,
    finder: PartFinder,
    intake: PictureIntake,
    stated: StatedLens,
) -> CalibrationSeries | None:
    """Return what focus steps of a part tell, None if too little.

    Parameters
    ----------
    readings : PictureReadings
        With focus readings of each picture.
    finder : PartFinder
        Of these pictures.
    intake : PictureIntake
        New; its report receives MP901, MP904 and MP905.
    stated : StatedLens
        By the workcell.
    """
    report, where = intake.report, Span(file=str(readings.file))
    points = _points(finder)
    if points is None:
        message = "the sharpest picture shows too few edges of the part"
        report.error(CODE, where, message, "is it whole, in focus, and alone?")
        return None
    steps, pictures = _steps(readings, finder, intake, points)
    if report.failed or not intake.fits(0, where):
        return None
    found: FocusFit | Refused | None = unfit_steps(steps)
    table = found or _table(points, finder.first, steps)
    if isinstance(table, ProfileTable):
        found = fit_focus(steps, table, table.middle, table.ends)
    if not (isinstance(table, ProfileTable) and isinstance(found, FocusFit)):
        _refuse(found or table, where, report)
        return None
    lens = fit_wavefront(pictures, found.numbers.values)
    if isinstance(lens, Refused):
        few = len(steps) < FEWEST_BLOCKS  # else aberrations may mislead all numbers
        tell = report.warning if few else report.error
        tell(CODE, where, f"no {lens.what}: {lens.why}", f"photograph {lens.take}")
        if not few:
            return None
    return _series(found, lens, steps, table, intake.source(), stated)


def _refuse(found: object, where: Span, report: Report) -> None:
    """Report why steps do not tell what is asked for."""
    message, hint = "the part's edges leave its images", "take smaller focus steps"
    if isinstance(found, Refused):
        message, hint = f"no {found.what}: {found.why}", f"photograph {found.take}"
    report.error(CODE, where, message, hint)


def _points(finder: PartFinder) -> EdgePoints | None:
    """Return the edges that the picture shows in which the part was found."""
    first = finder.first
    case = first.region.case
    if first.x_um is None or first.y_um is None:
        return None
    theta = case.target.theta_rad + first.pose[2]
    return points_seen(case, first.shown, first.at_px, theta)


def _steps(
    readings: PictureReadings,
    finder: PartFinder,
    intake: PictureIntake,
    points: EdgePoints,
) -> tuple[list[FocusStep], list[EdgePicture]]:
    """Return the mean profile of each focus reading, rising, and edges at each."""
    held: dict[float, tuple[FloatArray, int]] = {}
    pictures: dict[float, list[EdgePicture]] = {}
    for row, page in readings_of_pages(readings, intake):
        seen = finder.found_in(page)
        profile = None
        if isinstance(seen, MeasuredPicture):
            guess = seen.region.guess
            profile = mean_profile(points, seen.shown, (guess.column, guess.row))
        if profile is None or not isinstance(seen, MeasuredPicture):
            message = f"{page.name} does not show the part's edges"
            hint = "is it whole in the field, and not too far out of focus?"
            intake.report.warning(CODE, Span(file=str(page.path)), message, hint)
            continue
        total, count = held.get(row.z_um, (np.zeros(len(profile)), 0))
        held[row.z_um] = (total + profile, count + 1)
        shots = pictures.setdefault(row.z_um, [])
        if len(shots) < _MOST:
            rows, columns = page.counts.shape
            pose = finder.first.pose
            edges = edge_picture(points, seen, pose, row.z_um, (rows, columns))
            shots += [] if edges is None else [edges]
    steps = [
        FocusStep(z_um=z_um, profile=total / count)
        for z_um, (total, count) in sorted(held.items())
    ]
    return steps, [each for z_um in sorted(pictures) for each in pictures[z_um]]


def _table(
    points: EdgePoints, first: MeasuredPicture, steps: Sequence[FocusStep]
) -> ProfileTable | Refused | None:
    """Return the images' profiles at all defocus and apertures that steps may have."""
    aperture = points.case.microscope.aperture
    numbers = np.array([aperture, sharpest_um(steps), 1.0])
    for _ in range(_TABLES):
        most_um = _BEYOND * most_defocus_um(steps, numbers)
        table = profile_table(points, first.pose, most_um, float(numbers[0]))
        if table is None:
            return None
        numbers = suited(steps, table, table.middle, table.ends)
        if table.holds(most_defocus_um(steps, numbers), float(numbers[0])):
            return table
    return unsettled(float(numbers[0]))


def _series(
    fit: FocusFit,
    lens: WavefrontFit | Refused,
    steps: Sequence[FocusStep],
    table: ProfileTable,
    source: PictureSource,
    stated: StatedLens,
) -> CalibrationSeries:
    """Return aperture, zero, step and wavefront with what was stated of them."""
    at = ("optics", "numerical_aperture") if stated.aperture is not None else None
    found = fit.numbers if isinstance(lens, Refused) else lens.numbers
    known = stated.aperture
    values: list[CalibratedValue] = [
        single("numerical_aperture", found.one(0), source, where=at, stated=known),
        single("focus_zero_um", found.one(1), source, unit="um"),
        single("focus_scale", found.one(2), source),
    ]
    fixed, free = fit.held_out
    notes = [
        f"profiles are off by {fit.rms:.2%} rms of the edge's step",
        f"steps left out: {fixed:.2%} with readings as travel, {free:.2%} with a scale",
    ]
    if at is None:
        notes.append("optics.numerical_aperture is a table: put the value in its row")
    if isinstance(lens, WavefrontFit):
        values += wavefront_values(lens, source, has_rms=stated.has_rms)
        notes += wavefront_words(lens, has_rms=stated.has_rms)
    return CalibrationSeries(
        heading=f"focus in {source.pictures} pictures at {len(steps)} readings",
        values=tuple(values),
        notes=tuple(notes),
        curves=_curves(found.values, steps, table),
    )


def _curves(
    numbers: FloatArray, steps: Sequence[FocusStep], table: ProfileTable
) -> dict[str, CalibrationCurve]:
    """Return profiles of some steps with the images' through them.

    `numbers`: aperture, zero um, scale; the images have no wavefront error.
    """
    across, found = across_px(), {}
    chosen = np.unique(np.linspace(0, len(steps) - 1, _DRAWN).round().astype(int))
    for step in (steps[k] for k in chosen.tolist()):
        meant = table(numbers[2] * (step.z_um - numbers[1]), numbers[0])
        line, _ = in_light_of(step, meant)
        name = f"edge at focus reading {step.z_um:g} um"
        found[name] = CalibrationCurve(
            points=list(zip(across.tolist(), step.profile.tolist(), strict=True)),
            line=list(zip(across.tolist(), line.tolist(), strict=True)),
        )
    return found
