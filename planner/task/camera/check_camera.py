"""Findings of a camera whose numbers contradict each other."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from microplan.optics.lens.response import LEAST_RISE
from microplan.planner.source.diagnostics import Report
from microplan.planner.source.schema import Checked

BITS = 8  # of a camera that states none
FEWEST = 8  # counts between darkness and saturation: with fewer nothing is measured


def check_camera(cell: Checked, report: Report) -> None:
    """Report pixels that are not square, and a response or noise that is none."""
    _check_pixels(cell, report)
    _check_levels(cell, report)
    _check_response(cell, report)
    _check_noise(cell, report)


def _check_pixels(cell: Checked, report: Report) -> None:
    """Report pixels that are not square."""
    if not (cell.good("camera", "sensor_um") and cell.good("camera", "pixels")):
        return
    width, height = cell.source.get("camera", "sensor_um")
    columns, rows = cell.source.get("camera", "pixels")
    if not math.isclose(width / columns, height / rows, rel_tol=1e-6):
        wide, high = width / columns, height / rows
        message = f"pixels are {wide:.6g} um wide and {high:.6g} high"
        hint = "sensor_um and pixels must give square pixels"
        at = cell.source.value("camera", "sensor_um")
        report.error("MP116", at, message, hint)


def _check_levels(cell: Checked, report: Report) -> None:
    """Report levels of black and white out of order, or above the top count."""
    keys = ("bits", "black_level", "white_level")
    bits, black, white = (cell.source.get("camera", key) for key in keys)
    stated = [
        k for k, v in zip(keys, (bits, black, white), strict=True) if v is not None
    ]
    if not all(cell.good("camera", key) for key in stated):
        return
    top = 2 ** int(bits or BITS) - 1
    darkest = 0.0 if black is None else black
    brightest = top if white is None else white
    left = brightest - max(darkest, 0)
    if white is not None and white > top:
        at = cell.source.value("camera", "white_level")
        message = f"white_level {white:g} is above {top}, the top count of "
        message += f"{bits or BITS} bits"
        report.error("MP116", at, message, "state the count of a saturated pixel")
    elif darkest < -brightest:
        at = cell.source.value("camera", "black_level")
        message = (
            f"black_level {darkest:g} cuts off more than half of all levels up to "
        )
        message += f"white_level {brightest:g}"
        report.error("MP116", at, message, "state the count that no light would give")
    elif left < FEWEST:
        key = "black_level" if black is not None else "white_level"
        at = cell.source.value("camera", key)
        message = f"black_level {darkest:g} leaves {left:g} counts up to white_level "
        message += f"{brightest:g}, {FEWEST} at least are needed"
        hint = "both in counts: without light, and saturated"
        report.error("MP116", at, message, hint)


def _check_response(cell: Checked, report: Report) -> None:
    """Report a table of light and level that does not rise from 0, 0 to 1, 1."""
    rows = cell.source.get("camera", "response")
    if not (cell.good("camera", "response") and isinstance(rows, list)):
        return
    lights, levels = ([row[k] for row in rows] for k in (0, 1))
    at = cell.source.value("camera", "response")
    hint = "rows of light and level, each a share of its range: [[0, 0], [1, 1]]"
    if not (_rises(lights) and _rises(levels)):
        message = f"response must rise, got {_listed(rows)}"
        report.error("MP116", at, message, hint)
    elif rows[0] != [0, 0] or rows[-1] != [1, 1]:
        message = f"response goes from {rows[0]} to {rows[-1]}, not from 0, 0 to 1, 1"
        report.error("MP116", at, message, hint)


def _check_noise(cell: Checked, report: Report) -> None:
    """Report a table of noise whose levels do not rise."""
    rows = cell.source.get("camera", "noise_table")
    if not (cell.good("camera", "noise_table") and isinstance(rows, list)):
        return
    at = cell.source.value("camera", "noise_table")
    top = 2 ** int(cell.source.get("camera", "bits") or BITS) - 1
    if max(variance for _, variance in rows) > (top / 2) ** 2:
        message = f"noise_table has variances above {(top / 2) ** 2:g}, the square of "
        message += "half the scale"
        report.error("MP116", at, message, "state variances in counts squared")
    elif max(level for level, _ in rows) > top and cell.good("camera", "bits"):
        message = f"noise_table has levels above {top}, the top count"
        report.error("MP116", at, message, "state levels in counts")
    elif not _rises([level for level, _ in rows]):
        message = f"levels of noise_table must rise, got {_listed(rows)}"
        hint = "rows of level in counts and variance in counts squared"
        report.error("MP116", at, message, hint)


def _rises(values: Sequence[float]) -> bool:
    return all(a + LEAST_RISE < b for a, b in itertools.pairwise(values))


def _listed(rows: Sequence[Sequence[float]]) -> str:
    """Return the first rows of a table."""
    shown = ", ".join(f"[{a:g}, {b:g}]" for a, b in rows[:6])
    return shown + (", ..." if len(rows) > 6 else "")
