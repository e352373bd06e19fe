"""A tiny GDSII writer: whole files from records, also such as no program writes."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

Points = Sequence[tuple[int, int]]

NM = (1e-3, 1e-9)  # a database unit of 1 nm, a user unit of 1 um
SQUARE = ((0, 0), (10_000, 0), (10_000, 10_000), (0, 10_000))  # 10 um


def record(kind: int, data_type: int, body: bytes = b"") -> bytes:
    """Return one record; an odd body gets the zero that texts get."""
    body += bytes(len(body) % 2)
    return struct.pack(">HBB", len(body) + 4, kind, data_type) + body


def real8(value: float) -> bytes:
    """Return a number as an eight-byte real."""
    if not value:
        return bytes(8)
    mantissa, exponent = math.frexp(abs(value))
    sixteens = math.ceil(exponent / 4)
    word = round(math.ldexp(mantissa, 56 + exponent - 4 * sixteens))
    return struct.pack(">Q", (value < 0) << 63 | (sixteens + 64) << 56 | word)


def library(*structures: bytes, units: tuple[float, float] = NM) -> bytes:
    """Return a whole file."""
    return (
        record(0x00, 2, struct.pack(">h", 600))
        + record(0x01, 2, bytes(24))
        + record(0x02, 6, b"LIB")
        + record(0x03, 5, real8(units[0]) + real8(units[1]))
        + b"".join(structures)
        + record(0x04, 0)
    )


def cell(name: str, *elements: bytes) -> bytes:
    """Return one structure."""
    begin = record(0x05, 2, bytes(24)) + record(0x06, 6, name.encode("ascii"))
    return begin + b"".join(elements) + record(0x07, 0)


def boundary(points: Points, layer: int = 1, datatype: int = 0) -> bytes:
    """Return a polygon; its first point is repeated at the end."""
    closed = [*points, points[0]]
    return element(0x08, short(0x0D, layer), short(0x0E, datatype), xy(closed))


def box(points: Points, layer: int = 1, boxtype: int = 0) -> bytes:
    """Return a box of four corners."""
    closed = [*points, points[0]]
    return element(0x2D, short(0x0D, layer), short(0x2E, boxtype), xy(closed))


def path(
    points: Points, width: int, path_type: int = 0, *, layer: int = 1,
    ends: tuple[int, int] | None = None,
) -> bytes:  # fmt: skip
    """Return a path; `ends` are the extensions of type 4."""
    extra = [] if ends is None else [long(0x30, ends[0]), long(0x31, ends[1])]
    return element(
        0x09, short(0x0D, layer), short(0x0E, 0), short(0x21, path_type),
        long(0x0F, width), *extra, xy(points),
    )  # fmt: skip


def sref(
    name: str, at: tuple[int, int] = (0, 0), *, mag: float = 1.0, angle: float = 0.0,
    mirrored: bool = False,
) -> bytes:  # fmt: skip
    """Return a structure placed once."""
    how = transform(mag=mag, angle=angle, mirrored=mirrored)
    return element(0x0A, record(0x12, 6, name.encode("ascii")), how, xy([at]))


def aref(
    name: str, at: tuple[int, int], counts: tuple[int, int],
    steps: tuple[tuple[int, int], tuple[int, int]], *,
    mag: float = 1.0, angle: float = 0.0, mirrored: bool = False,
) -> bytes:  # fmt: skip
    """Return a structure placed in columns and rows, `steps` from each to the next."""
    (columns, rows), ((cx, cy), (rx, ry)) = counts, steps
    corners = [
        at,
        (at[0] + columns * cx, at[1] + columns * cy),
        (at[0] + rows * rx, at[1] + rows * ry),
    ]
    return element(
        0x0B, record(0x12, 6, name.encode("ascii")),
        transform(mag=mag, angle=angle, mirrored=mirrored),
        record(0x13, 2, struct.pack(">2h", columns, rows)), xy(corners),
    )  # fmt: skip


def text(words: str, layer: int = 1) -> bytes:
    """Return a label."""
    string = record(0x19, 6, words.encode("ascii"))
    return element(0x0C, short(0x0D, layer), short(0x16, 0), xy([(0, 0)]), string)


def node(layer: int = 1) -> bytes:
    """Return a node."""
    return element(0x15, short(0x0D, layer), short(0x2A, 0), xy([(0, 0)]))


def transform(*, mag: float, angle: float, mirrored: bool, bits: int = 0) -> bytes:
    """Return STRANS with magnification and angle where they say something."""
    strans = record(0x1A, 1, struct.pack(">H", mirrored << 15 | bits))
    scaled = record(0x1B, 5, real8(mag)) if mag != 1.0 else b""
    return strans + scaled + (record(0x1C, 5, real8(angle)) if angle else b"")


def element(kind: int, *records: bytes) -> bytes:
    """Return the records of an element between its first and ENDEL."""
    return record(kind, 0) + b"".join(records) + record(0x11, 0)


def short(kind: int, value: int) -> bytes:
    """Return a record of one two-byte number."""
    return record(kind, 2, struct.pack(">H", value))


def long(kind: int, value: int) -> bytes:
    """Return a record of one four-byte integer."""
    return record(kind, 3, struct.pack(">i", value))


def xy(points: Points) -> bytes:
    """Return the coordinates."""
    numbers = [c for point in points for c in point]
    return record(0x10, 3, struct.pack(f">{len(numbers)}i", *numbers))


def ring(radius: int, corners: int, at: tuple[int, int] = (0, 0)) -> Points:
    """Return corners on a circle, rounded to the grid."""
    angles = [math.tau * k / corners for k in range(corners)]
    return [
        (round(at[0] + radius * math.cos(a)), round(at[1] + radius * math.sin(a)))
        for a in angles
    ]
