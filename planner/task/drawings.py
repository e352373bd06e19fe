"""Drawings of any format, recognised by their first bytes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from microplan.planner.drawings.census import LayerRow, Taken, layer_rows
from microplan.planner.drawings.dxf.census import held
from microplan.planner.drawings.dxf.drawing import MAX_BYTES, Drawing, load_drawing
from microplan.planner.drawings.dxf.drawing import take as take_dxf
from microplan.planner.drawings.gds.drawing import (
    LABELS,
    GdsDrawing,
    held_gds,
    listed,
    load_gds,
    take_gds,
)
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.files import named_file, read_bytes
from microplan.planner.source.schema import Checked
from microplan.planner.source.source import Key

AnyDrawing = Drawing | GdsDrawing

_GDS = b"\x00\x06\x00\x02"  # a HEADER record of six bytes
_OASIS = b"%SEMI-OASIS"
_GZIP = b"\x1f\x8b"
_GDS_NAMES = (".gds", ".gdsii", ".gds2", ".gz")

RELEASES = {
    "AC1009": "R12", "AC1012": "R13", "AC1014": "R14", "AC1015": "R2000",
    "AC1018": "R2004", "AC1021": "R2007", "AC1024": "R2010", "AC1027": "R2013",
    "AC1032": "R2018",
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawingSheet:
    """A drawing and everything that was taken from it for one part or tool."""

    drawing: AnyDrawing
    takes: tuple[Taken, ...]


def open_named(checked: Checked, *where: Key, report: Report) -> AnyDrawing | None:
    """Return the opened drawing of the `drawing` mapping at `where`."""
    source = checked.source
    at, layers_at = source.value(*where, "file"), source.value(*where, "layers")
    found = named_file(source.get(*where, "file"), at, source.path.parent, report)
    if found is None:
        return None
    (path, file), units = found, source.get(*where, "units")
    data = read_bytes(path, file, at, report, most=MAX_BYTES)
    if data is None:
        return None
    cell, cell_at = source.get(*where, "cell"), source.value(*where, "cell")
    if data.startswith(_OASIS):
        message = f"{file} is an OASIS file, which is not read"
        hint = "save it as GDSII, in KLayout by File, Save As, GDS2"
        report.error("MP234", at, message, hint)
        return None
    if data.startswith(_GZIP):
        report.error("MP234", at, f"{file} is compressed", "unpack it with gunzip")
        return None
    if data.startswith(_GDS) or (data and path.suffix.lower() in _GDS_NAMES):
        return load_gds(data, file, units, cell, at, layers_at, cell_at, report)
    if cell is not None:
        message = f"'cell' means nothing here: {file} is no GDSII file"
        report.error("MP109", source.key(*where, "cell"), message, "remove it")
        return None
    return load_drawing(data, file, units, at, layers_at, report)


def take(
    drawing: AnyDrawing,
    layers: Sequence[str],
    report: Report,
    at: Span | None = None,
    *,
    apart: bool = False,
) -> Taken | None:
    """Return what `layers` enclose, None if why not was reported.

    One outer ring with its holes, or with `apart` any number of them.
    """
    if isinstance(drawing, GdsDrawing):
        return take_gds(drawing, layers, report, at, apart=apart)
    return take_dxf(drawing, layers, report, at, apart=apart)


def form(drawing: AnyDrawing) -> str:
    """Return what kind of file it is, and of GDSII files the cells."""
    if isinstance(drawing, Drawing):
        version = drawing.document.version
        return f"DXF {RELEASES.get(version, version)}".rstrip()
    inner = [name for name in drawing.cells if name != drawing.cell]
    placed = f" made of {listed(inner)}" if inner else ""
    others = sorted(set(drawing.library.structures) - set(drawing.cells))
    ignored = f"; cells ignored: {listed(others)}" if others else ""
    return f"GDSII, cell '{drawing.cell}'{placed}{ignored}"


def shape_layers(drawing: AnyDrawing) -> tuple[str, ...]:
    """Return the names of all layers that hold something that is seen, sorted."""
    if isinstance(drawing, GdsDrawing):
        found = held_gds(drawing)
        return tuple(sorted({layer for layer, kind in found if kind not in LABELS}))
    seen, _ = held(drawing.document)
    # what is hidden or on paper has the reason behind its kind
    return tuple(sorted({layer for layer, kind in seen if " " not in kind}))


def rows(sheet: DrawingSheet) -> tuple[tuple[LayerRow, ...], bool]:
    """Return what became of each layer, and whether all of them were counted."""
    if isinstance(sheet.drawing, GdsDrawing):
        return layer_rows(held_gds(sheet.drawing), sheet.takes), True
    found, whole = held(sheet.drawing.document)
    return layer_rows(found, sheet.takes), whole
