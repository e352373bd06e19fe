"""Read a drawing of any format: which one it is, its first bytes say."""

from __future__ import annotations

from collections.abc import Sequence

from optics.outline import Outline
from planner.diagnostics import Report, Span
from planner.inputs.drawing import MAX_BYTES, Drawing, load_drawing
from planner.inputs.drawing import read_drawn as read_dxf
from planner.inputs.files import named_file, read_bytes
from planner.inputs.gds_drawing import GdsDrawing, load_gds, read_gds_outline
from planner.inputs.schema import Checked
from planner.inputs.source import Key

AnyDrawing = Drawing | GdsDrawing

_GDS = b"\x00\x06\x00\x02"  # a HEADER record of six bytes
_OASIS = b"%SEMI-OASIS"
_GZIP = b"\x1f\x8b"
_GDS_NAMES = (".gds", ".gdsii", ".gds2", ".gz")


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


def read_drawn(
    drawing: AnyDrawing, layers: Sequence[str], report: Report, at: Span | None = None
) -> tuple[Outline, float] | None:
    """Return what `layers` enclose and the drawing's largest chord error, um.

    None if why not was reported; the error is 0 where curves are curves.
    """
    if isinstance(drawing, GdsDrawing):
        return read_gds_outline(drawing, layers, report, at)
    return read_dxf(drawing, layers, report, at)
