"""Positions of stage and focus in an OME-TIFF file, as readings of its pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from microplan.planner.calibration.readings import (
    CODE,
    PictureReading,
    PictureReadings,
    series_kind,
)
from microplan.planner.measure.picture_files import ome_text
from microplan.planner.source.diagnostics import Report, Span

OME = (".ome.tif", ".ome.tiff")
_UM = {"\u00b5m": 1.0, "\u03bcm": 1.0, "um": 1.0, "nm": 1e-3, "mm": 1e3}
_HINT = "state the readings in a table beside it, readings.csv"


def read_positions(file: Path, report: Report) -> PictureReadings | None:
    """Return the positions of a file's planes; None if there are none.

    None, too, and a finding MP905, if they are not clear.

    Parameters
    ----------
    file : Path
        An OME-TIFF file; its planes are listed in the order of its pages.
    report : Report
        Receives what is wrong with the positions.

    References
    ----------
    OME Data Model, schema 2016-06: Plane, PositionX, PositionXUnit.
    """
    held = ome_text(file)
    if held is None:
        return None
    text, pages = held
    try:
        root = ET.fromstring(text)  # noqa: S314 - expat bounds its entities
        planes = [each for each in root.iter() if each.tag.endswith("}Plane")]
        rows = _rows(file, planes)
    except (ET.ParseError, ValueError) as error:
        report.error(CODE, Span(file=str(file)), f"OME positions: {error}", _HINT)
        return None
    if len({(row.x_um, row.y_um, row.z_um) for row in rows}) < 2:
        return None
    if len(rows) != pages:
        message = f"OME positions of {len(rows)} planes, the file has {pages} pages"
        report.error(CODE, Span(file=str(file)), message, _HINT)
        return None
    kind = series_kind(file, rows, report)
    if kind is None:
        return None
    return PictureReadings(file=file, rows=rows, kind=kind)


def _rows(file: Path, planes: Sequence[ET.Element]) -> tuple[PictureReading, ...]:
    """Return a row a plane; ValueError if a position is none."""
    return tuple(
        PictureReading(
            name=f"{file.name}[{number}]",
            x_um=_position_um(plane, "PositionX"),
            y_um=_position_um(plane, "PositionY"),
            z_um=_position_um(plane, "PositionZ"),
        )
        for number, plane in enumerate(planes)
    )


def _position_um(plane: ET.Element, name: str) -> float:
    """Return a position of a plane, 0 where it states none."""
    value = plane.get(name)
    if value is None:
        return 0.0
    unit = plane.get(f"{name}Unit", "reference frame")
    if unit not in _UM:
        raise ValueError(f"{name} is in {unit!r}, no unit of length")
    return float(value) * _UM[unit]
