"""Drawings read from files, as a task reads them."""

from __future__ import annotations

from pathlib import Path

from microplan.planner.drawings.dxf.drawing import MAX_BYTES, Drawing, load_drawing
from microplan.planner.drawings.gds.drawing import GdsDrawing, load_gds
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.files import read_bytes


def open_drawing(
    path: Path, file: str, units: str, at: Span, layers_at: Span, report: Report
) -> Drawing | None:
    """Return the DXF drawing at `path`, None if why not was reported."""
    data = read_bytes(path, file, at, report, most=MAX_BYTES)
    if data is None:
        return None
    return load_drawing(data, file, units, at, layers_at, report)


def open_gds(
    path: Path, file: str, units: str, cell: str | None,
    at: Span, layers_at: Span, cell_at: Span, report: Report,
) -> GdsDrawing | None:  # fmt: skip
    """Return the GDSII drawing at `path`, None if why not was reported."""
    data = read_bytes(path, file, at, report, most=MAX_BYTES)
    if data is None:
        return None
    return load_gds(data, file, units, cell, at, layers_at, cell_at, report)
