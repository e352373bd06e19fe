"""What each drawing of a folder gives.

`python -m benchmarks.robustness.drawings FOLDER` prints it.

Every DXF file is read as if drawn in um, all layers together and, if there are several,
each by itself; of every GDSII file each cell. Areas are compared with a second road:
ezdxf's own entities cut into chords and put together by shapely, or gdstk's polygons.
With `--compile`, those that are one part are looked for under a microscope.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ezdxf
import gdstk
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from benchmarks.executing.drawings_located import HEAD, Job, located
from microplan.optics.outline.outline import Arc, Outline
from microplan.planner.drawings.census import Taken
from microplan.planner.drawings.dxf.census import by_layer, held
from microplan.planner.drawings.dxf.drawing import (
    MAX_BYTES,
    Drawing,
    load_drawing,
    take,
)
from microplan.planner.drawings.gds.drawing import (
    GdsDrawing,
    held_gds,
    load_gds,
    take_gds,
)
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.files import read_bytes
from microplan.planner.task.second_reader import compare

CHORD = 1e-5  # of the second road, drawing units
UNITS = ("um", "mm")  # that a part is tried in, until it is MIN_UM large
MIN_UM = 10.0  # below, a light microscope shows a blot
COLUMNS = ("file", "layers", "size um", "area um2", "off by", "holes", "circles, um",
           "second reader", "why")  # fmt: skip
Opened = Drawing | GdsDrawing


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What some layers of a drawing gave."""

    path: Path
    drawing: Opened
    names: list[str]
    taken: Taken | None
    report: Report


def main() -> None:
    """Print a table of what the drawings of a folder give."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--compile", action="store_true", help="look for the parts")
    call = parser.parse_args()
    _print(HEAD if call.compile else COLUMNS)
    print("|" + "---|" * len(HEAD if call.compile else COLUMNS))
    for path in sorted(call.folder.iterdir()):
        for row in _located(path) if call.compile else rows(path):
            _print(row)


def _print(cells: tuple[str, ...] | list[str]) -> None:
    print("| " + " | ".join(cells) + " |", flush=True)


def rows(path: Path) -> Iterator[tuple[str, ...]]:
    """Yield what a drawing gives: all layers, then those that are parts alone."""
    report = Report()
    first = True
    for found in readings(path, "um", report):
        if first or found.taken is not None:
            yield row(found)
        first = False
    if first and report.found:
        yield called(path), *[""] * (len(COLUMNS) - 2), said(report)


def readings(path: Path, units: str, report: Report) -> Iterator[Found]:
    """Yield what all layers of a drawing or cell give, then each by itself."""
    for drawing in _opened(path, units, report):
        names = _names(drawing)
        yield _found(path, drawing, names)
        if len(names) > 1:
            for name in names:
                yield _found(path, drawing, [name])


def _opened(path: Path, units: str, report: Report) -> Iterator[Opened]:
    """Yield a DXF drawing, or each cell of a GDSII file; whatever else, nothing."""
    name = called(path)
    at = Span(file=name)
    data = read_bytes(path, name, at, report, most=MAX_BYTES)
    if data is None:
        return
    if path.suffix.lower() == ".dxf":
        drawing = load_drawing(data, name, units, at, at, report)
        if drawing is not None:
            yield drawing
    elif path.suffix.lower() == ".gds":
        for cell in sorted(c.name for c in gdstk.read_gds(path).cells):
            mask = load_gds(data, name, "um", cell, at, at, at, report)
            if mask is not None:
                yield mask


def _names(drawing: Opened) -> list[str]:
    """Return the layers of a drawing."""
    if isinstance(drawing, Drawing):
        return list(by_layer(held(drawing.document)[0]))
    return sorted({layer for layer, _ in held_gds(drawing)})


def _found(path: Path, drawing: Opened, names: list[str]) -> Found:
    """Return what some layers give."""
    report = Report()
    if isinstance(drawing, Drawing):
        taken = take(drawing, names, report)
    else:
        taken = take_gds(drawing, names, report)
    return Found(path=path, drawing=drawing, names=names, taken=taken, report=report)


def row(found: Found) -> tuple[str, ...]:
    """Return what some layers of a drawing give."""
    names, drawing = found.names, found.drawing
    head = called(found.path), _layers(found)
    if found.taken is None:
        return *head, *[""] * (len(COLUMNS) - 3), said(found.report)
    outline = found.taken.outline
    x0, y0, x1, y1 = outline.bounds_um
    area = outline.area_um2
    if isinstance(drawing, Drawing):
        other = other_area(found.path, names)
    else:
        other = mask_area(found.path, drawing.cell, names)
    return (
        *head, f"{x1 - x0:.6g} x {y1 - y0:.6g}", f"{area:.7g}",
        f"{abs(other / area - 1):.0e}", f"{len(outline.rings) - 1}", circles(outline),
        _second(found), said(found.report),
    )  # fmt: skip


def _layers(found: Found) -> str:
    layers = ", ".join(found.names)
    if isinstance(found.drawing, Drawing):
        return layers
    return f"{found.drawing.cell}: {layers}"


def _second(found: Found) -> str:
    """Return what the compiler's second reader says."""
    if not isinstance(found.drawing, Drawing) or found.taken is None:
        return ""
    report, drawing, taken = Report(), found.drawing, found.taken
    compare(drawing, [taken], report)
    return said(report) or "agrees"


def _located(path: Path) -> Iterator[tuple[str, ...]]:
    """Yield how each part of a drawing is found by a microscope."""
    done: set[str] = set()  # one row a cell, and one a DXF file
    for units in UNITS if path.suffix.lower() == ".dxf" else UNITS[:1]:
        for found in readings(path, units, Report()):
            name = "" if isinstance(found.drawing, Drawing) else found.drawing.cell
            if name in done or found.taken is None:
                continue
            x0, y0, x1, y1 = found.taken.outline.bounds_um
            if max(x1 - x0, y1 - y0) < MIN_UM:
                continue
            done.add(name)
            yield located(
                Job(
                    path=path, called=called(path), units=units, layers=found.names,
                    cell=name, extent_um=max(x1 - x0, y1 - y0),
                )
            )  # fmt: skip


def mask_area(path: Path, cell: str, names: list[str]) -> float:
    """Return the area of a cell's layers by gdstk, each inside the ones around it."""
    library = gdstk.read_gds(path)
    cells = [c for c in library.cells if isinstance(c, gdstk.Cell)]
    (drawn,) = (c for c in cells if c.name == cell)
    layers = [tuple(map(int, name.split("/"))) for name in names]
    area: BaseGeometry = shapely.Polygon()
    for layer in layers:
        polygons = [
            shapely.Polygon(polygon.points)
            for polygon in drawn.get_polygons()
            if (polygon.layer, polygon.datatype) == layer
        ]
        area = area.symmetric_difference(shapely.union_all(polygons))
    return float(area.area) * (library.unit / 1e-6) ** 2


def called(path: Path) -> str:
    """Return a file's name without its repository's owner, who stands before __."""
    return path.name.rpartition("__")[2]


def circles(outline: Outline) -> str:
    """Return the diameters of rings that are circles, with their numbers."""
    found = [
        f"{2 * ring.edges[0].radius_um:.6g}"
        for ring in outline.rings
        if isinstance(ring.edges[0], Arc) and ring.edges[0].is_circle
    ]
    return ", ".join(f"{found.count(d)} x {d}" for d in dict.fromkeys(found))


def said(report: Report) -> str:
    """Return the findings' codes and messages."""
    return "; ".join(
        f"{d.code} {d.message.removeprefix(d.where.file).lstrip(': ')}"
        for d in report.found
    )


def other_area(path: Path, names: list[str]) -> float:
    """Return the area that the edges of some layers enclose, by even-odd count."""
    space = ezdxf.readfile(path).modelspace()  # type: ignore[attr-defined]
    wanted = {name.lower() for name in names}
    chains = [
        [(p.x, p.y) for p in chain]
        for entity in space
        for chain in chords(entity)
        if entity.dxf.layer.lower() in wanted
    ]
    lines = [shapely.LineString(np.round(chain, 6)) for chain in chains]
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all(lines)]))
    borders = [shapely.Polygon(face.exterior) for face in faces]
    total = 0.0
    for face in faces:
        inside = face.representative_point()
        depth = sum(border.contains(inside) for border in borders)
        total += face.area * (depth % 2)
    return total


def chords(entity: Any) -> Iterator[list[Any]]:
    """Yield the corners of an entity cut into chords."""
    kind = entity.dxftype()
    if kind == "LINE":
        yield [entity.dxf.start, entity.dxf.end]
    elif kind == "CIRCLE":
        yield list(entity.flattening(min(CHORD, entity.dxf.radius / 100)))
    elif kind in ("ARC", "ELLIPSE", "SPLINE"):
        yield list(entity.flattening(CHORD))
    elif kind in ("LWPOLYLINE", "POLYLINE", "INSERT"):
        for inner in entity.virtual_entities():
            yield from chords(inner)


if __name__ == "__main__":
    main()
