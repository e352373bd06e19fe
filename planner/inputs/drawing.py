"""Read a DXF drawing: layers of a file in, one outline in um out."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ezdxf.filemanagement import readfile
from ezdxf.lldxf.const import DXFError

from optics.outline import Outline, Ring
from planner.diagnostics import Report, Span
from planner.inputs.dxf_edges import Piece, Trouble, layer_counts, pieces
from planner.inputs.nesting import BadRingsError, nest
from planner.inputs.rings import OpenEnd, chain

UM_PER_UNIT = {"nm": 1e-3, "um": 1.0, "mm": 1e3, "inch": 25.4e3, "m": 1e6}
_INSUNITS = {
    1: "inch",
    2: "foot",
    4: "mm",
    5: "cm",
    6: "m",
    9: "mil",
    12: "nm",
    13: "um",
}

MAX_BYTES = 64 << 20
MIN_UM, MAX_UM = 0.5, 5e4  # extent of anything that is seen through a microscope
MAX_LISTED = 8  # findings of one kind for one drawing

# what ezdxf lets out on hostile files, beside its own exceptions
_ESCAPES = (
    DXFError, OSError, ValueError, TypeError, AttributeError, LookupError,
    ArithmeticError, RecursionError, EOFError, StopIteration, struct.error,
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawing:
    """An opened drawing and where the task asks for it."""

    file: str  # as the user knows it
    document: Any
    units: str
    at: Span  # of the file's name in the task
    layers_at: Span


def open_drawing(
    path: Path, file: str, units: str, at: Span, layers_at: Span, report: Report
) -> Drawing | None:
    """Return the drawing at `path`, or None after reporting why it cannot be read.

    Read strictly: a drawing from which the audit removes anything is refused.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            report.error("MP009", at, f"{file} is larger than {MAX_BYTES} bytes")
            return None
        path.open("rb").close()
    except OSError as error:
        report.error("MP001", at, f"cannot read {file}: {error.strerror}")
        return None
    try:
        document = readfile(path)
        before = _alive(document)
        audit = document.audit()
        lost = before - _alive(document)
    except _ESCAPES as error:
        report.error("MP201", at, f"{file} is not a readable DXF file: {error}")
        return None
    if audit.errors or lost:
        says = [entry.message for entry in (*audit.errors, *audit.fixes)]
        message = f"{file} is damaged: {'; '.join(says[:3])}"
        report.error("MP202", at, message, "save it again from the CAD program")
        return None
    drawing = Drawing(
        file=file, document=document, units=units, at=at, layers_at=layers_at
    )
    _cross_check(drawing, report)
    return drawing


def read_outline(
    drawing: Drawing, layers: Sequence[str], report: Report, at: Span | None = None
) -> Outline | None:
    """Return what `layers` of `drawing` enclose, in um; None if it was reported.

    Parameters
    ----------
    drawing : Drawing
        As `open_drawing` returned it.
    layers : sequence of str
        Their names; case does not matter, as in DXF.
    report : Report
        Receives the findings.
    at : Span, optional
        Where the layers are asked for; the drawing's own list if not given.

    Returns
    -------
    Outline or None
        One outer ring and its holes, circles and arcs kept.
    """
    at = at or drawing.layers_at
    found = _pieces(drawing, layers, at, report)
    rings = _rings(drawing, found, at, report) if found else None
    return _nested(drawing, rings, at, report) if rings else None


def _alive(document: Any) -> int:
    """Return the number of entities in all blocks, the model space among them."""
    return sum(entity.is_alive for block in document.blocks for entity in block)


def _cross_check(drawing: Drawing, report: Report) -> None:
    """Warn if the header names another unit than the task."""
    header = drawing.document.header.get("$INSUNITS", 0)
    known = _INSUNITS.get(header)
    if known not in (None, drawing.units):
        report.warning(
            "MP210",
            drawing.at,
            f"{drawing.file} says it is in {known}, the task says {drawing.units}",
            "the task's units are used",
        )


def _pieces(
    drawing: Drawing, layers: Sequence[str], at: Span, report: Report
) -> list[Piece]:
    """Return the edges on `layers`; empty after an error was reported."""
    names = frozenset(name.lower() for name in layers)
    scale = UM_PER_UNIT[drawing.units]
    try:
        counts = layer_counts(drawing.document)
        found = list(pieces(drawing.document, names, scale))
    except _ESCAPES as error:
        report.error("MP201", at, f"{drawing.file} is not a readable DXF file: {error}")
        return []
    troubles = [item for item in found if isinstance(item, Trouble)]
    _report_troubles(drawing, troubles, at, report)
    drawn = {name.lower() for name in counts}
    for name in layers:
        if name.lower() not in drawn:
            has = ", ".join(f"'{k}' {n}" for k, n in counts.items()) or "nothing"
            message = f"{drawing.file} has nothing on layer '{name}'"
            report.error("MP204", at, message, f"entities by layer: {has}")
            troubles.append(Trouble("MP204", message, ""))
    if not found and not troubles:
        message = f"{drawing.file} has only points on {', '.join(layers)}"
        report.error("MP204", at, message)
    return [] if troubles else [item for item in found if isinstance(item, Piece)]


def _report_troubles(
    drawing: Drawing, troubles: Sequence[Trouble], at: Span, report: Report
) -> None:
    """Report what cannot be taken, one finding for all that share a reason."""
    alike: dict[tuple[str, str, str], list[str]] = {}
    for t in troubles:
        alike.setdefault((t.code, t.message, t.hint), []).append(t.handle)
    for (code, message, hint), handles in alike.items():
        which = f" ({_handles(handles)})" if any(handles) else ""
        report.error(code, at, f"{drawing.file}: {message}{which}", hint)


def _rings(
    drawing: Drawing, found: Sequence[Piece], at: Span, report: Report
) -> tuple[Ring, ...] | None:
    """Return the closed rings, or None where ends are loose or branch."""
    chained = chain(found)
    if chained.doubled:
        message = f"{drawing.file}: drawn twice: {_handles(chained.doubled)}"
        report.warning("MP213", at, message, "each edge is taken once")
    if chained.branches:
        message = f"{drawing.file}: more than two edges meet at "
        report.error("MP212", at, message + _places(chained.branches))
        return None
    if chained.open:
        message = f"{drawing.file}: the outline is open at {_places(chained.open)}"
        report.error("MP205", at, message, "close it, or take the lines off the layer")
        return None
    if chained.gaps_um:
        n, worst = len(chained.gaps_um), max(chained.gaps_um)
        message = f"{drawing.file}: {n} gaps of up to {worst:.3g} um were closed"
        report.warning("MP211", at, message)
    return chained.rings


def _nested(
    drawing: Drawing, rings: Sequence[Ring], at: Span, report: Report
) -> Outline | None:
    """Return the rings as one body with holes."""
    try:
        outline, doubled, bodies = nest(rings)
    except BadRingsError as error:
        report.error("MP208", at, f"{drawing.file}: {error}")
        return None
    if doubled:
        message = f"{drawing.file}: {doubled} rings are drawn twice"
        report.warning("MP213", at, message, "each ring is taken once")
    if bodies > 1:
        count = ", ".join(f"'{k}' {n}" for k, n in _ring_counts(outline).items())
        message = f"{drawing.file}: {bodies} separate outlines, a part is one"
        report.error("MP209", at, message, f"select layers; rings by layer: {count}")
        return None
    return outline if _sensible(drawing, outline, at, report) else None


def _sensible(drawing: Drawing, outline: Outline, at: Span, report: Report) -> bool:
    """Report an extent that no microscope job has, with the unit that would fit."""
    x0, y0, x1, y1 = outline.bounds_um
    extent = max(x1 - x0, y1 - y0)
    if MIN_UM <= extent <= MAX_UM:
        return True
    raw = extent / UM_PER_UNIT[drawing.units]
    fits = [unit for unit, um in UM_PER_UNIT.items() if MIN_UM <= raw * um <= MAX_UM]
    message = (
        f"{drawing.file} is {extent:.6g} um large when read in {drawing.units}, "
        f"allowed {MIN_UM:g} to {MAX_UM:g}"
    )
    hint = f"is it drawn in {' or '.join(fits)}?" if fits else ""
    report.error("MP216", at, message, hint)
    return False


def _ring_counts(outline: Outline) -> dict[str, int]:
    """Return how many rings came from each layer."""
    names = sorted(ring.layer for ring in outline.rings)
    return {name: names.count(name) for name in names}


def _places(ends: Sequence[OpenEnd]) -> str:
    """Return coordinates and handles of loose ends, the first few."""
    said = [f"({e.x_um:.6g}, {e.y_um:.6g}) um (#{e.handle})" for e in ends[:MAX_LISTED]]
    more = len(ends) - len(said)
    return ", ".join(said) + (f" and {more} more" if more else "")


def _handles(handles: Sequence[str]) -> str:
    """Return the handles of entities, the first few."""
    more = ", ..." if len(handles) > MAX_LISTED else ""
    return ", ".join(f"#{h}" for h in handles[:MAX_LISTED]) + more
