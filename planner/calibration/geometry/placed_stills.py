"""Pictures of a part at places that no stage reads: of its discrepancy alone."""

from __future__ import annotations

from microplan.planner.calibration.calibrated_value import CalibrationSeries
from microplan.planner.calibration.geometry.part_places import PartPlaces
from microplan.planner.calibration.picture_intake import CODE
from microplan.planner.calibration.readings import PictureReadings
from microplan.planner.source.diagnostics import Span


def placed_stills(
    readings: PictureReadings, places: PartPlaces
) -> CalibrationSeries | None:
    """Return a series without values of its own, None if the part is in none of it.

    Parameters
    ----------
    readings : PictureReadings
        A group for each place.
    places : PartPlaces
        New; its report receives MP901, MP904 and MP905.
    """
    report, where = places.intake.report, Span(file=str(readings.file))
    places.read(readings)
    if report.failed or not places.intake.fits(0, where):
        return None
    if not places.found:
        hint = "is it the part of --part, in focus and whole in each picture?"
        report.error(CODE, where, "the part is in none of the pictures", hint)
        return None
    groups = {place.reading.group for place in places.found}
    heading = f"a part in {len(places.found)} pictures at {len(groups)} places"
    return CalibrationSeries(heading=heading, values=())
