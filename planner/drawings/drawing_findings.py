"""Findings on drawings: entities left out, likely mistakes of size, unit or grid."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from microplan.optics.outline.outline import Arc, Outline, Ring, Segment
from microplan.planner.drawings.biarcs import CURVE_UM
from microplan.planner.drawings.pieces import Drawn, Piece, Trouble
from microplan.planner.drawings.rings import OpenEnd
from microplan.planner.source.diagnostics import Report, Span

UM_PER_UNIT = {"nm": 1e-3, "um": 1.0, "mm": 1e3, "inch": 25.4e3, "m": 1e6}
_INSUNITS = {
    1: "inch", 2: "foot", 4: "mm", 5: "cm", 6: "m", 8: "microinch", 9: "mil",
    11: "angstrom", 12: "nm", 13: "um",
}  # fmt: skip

MIN_UM, MAX_UM = 0.5, 5e4  # extent of anything that is seen through a microscope
MAX_LISTED = 8  # findings of one kind for one drawing

# A grid is coarse if a part has fewer than 1000 steps of it, and is drawn with so many
# different coordinates that they were rounded to it rather than chosen on it.
_FINE_STEPS = 1000
_MANY_VALUES = 32
_DECIMALS = range(-3, 9)


def header_unit(code: int) -> str | None:
    """Return the unit that $INSUNITS stands for, None if it names none."""
    return _INSUNITS.get(code)


def body_places(rings: Sequence[Ring]) -> str:
    """Return where each outer ring lies and how large it is, the first few, um."""
    outer = [ring for ring in rings if ring.signed_area_um2 > 0]
    places = []
    for ring in outer[:MAX_LISTED]:
        x0, y0, x1, y1 = Outline(rings=(ring,)).bounds_um
        places.append(
            f"{x1 - x0:.4g} x {y1 - y0:.4g} um about ({(x0 + x1) / 2:.4g}, "
            f"{(y0 + y1) / 2:.4g}) um on '{ring.layer}'"
        )
    more = ["..."] if len(outer) > MAX_LISTED else []
    return ", ".join([*places, *more])


def extent_um(outline: Outline) -> float:
    """Return the longer side of an outline's bounds, um."""
    x0, y0, x1, y1 = outline.bounds_um
    return max(x1 - x0, y1 - y0)


def report_troubles(
    file: str, troubles: Sequence[Trouble], at: Span, report: Report
) -> None:
    """Report what cannot be taken, one finding for all that share a reason."""
    alike: dict[tuple[str, str, str], list[str]] = {}
    for t in troubles:
        alike.setdefault((t.code, t.message, t.hint), []).append(t.handle)
    for (code, message, hint), handles in list(alike.items())[:MAX_LISTED]:
        which = f" ({handles_said(handles)})" if any(handles) else ""
        report.error(code, at, f"{file}: {message}{which}", hint)
    if (more := len(alike) - MAX_LISTED) > 0:
        code = list(alike)[MAX_LISTED][0]
        report.error(code, at, f"{file}: {more} more entities cannot be taken")


def report_left_out(file: str, drawn: Drawn, at: Span, report: Report) -> None:
    """Note what of the selected layers was left out, or read by a rule."""
    if drawn.skipped:
        left: Counter[str] = Counter()
        for (_, what), n in drawn.skipped.items():
            left[what] += n
        said = ", ".join(f"{n} {what}" for what, n in sorted(left.items()))
        report.note("MP219", at, f"{file}: left out: {said}")
    if drawn.strokes:
        message = f"{file}: lines with a width: {handles_said(drawn.strokes)}"
        report.note("MP224", at, message, "the border of what they fill is taken")
    curved = list(dict.fromkeys(p.handle for p in drawn.pieces if p.curved))
    if curved:
        message = f"{file}: curves became arcs within {CURVE_UM:g} um: "
        report.fact("MP225", at, message + handles_said(curved))


def report_size(
    file: str,
    units: str,
    outline: Outline,
    at: Span,
    report: Report,
    least_um: float = MIN_UM,
) -> bool:
    """Return whether a part can have this size; else name the unit that would fit."""
    extent = extent_um(outline)
    if least_um <= extent <= MAX_UM:
        return True
    raw = extent / UM_PER_UNIT[units]
    fits = [unit for unit, um in UM_PER_UNIT.items() if MIN_UM <= raw * um <= MAX_UM]
    message = (
        f"{file} is {extent:.6g} um large when read in {units}, "
        f"allowed {MIN_UM:g} to {MAX_UM:g}"
    )
    hint = f"is it drawn in {' or '.join(fits)}?" if fits else ""
    report.error("MP216", at, message, hint)
    return False


def warn_coarse(
    file: str, units: str, outline: Outline, pieces: Sequence[Piece], at: Span,
    report: Report,
) -> None:  # fmt: skip
    """Warn if coordinates look rounded to a grid that is coarse against the part."""
    um = UM_PER_UNIT[units]
    values = {round(value / um, 9) for value in _given(pieces)}
    if len(values) < _MANY_VALUES:
        return
    grid = next((10.0**-k for k in _DECIMALS if _on_grid(values, k)), 0.0) * um
    extent = extent_um(outline)
    if grid * _FINE_STEPS <= extent:
        return
    message = (
        f"{file}: all coordinates are multiples of {grid:.3g} um, the part is "
        f"{extent:.6g} um large: places may be off by {grid / math.sqrt(2):.2g} um"
    )
    report.warning("MP218", at, message, "export it with more decimals")


def handles_said(handles: Sequence[str]) -> str:
    """Return the handles of entities, the first few."""
    more = ", ..." if len(handles) > MAX_LISTED else ""
    return ", ".join(handles[:MAX_LISTED]) + more


def counts_said(counts: Mapping[str, int]) -> str:
    """Return names with their numbers, the first few."""
    said = [f"'{name}' {n}" for name, n in list(counts.items())[:MAX_LISTED]]
    more = len(counts) - len(said)
    return ", ".join(said) + (f" and {more} more" if more else "") or "nothing"


def places_said(ends: Sequence[OpenEnd]) -> str:
    """Return coordinates and handles of ends, those at one point together."""
    places: dict[tuple[str, str], list[str]] = {}
    for end in ends:
        place = f"{end.x_um + 0.0:.6g}", f"{end.y_um + 0.0:.6g}"
        places.setdefault(place, []).append(end.handle)
    said = [
        f"({x}, {y}) um ({', '.join(dict.fromkeys(handles[:MAX_LISTED]))})"
        for (x, y), handles in list(places.items())[:MAX_LISTED]
    ]
    more = len(places) - len(said)
    return ", ".join(said) + (f" and {more} more" if more else "")


def _given(pieces: Sequence[Piece]) -> list[float]:
    """Return the coordinates that drawings state: corners and centres, um."""
    values: list[float] = []
    for piece in pieces:
        if piece.curved:
            continue
        for edge in piece.edges:
            if isinstance(edge, Segment):
                values += (*edge.start, *edge.end)
            elif isinstance(edge, Arc):
                values += (*edge.center, edge.radius_um)
    return values


def _on_grid(values: set[float], decimals: int) -> bool:
    """Return whether all values are whole after shifting the decimal point."""
    shift = 10.0**decimals
    return all(abs(v * shift - round(v * shift)) < 1e-6 for v in values)
