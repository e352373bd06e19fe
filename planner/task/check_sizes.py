"""Parts against the field of view: mistakes of units that a size alone hides."""

from __future__ import annotations

from collections.abc import Mapping

from microplan.planner.drawings.drawing_findings import UM_PER_UNIT
from microplan.planner.drawings.dxf.drawing import Drawing
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Part
from microplan.planner.task.workcell import Workcell

LEAST_PX = 8.0  # of a part at the highest magnification: below it is a blot
MOST_FIELDS = 20.0  # of a part at the lowest; plates may be large, this is a wafer


def check_sizes(parts: Mapping[str, Part], cell: Workcell, report: Report) -> None:
    """Report parts that no look can take in, where another unit would explain it.

    GDSII files state their unit, so they are left alone.
    """
    for name in sorted(parts):
        part = parts[name]
        x0, y0, x1, y1 = part.outline.bounds_um
        extent = max(x1 - x0, y1 - y0)
        drawing = part.sheet.drawing
        if not isinstance(drawing, Drawing):
            continue
        why, fits = likely_units(extent, drawing.units, cell)
        if fits:
            message = f"{drawing.file} is {extent:.6g} um large when read in "
            message += f"{drawing.units}: {why}"
            hint = f"is it drawn in {' or '.join(fits)}?"
            report.error("MP216", drawing.at, message, hint)


def likely_units(extent_um: float, units: str, cell: Workcell) -> tuple[str, list[str]]:
    """Return why a part has an odd size for a cell, and the units that would fit.

    Parameters
    ----------
    extent_um : float
        The larger side of the part.
    units : str
        What it was read in.
    cell : Workcell
        Its field and the reach of its stage say what is odd.

    Returns
    -------
    (str, list of str)
        No units if the size is not odd, or none would make it less so.
    """
    low, high = cell.optics.magnification
    camera = cell.camera
    field = camera.pitch_um * max(camera.width_px, camera.height_px) / low
    least = LEAST_PX * camera.pitch_um / high
    limits = cell.stage.axes.limits
    reach = max(limits[key][1] - limits[key][0] for key in ("x_um", "y_um")) + field
    if extent_um < least:
        why = f"less than {LEAST_PX:g} pixels at the highest magnification {high:g}"
    elif extent_um > max(MOST_FIELDS * field, reach):
        why = f"the field is {field:.4g} um wide, the stage reaches over {reach:.6g} um"
    else:
        return "", []
    raw = extent_um / UM_PER_UNIT[units]
    return why, [u for u, um in UM_PER_UNIT.items() if least <= raw * um <= field]
