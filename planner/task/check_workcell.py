"""Checks of a workcell: contradictory values, readings or part sizes out of range."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any

from microplan.optics.outline.outline import Outline
from microplan.planner.drawings.drawing_findings import UM_PER_UNIT, extent_um
from microplan.planner.drawings.dxf.drawing import Drawing
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.schema import Checked
from microplan.planner.source.source import Key, Source
from microplan.planner.task.camera.check_camera import check_camera
from microplan.planner.task.lens.check_wavefront import check_wavefront
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
        extent = extent_um(part.outline)
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


_AXES = ("x_um", "y_um", "z_um", "theta_deg")


def check_limits(task: Checked, cell: Checked | None, report: Report) -> None:
    """Report axis readings and jaw openings that cannot be reached."""
    if cell is None:
        return
    for where, axes in _readings(task):
        limits = ("axes", axes, "limits")
        for key in _AXES:
            if task.good(*where, key) and cell.good(*limits, key):
                name = f"{axes} {key}"
                _check(task, (*where, key), cell, (*limits, key), name, report)
    for where, tool in _openings(task):
        allowed = ("tools", tool, "opening_um")
        if task.good(*where) and cell.good(*allowed):
            _check(task, where, cell, allowed, f"{tool} opening_um", report)


def _check(
    task: Checked, where: tuple[Key, ...], cell: Checked, limits: tuple[Key, ...],
    name: str, report: Report,
) -> None:  # fmt: skip
    """Report the value at `where` if it is outside the interval at `limits`."""
    value = task.source.get(*where)
    low, high = cell.source.get(*limits)
    if low <= high and not low <= value <= high:
        span = cell.source.value(*limits)
        message = f"{name} {value} is outside the workcell's {low} to {high}"
        hint = f"the limits stand in {span.file}:{span.line}"
        report.error("MP118", task.source.value(*where), message, hint)


def _readings(task: Checked) -> Iterator[tuple[tuple[Key, ...], str]]:
    """Yield the keys of axis readings, and of which axes."""
    yield ("start", "stage"), "stage"
    for name in task.source.mapping("start"):
        if task.source.get("start", name, "on") == "robot":
            yield ("start", name), "robot"
    for index, _ in _steps(task):
        for number, move in enumerate(task.source.items("steps", index, "move")):
            for axes in move if isinstance(move, dict) else ():
                if axes in ("stage", "robot"):
                    yield ("steps", index, "move", number, axes), axes


def _openings(task: Checked) -> Iterator[tuple[tuple[Key, ...], str]]:
    """Yield the keys of jaw openings, and of which tool."""
    tools = []
    for name in task.source.mapping("start"):
        if task.source.get("start", name, "on") == "robot":
            tools.append(name)
            yield ("start", name, "opening_um"), name
    for index, step in _steps(task):
        tool = step.get("with")
        if step.get("do") == "release" and len(tools) == 1:
            tool = tools[0]  # the only one that can hold anything
        if isinstance(tool, str):
            yield ("steps", index, "opening_um"), tool


def _steps(task: Checked) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the steps that are mappings."""
    for index, step in enumerate(task.source.items("steps")):
        if isinstance(step, dict):
            yield index, step


MOST_SCALING = 0.25  # of the magnification, by all the travel of the focus
FIT_UM = 0.01  # how far a finger's drawn tip and inner face may lie off


def check_workcell(cell: Checked, report: Report) -> None:
    """Report values that contradict each other."""
    _check_intervals(cell, report)
    source = cell.source
    check_camera(cell, report)
    check_wavefront(cell, report)
    if cell.good("optics"):
        _check_aperture(source, report)
        _check_scale(source, report)


def check_fingers(
    name: str, raw: Mapping[str, Any], left: Outline, right: Outline, at: Span,
    report: Report,
) -> None:  # fmt: skip
    """Report fingers that are not drawn closed, in the grip's frame."""
    tip, length = raw["grip_from_tip_um"], raw["length_um"]
    for side, box in (("left", left.bounds_um), ("right", right.bounds_um)):
        face = box[2] if side == "left" else box[0]
        wrong = ""
        if abs(face) > FIT_UM:
            wrong = f"inner face at x = {face:.6g} um, must be 0"
        elif abs(box[1] + tip) > FIT_UM:
            wrong = f"tip at y = {box[1]:.6g} um, grip_from_tip_um asks for {-tip:.6g}"
        elif abs(box[3] - box[1] - length) > 0.01 * length:
            wrong = f"{box[3] - box[1]:.6g} um long, length_um says {length:.6g}"
        if wrong:
            hint = "draw the jaws closed, the grip at the origin, fingers to +y"
            report.error("MP223", at, f"{name}, {side} finger: {wrong}", hint)


def check_surfaces(checked: Checked, report: Report, *sections: str) -> None:
    """Report intervals of walls and faces that run backwards.

    `sections` are the keys of the file that hold bodies by name.
    """
    for where in _bodies(checked, sections):
        for key in (("wall", "reflectance"), ("finish",)):
            if checked.good(*where, *key):
                value = checked.source.get(*where, *key)
                if isinstance(value, list):
                    report_backwards(
                        checked.source, (*where, *key), value[0], value[1], report
                    )


def _bodies(checked: Checked, sections: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Yield where bodies are described, posts after their part."""
    for section in sections:
        for name in sorted(checked.source.mapping(section)):
            yield (section, name)
            for post in sorted(checked.source.mapping(section, name, "posts")):
                yield (section, name, "posts", post)


def report_backwards(
    source: Source, where: tuple[str, ...], low: float, high: float, report: Report
) -> None:
    """Report an interval whose end lies below its start."""
    if low > high:
        message = f"{'.'.join(where)} runs backwards, from {low} to {high}"
        report.error("MP113", source.value(*where), message, "swap them")


def _check_intervals(cell: Checked, report: Report) -> None:
    """Report intervals that run backwards."""
    source = cell.source
    pairs: list[tuple[str, ...]] = [("camera", "exposure_ms"), ("light", "level")]
    for axes in ("robot", "stage"):
        keys = ("x_um", "y_um", "z_um", "theta_deg")
        pairs += [("axes", axes, "limits", key) for key in keys]
    pairs += [("tools", name, "opening_um") for name in source.mapping("tools")]
    for where in pairs:
        if cell.good(*where):
            low, high = source.get(*where)
            report_backwards(source, where, low, high, report)
    for section, first, last in (
        (("optics", "magnification"), "min", "max"),
        (("optics", "focus"), "min_um", "max_um"),
    ):
        if cell.good(*section):
            low, high = source.get(*section, first), source.get(*section, last)
            report_backwards(source, section, low, high, report)


def _check_aperture(source: Source, report: Report) -> None:
    """Report apertures that no lens in the medium can have, or out of order."""
    index = source.data["optics"].get("medium_index", 1.0)
    table = source.data["optics"]["numerical_aperture"]
    at = source.value("optics", "numerical_aperture")
    values = [r["value"] for r in table] if isinstance(table, list) else [table]
    if max(values) >= index:
        message = f"numerical_aperture {max(values)} is not below medium_index {index}"
        report.error("MP116", at, message, "an aperture is the index times a sine")
    if isinstance(table, list):
        rows = [row["magnification"] for row in table]
        if any(a >= b for a, b in itertools.pairwise(rows)):
            message = f"magnifications {rows} do not ascend"
            report.error("MP116", at, message, "sort the table by magnification")


def _check_scale(source: Source, report: Report) -> None:
    """Report a scale by focus that would change the magnification too much."""
    focus = source.data["optics"]["focus"]
    scale = abs(focus.get("scale_per_um", 0.0))
    travel_um = max(abs(focus["min_um"]), abs(focus["max_um"]))
    if scale * travel_um > MOST_SCALING:
        at = source.value("optics", "focus", "scale_per_um")
        message = (
            f"scale_per_um {focus['scale_per_um']} over {travel_um:g} um of focus "
            f"changes the magnification by {scale * travel_um:.0%}, above "
            f"{MOST_SCALING:.0%}"
        )
        report.error("MP116", at, message, "a relative change per um: 1e-5 is 1 % / mm")
