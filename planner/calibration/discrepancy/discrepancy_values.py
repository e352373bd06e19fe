"""A workcell's discrepancy as calibrated values, or a finding that says why not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    CalibrationSeries,
    PictureSource,
    single,
)
from microplan.planner.calibration.discrepancy.place_misfits import (
    PlaceMisfits,
    discrepancy_shares,
)
from microplan.planner.calibration.estimates import BlockEstimate, Refused
from microplan.planner.calibration.picture_intake import CODE, PictureIntake
from microplan.planner.source.diagnostics import Span

SECTION = "discrepancy"
MOST: Mapping[str, float] = {"edge": 0.3, "flat": 0.1, "pixel": 0.3}  # a workcell's
_HINT = "is the drawing the part's, and the part in focus? pictures of it tell"


def with_discrepancy(
    series: CalibrationSeries | None,
    seen: PlaceMisfits,
    intake: PictureIntake,
    where: Span,
    stated: Mapping[str, float],
) -> CalibrationSeries | None:
    """Return a series with the discrepancy of its pictures, None if there is none.

    Parameters
    ----------
    series : CalibrationSeries, optional
        What the same pictures tell besides.
    seen : PlaceMisfits
        Of these pictures.
    intake : PictureIntake
        Of these pictures; its report receives MP904 if they tell no discrepancy.
    where : Span
        Of the series, for findings.
    stated : mapping of str to float
        Shares that the workcell states.
    """
    if series is None:
        return None
    found = discrepancy_shares(seen)
    if isinstance(found, Refused):
        message = f"no {found.what}: {found.why}"
        tell = intake.report.warning if series.values else intake.report.error
        tell(CODE, where, message, f"photograph {found.take}")
        return series if series.values else None
    wild = [name for name, each in found.shares.items() if each.value > MOST[name]]
    if wild:
        value, most = found.shares[wild[0]].value, MOST[wild[0]]
        message = f"no {SECTION}: {wild[0]} would be {value:.2g}, {most:g} at most"
        intake.report.warning(CODE, where, message, _HINT)
        return series
    values = series.values + tuple(_values(found.shares, intake.source(), stated))
    return replace(series, values=values, notes=series.notes + found.untold)


def _values(
    found: dict[str, BlockEstimate],
    source: PictureSource,
    stated: Mapping[str, float],
) -> Iterator[CalibratedValue]:
    """Yield the shares as values."""
    for name in reversed(found):  # keys are put in front of a section
        at, key = (SECTION, name), f"{SECTION}_{name}"
        yield single(key, found[name], source, where=at, stated=stated.get(name))
