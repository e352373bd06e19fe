"""What each drawing of a folder gives: `python -m benchmarks.drawings FOLDER`.

Every DXF file is read as if drawn in um, all layers together and, if there are several,
each by itself. Areas are compared with a second road: ezdxf's own entities, cut into
chords and put together by shapely.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import shapely

from optics.outline import Arc, Outline
from planner.diagnostics import Report, Span
from planner.inputs.drawing import Drawing, open_drawing, read_outline
from planner.inputs.dxf_census import by_layer, held

CHORD = 1e-5  # of the second road, drawing units


def main() -> None:
    """Print a table of what the drawings of a folder give."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    print("| file | layers | size um | area um2 | off by | holes | circles, um | why |")
    print("|---|---|---|---|---|---|---|---|")
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() == ".dxf":
            for row in rows(path):
                print("| " + " | ".join(row) + " |", flush=True)


def rows(path: Path) -> Iterator[tuple[str, ...]]:
    """Yield what a drawing gives: all layers, then those that are parts alone."""
    name = called(path)
    at, report = Span(file=name), Report()
    drawing = open_drawing(path, name, "um", at, at, report)
    if drawing is None:
        yield name, "", *[""] * 5, said(report)
        return
    names = list(by_layer(held(drawing.document)[0]))
    yield row(path, drawing, names)
    if len(names) > 1:
        for layer in names:
            alone = row(path, drawing, [layer])
            if alone[2]:
                yield alone


def row(path: Path, drawing: Drawing, names: list[str]) -> tuple[str, ...]:
    """Return what some layers of a drawing give."""
    report = Report()
    outline = read_outline(drawing, names, report)
    layers = ", ".join(names)
    if outline is None:
        return called(path), layers, *[""] * 5, said(report)
    x0, y0, x1, y1 = outline.bounds_um
    area = outline.area_um2
    off = abs(other_area(path, names) / area - 1)
    return (
        called(path), layers, f"{x1 - x0:.6g} x {y1 - y0:.6g}", f"{area:.7g}",
        f"{off:.0e}", f"{len(outline.rings) - 1}", circles(outline), said(report),
    )  # fmt: skip


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
