"""Read a DXF drawing: layers of a file in, one outline in um out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from microplan.optics.outline.outline import Outline, Ring
from microplan.planner.drawings.biarcs import CURVE_UM
from microplan.planner.drawings.census import Taken
from microplan.planner.drawings.drawing_findings import (
    MIN_UM,
    UM_PER_UNIT,
    body_places,
    counts_said,
    handles_said,
    header_unit,
    places_said,
    report_left_out,
    report_size,
    report_troubles,
    warn_coarse,
)
from microplan.planner.drawings.dxf.census import by_layer, held
from microplan.planner.drawings.dxf.edges import draw
from microplan.planner.drawings.dxf.entities import READERS
from microplan.planner.drawings.dxf.file import (
    CrowdedError,
    DamagedError,
    DxfFile,
    read_dxf,
)
from microplan.planner.drawings.nesting import BadRingsError, nest
from microplan.planner.drawings.overlaps import without_overlaps
from microplan.planner.drawings.pieces import Drawn
from microplan.planner.drawings.rings import GAP_UM, Chained, chain
from microplan.planner.source.diagnostics import Report, Span

MAX_BYTES = 16 << 20
_UNCOUNTED = ("MP202", "MP215", "MP217")  # after these it is not known what there is


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawing:
    """An opened drawing and where the task asks for it."""

    file: str  # as the user knows it
    data: bytes  # of the whole file
    document: DxfFile
    units: str
    at: Span  # of the file's name in the task
    layers_at: Span


def load_drawing(
    data: bytes, file: str, units: str, at: Span, layers_at: Span, report: Report
) -> Drawing | None:
    """Return the drawing that a file's bytes hold, None if why not was reported.

    Read strictly: nothing is repaired, a file without its end is refused.
    """
    try:
        document = read_dxf(data)
    except DamagedError as error:
        hint = "save it again from the CAD program"
        report.error("MP202", at, f"{file} is damaged: {error}", hint)
        return None
    except CrowdedError as error:
        hint = "save the part alone, without the sheet around it"
        report.error("MP215", at, f"{file} is too large: {error}", hint)
        return None
    except (ValueError, OverflowError) as error:
        report.error("MP201", at, f"{file} is not a readable DXF file: {error}")
        return None
    drawing = Drawing(
        file=file, data=data, document=document, units=units,
        at=at, layers_at=layers_at,
    )  # fmt: skip
    _cross_check(drawing, report)
    return drawing


def take(
    drawing: Drawing,
    layers: Sequence[str],
    report: Report,
    at: Span | None = None,
    *,
    apart: bool = False,
    least_um: float = MIN_UM,
) -> Taken | None:
    """Return what `layers` of `drawing` enclose, in um; None if it was reported.

    Parameters
    ----------
    drawing : Drawing
        As `load_drawing` returned it.
    layers : sequence of str
        Their names; case does not matter, as in DXF.
    report : Report
        Receives the findings.
    at : Span, optional
        Where the layers are asked for; the drawing's own list if not given.
    apart : bool
        Whether several outer rings are no mistake.
    least_um : float
        Smaller ones are taken for a wrong unit.

    Returns
    -------
    Taken or None
        One outer ring and its holes, circles and arcs kept, and what it was taken
        from.
    """
    at = at or drawing.layers_at
    drawn = _drawn(drawing, layers, at, report)
    if drawn is None:
        return None
    kept, again = without_overlaps(drawn.pieces)
    chained = chain(kept)
    if not _closed(drawing, chained, again, at, report):
        return None
    outline = _nested(drawing, chained, at, report, apart=apart, least_um=least_um)
    if outline is None:
        return None
    warn_coarse(drawing.file, drawing.units, outline, drawn.pieces, at, report)
    curved = any(piece.curved for piece in drawn.pieces)
    return Taken(
        outline=outline,
        chord_um=CURVE_UM if curved else 0.0,
        layers=tuple(layers),
        at=at,
        taken=drawn.taken,
        skipped=drawn.skipped,
        plain=not (drawn.strokes or any(kind == "HATCH" for _, kind in drawn.taken)),
    )


def _cross_check(drawing: Drawing, report: Report) -> None:
    """Warn if the header names another unit than the task."""
    known = header_unit(drawing.document.units)
    if known not in (None, drawing.units):
        report.warning(
            "MP210",
            drawing.at,
            f"{drawing.file} says it is in {known}, the task says {drawing.units}",
            "the task's units are used",
        )


def _drawn(
    drawing: Drawing, layers: Sequence[str], at: Span, report: Report
) -> Drawn | None:
    """Return what is on `layers`, None after an error was reported."""
    names = frozenset(name.lower() for name in layers)
    try:
        drawn = draw(drawing.document, names, UM_PER_UNIT[drawing.units])
        counted = not any(t.code in _UNCOUNTED for t in drawn.troubles)
        counts = by_layer(held(drawing.document)[0]) if counted else {}
    except (ValueError, OverflowError) as error:
        report.error("MP201", at, f"{drawing.file} is not a readable DXF file: {error}")
        return None
    report_troubles(drawing.file, drawn.troubles, at, report)
    has = f"entities by layer: {counts_said(counts)}"
    missing = _missing(drawing, layers, counts) if counted else {}
    for name, code in missing.items():
        message = f"{drawing.file} has nothing on layer '{name}'"
        message += " but in the paper space" if code == "MP220" else ""
        report.error(code, at, message, has)
    report_left_out(drawing.file, drawn, at, report)
    if missing or drawn.troubles:
        return None
    if not drawn.pieces:
        left = ", ".join(sorted({what for _, what in drawn.skipped})) or "nothing"
        message = f"{drawing.file} has no lines on {', '.join(layers)}, only {left}"
        report.error("MP204", at, message, has)
        return None
    return drawn


def _missing(
    drawing: Drawing, layers: Sequence[str], counts: Mapping[str, int]
) -> dict[str, str]:
    """Return the layers that hold nothing in the model space, with the code."""
    there = {name.lower() for name in counts}
    paper = {
        entity.layer.lower()
        for entity in drawing.document.paper
        if entity.kind in READERS or entity.kind == "INSERT"
    }
    return {
        name: "MP220" if name.lower() in paper else "MP204"
        for name in layers
        if name.lower() not in there
    }


def _closed(
    drawing: Drawing, chained: Chained, again: Sequence[str], at: Span, report: Report
) -> bool:
    """Return whether all rings close; report doubles, junctions, ends and gaps."""
    doubled = tuple(dict.fromkeys((*chained.doubled, *again)))
    if doubled:
        message = f"{drawing.file}: drawn twice: {handles_said(doubled)}"
        report.warning("MP213", at, message, "each edge is taken once")
    if chained.branches:
        message = f"{drawing.file}: more than two edges meet at "
        report.error("MP212", at, message + places_said(chained.branches))
        return False
    if chained.open:
        message = f"{drawing.file}: the outline is open at {places_said(chained.open)}"
        hint = f"close it, to {GAP_UM:g} um at least, or take the lines off the layer"
        report.error("MP205", at, message, hint)
        return False
    if chained.gaps_um:
        n, worst = len(chained.gaps_um), max(chained.gaps_um)
        gaps = "1 gap" if n == 1 else f"{n} gaps"
        message = f"{drawing.file}: {gaps} of up to {worst:.3g} um closed"
        report.warning(
            "MP211", at, message, f"wider ones than {GAP_UM:g} um are refused"
        )
    return True


def _nested(
    drawing: Drawing,
    chained: Chained,
    at: Span,
    report: Report,
    *,
    apart: bool,
    least_um: float,
) -> Outline | None:
    """Return the rings as one body with holes, or with `apart` as several."""
    try:
        outline, doubled, bodies = nest(chained.rings, chained.handles)
    except BadRingsError as error:
        report.error("MP208", at, f"{drawing.file}: {error}")
        return None
    if doubled:
        message = f"{drawing.file}: {doubled} rings are drawn twice"
        report.warning("MP213", at, message, "each ring is taken once")
    if bodies > 1 and not apart:
        count = ", ".join(
            f"'{k}' {n} ({outer} outer)"
            for k, (n, outer) in _ring_counts(outline.rings).items()
        )
        message = f"{drawing.file}: {bodies} separate outlines, a part is one: "
        message += body_places(outline.rings)
        hint = f"select layers, or draw one part a file; rings by layer: {count}"
        report.error("MP209", at, message, hint)
        return None
    fits = report_size(drawing.file, drawing.units, outline, at, report, least_um)
    return outline if fits else None


def _ring_counts(rings: Sequence[Ring]) -> dict[str, tuple[int, int]]:
    """Return how many rings came from each layer, and how many of them are outer."""
    counts: dict[str, tuple[int, int]] = {}
    for ring in sorted(rings, key=lambda ring: ring.layer):
        n, outer = counts.get(ring.layer, (0, 0))
        counts[ring.layer] = n + 1, outer + (ring.signed_area_um2 > 0)
    return counts
