"""Values of a workcell that contradict each other."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

from microplan.optics.outline.outline import Outline
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.schema import Checked
from microplan.planner.source.source import Source

MOST_SCALING = 0.25  # of the magnification, by all the travel of the focus
FIT_UM = 0.01  # how far a finger's drawn tip and inner face may lie off


def check_workcell(cell: Checked, report: Report) -> None:
    """Report values that contradict each other."""
    _check_intervals(cell, report)
    source = cell.source
    if cell.good("camera", "sensor_um") and cell.good("camera", "pixels"):
        (width, height), (columns, rows) = (
            source.data["camera"]["sensor_um"], source.data["camera"]["pixels"],
        )  # fmt: skip
        if not math.isclose(width / columns, height / rows, rel_tol=1e-6):
            message = (
                f"pixels are {width / columns:.6g} um wide and {height / rows:.6g} high"
            )
            hint = "sensor_um and pixels must give square pixels"
            report.error("MP116", source.value("camera", "sensor_um"), message, hint)
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
    """Report a scale by focus that would turn the image inside out."""
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
