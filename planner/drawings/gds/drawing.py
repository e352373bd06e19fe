"""Read a GDSII drawing: layers of a cell in, one outline in um out."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from microplan.optics.outline.outline import Outline, Ring
from microplan.planner.drawings.census import Taken
from microplan.planner.drawings.drawing_findings import (
    MAX_LISTED,
    MAX_UM,
    MIN_UM,
    body_places,
    counts_said,
    extent_um,
)
from microplan.planner.drawings.gds.cells import expand, held, reached
from microplan.planner.drawings.gds.library import Library, read_library
from microplan.planner.drawings.gds.records import GdsError
from microplan.planner.drawings.gds.regions import Rounded, by_layer, unite
from microplan.planner.drawings.nesting import BadRingsError, nest
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.schema import did_you_mean

SAME_UNIT = 1e-6  # relative: roundings of one unit, none of them another
UNIT_M = {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "inch": 0.0254, "m": 1.0}

LABELS = frozenset(("TEXT", "NODE"))  # cover no area

_LAYER = re.compile(r"[0-9]{1,5}/[0-9]{1,5}")


@dataclass(frozen=True, slots=True, kw_only=True)
class GdsDrawing:
    """An opened drawing and where the task asks for it."""

    file: str  # as the user knows it
    library: Library
    cells: tuple[str, ...]  # what the drawn cell is made of; itself last
    at: Span  # of the file's name in the task
    layers_at: Span

    @property
    def cell(self) -> str:
        """Return the cell that is drawn."""
        return self.cells[-1]


def load_gds(
    data: bytes, file: str, units: str, cell: str | None,
    at: Span, layers_at: Span, cell_at: Span, report: Report,
) -> GdsDrawing | None:  # fmt: skip
    """Return the drawing that a file's bytes hold, None if why not was reported.

    Parameters
    ----------
    data, file : bytes, str
        What the file holds, and its name as the user knows it.
    units : str
        What the task says that the file's user unit is.
    cell : str or None
        The cell to draw; None for the only one that no other refers to.
    at, layers_at, cell_at : Span
        Where the task names the file, the layers and the cell.
    report : Report
        Receives the findings.
    """
    try:
        library = read_library(data)
        if not _same_units(library, units, file, at, report):
            return None
        top = _top(library, cell, file, at if cell is None else cell_at, report)
        cells = None if top is None else reached(library, top)
    except GdsError as error:
        _report(error, file, at, report)
        return None
    if cells is None:
        return None
    drawing = GdsDrawing(
        file=file, library=library, cells=cells, at=at, layers_at=layers_at
    )
    _say_skipped(drawing, report)
    return drawing


def take_gds(
    drawing: GdsDrawing,
    layers: Sequence[str],
    report: Report,
    at: Span | None = None,
    *,
    apart: bool = False,
) -> Taken | None:
    """Return what `layers` of `drawing` enclose; None if it was reported.

    Parameters
    ----------
    drawing : GdsDrawing
        As `load_gds` returned it.
    layers : sequence of str
        As "layer/datatype", "1/0".
    report : Report
        Receives the findings.
    at : Span, optional
        Where the layers are asked for; the drawing's own list if not given.
    apart : bool
        Whether several outer rings are no mistake.

    Returns
    -------
    Taken or None
        One outer ring and its holes, um, the largest distance in um between a curve
        that the drawing samples and its chords, and what they were taken from.
    """
    at = at or drawing.layers_at
    if not _all_there(drawing, layers, at, report):
        return None
    rings: list[Ring] = []
    rounded: list[Rounded] = []
    chord_um = 0.0
    try:
        placed = expand(drawing.library, drawing.cells, frozenset(layers))
        for _, shapes in sorted(by_layer(placed).items()):
            found = unite(shapes, drawing.library.unit_um)
            rings += found.rings
            rounded += found.rounded
            chord_um = max(chord_um, found.chord_um)
    except GdsError as error:
        _report(error, _name(drawing), at, report)
        return None
    _say_rounded(drawing, rounded, at, report)
    outline = _nested(drawing, rings, at, report, apart=apart)
    if outline is None:
        return None
    taken = {
        (layer, kind): n
        for (layer, kind), n in held_gds(drawing).items()
        if layer in layers and kind not in LABELS
    }
    return Taken(
        outline=outline, chord_um=chord_um, layers=tuple(layers), at=at,
        taken=taken, skipped={},
    )  # fmt: skip


def held_gds(drawing: GdsDrawing) -> Counter[tuple[str, str]]:
    """Return how many elements of each layer and kind the drawn cell has."""
    return held(drawing.library, drawing.cells)


def _same_units(
    library: Library, units: str, file: str, at: Span, report: Report
) -> bool:
    """Report units that contradict the task's.

    The file's are in metres and always there, so they are the ones to believe; a
    contradiction still means that one of them is wrong.
    """
    stated = library.user_unit_m
    known = [name for name, m in UNIT_M.items() if abs(stated / m - 1) <= SAME_UNIT]
    if known == [units]:
        return True
    message = f"{file} is in units of {stated:g} m, the task says {units}"
    if known:
        report.error("MP210", at, message, f"units: {known[0]}")
        return False
    report.warning("MP210", at, message, "the file's own unit is used")
    return True


def _top(
    library: Library, cell: str | None, file: str, at: Span, report: Report
) -> str | None:
    """Return the cell to draw, None after reporting that it is not clear which."""
    if cell is not None:
        if cell in library.structures:
            return cell
        known = sorted(library.structures)
        hint = did_you_mean(cell, known) or f"it has {listed(known)}"
        report.error("MP231", at, f"{file} has no cell '{cell}'", hint)
        return None
    tops = library.tops
    if len(tops) == 1:
        return tops[0]
    if tops:
        message = f"{file} has {len(tops)} top cells: {listed(tops)}"
        report.error("MP231", at, message, f"say which one, cell: {tops[0]}")
    else:
        report.error("MP231", at, f"{file} has no cell that no other one places")
    return None


def _all_there(
    drawing: GdsDrawing, layers: Sequence[str], at: Span, report: Report
) -> bool:
    """Report layers that are no layers, or hold nothing."""
    there: Counter[str] = Counter()
    for (layer, kind), n in held_gds(drawing).items():
        if kind not in LABELS:
            there[layer] += n
    good = True
    for name in layers:
        if not _LAYER.fullmatch(name):
            message = f"'{name}' is no layer of a GDSII file"
            report.error("MP107", at, message, "write layer/datatype, such as 1/0")
            good = False
        elif not there[name]:
            message = f"{_name(drawing)} has nothing on layer '{name}'"
            has = f"shapes by layer: {counts_said(dict(sorted(there.items())))}"
            report.error("MP204", at, message, has)
            good = False
    return good


def _nested(
    drawing: GdsDrawing, rings: Sequence[Ring], at: Span, report: Report, *, apart: bool
) -> Outline | None:
    """Return the rings as one body with holes, or with `apart` as several."""
    name = _name(drawing)
    try:
        outline, doubled, bodies = nest(rings)
    except BadRingsError as error:
        report.error("MP208", at, f"{name}: {error}")
        return None
    if doubled:
        message = f"{name}: {doubled} rings are drawn on two layers"
        report.warning("MP213", at, message, "each ring is taken once")
    if bodies > 1 and not apart:
        count = Counter(ring.layer for ring in outline.rings)
        says = ", ".join(f"'{k}' {n}" for k, n in sorted(count.items()))
        message = f"{name}: {bodies} separate outlines, a part is one: "
        message += body_places(outline.rings)
        hint = f"select the cell or layers of one; rings by layer: {says}"
        report.error("MP209", at, message, hint)
        return None
    extent = extent_um(outline)
    if not MIN_UM <= extent <= MAX_UM:
        message = f"{name} is {extent:.6g} um large, allowed {MIN_UM:g} to {MAX_UM:g}"
        hint = f"its UNITS make one database unit {drawing.library.unit_um:g} um"
        report.error("MP216", at, message, hint)
        return None
    return outline


def _say_skipped(drawing: GdsDrawing, report: Report) -> None:
    """Report what the cells hold other than shapes."""
    skipped: Counter[str] = Counter()
    for cell in drawing.cells:
        for (_, kind), n in drawing.library.structures[cell].skipped.items():
            skipped[kind] += n
    if skipped:
        says = ", ".join(f"{n} {kind}" for kind, n in sorted(skipped.items()))
        message = f"{_name(drawing)}: passed over: {says}"
        report.fact("MP236", drawing.at, message, "they cover no area")


def _say_rounded(
    drawing: GdsDrawing, rounded: Sequence[Rounded], at: Span, report: Report
) -> None:
    """Report which polygons were taken for circles."""
    if not rounded:
        return
    said = [
        f"R {found.circle.radius_um:.6g} um at ({found.circle.center[0]:.6g}, "
        f"{found.circle.center[1]:.6g}), {found.corners} corners"
        for found in rounded[:MAX_LISTED]
    ]
    more = len(rounded) - len(said)
    worst = max(found.chord_um for found in rounded)
    message = f"{_name(drawing)}: polygons taken for circles: {'; '.join(said)}" + (
        f"; and {more} more" if more else ""
    )
    hint = f"their edges run up to {worst:.3g} um inside them"
    report.fact("MP235", at, message, hint)


def _report(error: GdsError, name: str, at: Span, report: Report) -> None:
    """Report what a module below found."""
    where = f" (byte {error.offset})" if error.offset >= 0 else ""
    report.error(error.code, at, f"{name}: {error.message}{where}", error.hint)


def _name(drawing: GdsDrawing) -> str:
    return f"{drawing.file}, cell '{drawing.cell}'"


def listed(names: Sequence[str]) -> str:
    """Return names, the first few."""
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    return ", ".join(f"'{name}'" for name in names[:MAX_LISTED]) + more
