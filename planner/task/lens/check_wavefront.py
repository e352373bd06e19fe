"""Findings of a wavefront error whose numbers contradict each other."""

from __future__ import annotations

import math

from microplan.planner.source.diagnostics import Report
from microplan.planner.source.schema import Checked

MOST_WAVES = 0.25  # of all terms together: a Strehl ratio below .1 shows no edges


def check_wavefront(cell: Checked, report: Report) -> None:
    """Report terms stated twice, too many of them together, and two statements."""
    if not cell.good("optics", "wavefront"):
        return
    source, where = cell.source, ("optics", "wavefront")
    rows = source.items(*where)
    nolls = [row["noll"] for row in rows]
    for index, noll in enumerate(nolls):
        if noll in nolls[:index]:
            first = source.value(*where, nolls.index(noll), "noll")
            at = source.value(*where, index, "noll")
            hint = f"it stands at {first.file}:{first.line}:{first.column} already"
            report.error("MP116", at, f"noll {noll} is stated twice", hint)
    total = math.hypot(
        *(abs(row["waves"]) + 2 * row.get("sigma_waves", 0.0) for row in rows)
    )
    if total > MOST_WAVES:
        message = f"wavefront is {total:.3g} waves rms in all, above {MOST_WAVES:g}"
        hint = "with two of each sigma_waves; a diffraction limited lens has .07 in all"
        report.error("MP116", source.value(*where), message, hint)
    if cell.good("optics", "wavefront_rms"):
        at = source.value("optics", "wavefront_rms")
        message = "wavefront and wavefront_rms are both stated"
        hint = "state the terms, or of an objective whose terms are not known the total"
        report.error("MP116", at, message, hint)
