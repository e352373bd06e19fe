"""Write DXF files as text, tag by tag: the corpus that the reader is tried on."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Sequence

from microplan.arrays import Point

Tags = list[tuple[int, object]]

# the markers that files from R13 on put before the tags of an entity
_MARKS = {
    "LINE": "AcDbLine", "CIRCLE": "AcDbCircle", "ARC": "AcDbCircle",
    "ELLIPSE": "AcDbEllipse", "LWPOLYLINE": "AcDbPolyline", "SPLINE": "AcDbSpline",
    "POLYLINE": "AcDb2dPolyline", "SOLID": "AcDbTrace", "TRACE": "AcDbTrace",
    "HATCH": "AcDbHatch", "INSERT": "AcDbBlockReference", "3DFACE": "AcDbFace",
    "TEXT": "AcDbText", "VERTEX": "AcDbVertex", "SEQEND": "",
}  # fmt: skip


def dxf(
    *entities: Tags,
    blocks: Iterable[tuple[str, Point, Sequence[Tags]]] = (),
    layers: Iterable[tuple[str, int, int]] = (),
    units: int = 13,
) -> str:
    """Return a file; blocks are (name, base, entities), layers (name, flags, color)."""
    tags: Tags = [(0, "SECTION"), (2, "HEADER"), (9, "$INSUNITS"), (70, units)]
    tags += [(0, "ENDSEC"), (0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LAYER")]
    for name, flags, color in layers:
        tags += [(0, "LAYER"), (2, name), (70, flags), (62, color)]
    tags += [(0, "ENDTAB"), (0, "ENDSEC"), (0, "SECTION"), (2, "BLOCKS")]
    for name, base, inner in blocks:
        tags += [(0, "BLOCK"), (2, name), (70, 0), *xy(10, base), (3, name)]
        for entity in inner:
            tags += entity
        tags += [(0, "ENDBLK")]
    tags += [(0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES")]
    for entity in entities:
        tags += entity
    tags += [(0, "ENDSEC"), (0, "EOF")]
    return tags_text(tags)


def tags_text(tags: Tags) -> str:
    """Return tags as the lines of a file."""
    return "".join(f"{code:>3}\n{value}\n" for code, value in tags)


def dressed(text: str) -> str:
    """Return a file as R2000, with the handles and markers of entities."""
    lines = text.splitlines()
    out: list[tuple[object, str]] = []
    pairs = [
        (int(code), value) for code, value in zip(lines[::2], lines[1::2], strict=True)
    ]
    kind = ""
    for at, (code, value) in enumerate(pairs):
        out.append((code, value))
        if code == 2 and value == "HEADER":
            out += [(9, "$ACADVER"), (1, "AC1015")]
        elif code == 0 and (value in _MARKS or value in ("BLOCK", "ENDBLK")):
            kind = value
            out += [(5, f"{0x100 + at:X}"), (100, "AcDbEntity")]
            if kind in ("BLOCK", "ENDBLK"):
                begin = "AcDbBlockBegin" if kind == "BLOCK" else "AcDbBlockEnd"
                out += [(8, "0"), (100, begin)]
        elif code == 8 and _MARKS.get(kind):
            out.append((100, _MARKS[kind]))
        elif code == 40 and kind == "ARC":
            out.append((100, "AcDbArc"))
    return "".join(f"{code:>3}\n{value}\n" for code, value in out)


def binary(text: str, *, short: bool) -> bytes:
    """Return a text file as a binary one; R12 has group codes of one byte."""
    out = b"AutoCAD Binary DXF\r\n\x1a\x00"
    lines = text.splitlines()
    for code, value in zip(map(int, lines[::2]), lines[1::2], strict=True):
        out += struct.pack("<B" if short else "<H", code)
        if 10 <= code < 60 or 210 <= code < 240:
            out += struct.pack("<d", float(value))
        elif 60 <= code < 80:
            out += struct.pack("<h", int(value))
        elif 90 <= code < 100:
            out += struct.pack("<i", int(value))
        else:
            out += value.encode() + b"\x00"
    return out


def xy(code: int, point: Point) -> Tags:
    """Return the tags of a point."""
    return [(code, repr(float(point[0]))), (code + 10, repr(float(point[1])))]


def entity(kind: str, *tags: tuple[int, object], layer: str = "A") -> Tags:
    """Return an entity on a layer."""
    return [(0, kind), (8, layer), *tags]


def line(start: Point, end: Point, *tags: tuple[int, object], layer: str = "A") -> Tags:
    """Return a LINE."""
    return entity("LINE", *xy(10, start), *xy(11, end), *tags, layer=layer)


def path(points: Sequence[Point], layer: str = "A", *, closed: bool = True) -> Tags:
    """Return LINEs through points."""
    ends = [*points[1:], points[0]] if closed else points[1:]
    return [
        tag
        for start, end in zip(points, ends, strict=closed)
        for tag in line(start, end, layer=layer)
    ]


def box(width: float, height: float, at: Point = (0, 0), layer: str = "A") -> Tags:
    """Return a rectangle of LINEs."""
    x, y = at
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    return path(corners, layer)


def circle(
    center: Point, radius: float, *tags: tuple[int, object], layer: str = "A"
) -> Tags:
    """Return a CIRCLE."""
    return entity("CIRCLE", *xy(10, center), (40, radius), *tags, layer=layer)


def arc(center: Point, radius: float, start: float, end: float) -> Tags:
    """Return an ARC, degrees."""
    return entity("ARC", *xy(10, center), (40, radius), (50, start), (51, end))


def ellipse(
    center: Point, major: Point, ratio: float, start: float = 0.0,
    end: float = math.tau, *tags: tuple[int, object],
) -> Tags:  # fmt: skip
    """Return an ELLIPSE."""
    numbers: Tags = [(40, ratio), (41, start), (42, end)]
    return entity("ELLIPSE", *xy(10, center), *xy(11, major), *numbers, *tags)


def lwpolyline(
    rows: Sequence[tuple[float, ...]], *tags: tuple[int, object], flags: int = 1
) -> Tags:
    """Return an LWPOLYLINE of (x, y, bulge)."""
    inner: Tags = [(90, len(rows)), (70, flags), *tags]
    for x, y, *bulge in rows:
        inner += [*xy(10, (x, y)), (42, bulge[0] if bulge else 0.0)]
    return entity("LWPOLYLINE", *inner)


def polyline(
    rows: Sequence[tuple[float, float, float, int]],
    *tags: tuple[int, object],
    flags: int = 1,
) -> Tags:
    """Return a POLYLINE of (x, y, bulge, flags)."""
    out = entity("POLYLINE", (66, 1), (70, flags), *tags)
    for x, y, bulge, flag in rows:
        out += entity("VERTEX", *xy(10, (x, y)), (30, 0.0), (42, bulge), (70, flag))
    return [*out, *entity("SEQEND")]


def spline(
    degree: int, knots: Sequence[float], points: Sequence[Point],
    weights: Sequence[float] = (), flags: int = 8,
) -> Tags:  # fmt: skip
    """Return a SPLINE."""
    tags: Tags = [(70, flags), (71, degree), (72, len(knots)), (73, len(points))]
    tags += [(40, knot) for knot in knots] + [(41, weight) for weight in weights]
    for point in points:
        tags += [*xy(10, point), (30, 0.0)]
    return entity("SPLINE", *tags)


def quad(kind: str, corners: Sequence[Point]) -> Tags:
    """Return a SOLID or TRACE, corners in the order of the file."""
    return entity(kind, *(t for k, z in enumerate(corners) for t in xy(10 + k, z)))


def insert(
    name: str, at: Point = (0, 0), *tags: tuple[int, object], layer: str = "A"
) -> Tags:
    """Return an INSERT."""
    return entity("INSERT", (2, name), *xy(10, at), *tags, layer=layer)


def hatch(*paths: Tags) -> Tags:
    """Return a HATCH with these boundary paths."""
    tags: Tags = [(10, 0.0), (20, 0.0), (30, 0.0), (2, "SOLID"), (70, 1), (71, 0)]
    tags += [(91, len(paths))]
    for inner in paths:
        tags += [*inner, (97, 0)]
    return entity("HATCH", *tags, (75, 0), (76, 1), (98, 1), *xy(10, (1, 1)))
