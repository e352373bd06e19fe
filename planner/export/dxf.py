"""Predicted outlines as DXF contours for shape matching: AutoCAD R12, polylines."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from microplan.optics.outline.outline import Arc, Edge, Segment, chords
from microplan.schemas.files.outlines import (
    ArcEdge,
    EdgePiece,
    LookOutlines,
    Outlines,
    Polarity,
    SegmentEdge,
)

# name and AutoCAD colour: green, red, grey
LAYERS: Mapping[Polarity, tuple[str, int]] = {
    "dark_to_light": ("DARK_TO_LIGHT", 3),
    "light_to_dark": ("LIGHT_TO_DARK", 1),
    "unclear": ("UNCLEAR", 8),
}
APPLICATION = "MICROPLAN"  # whose extended data the polylines carry
CHORD_PX = 0.02  # sagitta of the chords of arcs: what the finest matching may notice
MICRONS = 13  # $INSUNITS
_MOST_TEXT = 255  # bytes of a string in extended data

Tag = tuple[int, object]


def dxf(outlines: Outlines, look: LookOutlines) -> bytes:
    """Return a DXF file with one look's pieces, in um in the target's frame.

    AutoCAD R12 (AC1009), which is what HALCON's `read_contour_xld_dxf` asks for. Each
    piece is one POLYLINE with the material on its left, on a layer named after its
    polarity; its extended data hold contrast and polarity.
    """
    tags = [
        *_comments(outlines, look),
        *_header(),
        *_tables(),
        *_section("ENTITIES", _entities(look)),
        (0, "EOF"),
    ]
    return "".join(f"{code:>3}\n{_value(value)}\n" for code, value in tags).encode()


def points_um(piece: EdgePiece, chord_um: float) -> list[tuple[float, float]]:
    """Return a piece as corners of a polyline, the last of a closed one left out."""
    found = [point for edge in piece.edges for point in _corners(edge, chord_um)]
    return found if piece.closed else [*found, _edge(piece.edges[-1]).end]


def _corners(edge: SegmentEdge | ArcEdge, chord_um: float) -> list[tuple[float, float]]:
    """Return where the chords of an edge begin."""
    drawn = _edge(edge)
    if isinstance(drawn, Segment):
        return [drawn.start]
    count = chords(drawn, chord_um)
    return [drawn.at(k / count) for k in range(count)]


def _edge(edge: SegmentEdge | ArcEdge) -> Edge:
    if isinstance(edge, SegmentEdge):
        return Segment(start=edge.start_um, end=edge.end_um)
    return Arc(
        center=edge.center_um,
        radius_um=edge.radius_um,
        start_rad=edge.start_rad,
        sweep_rad=edge.sweep_rad,
    )


def _comments(outlines: Outlines, look: LookOutlines) -> Iterator[Tag]:
    """Yield what a reader of the file as text wants to know."""
    pose = look.pose
    yield 999, f"microplan: look {look.look} of plan {outlines.plan}, simulated"
    yield 999, f"target {look.target}, its frame, um, y up"
    yield 999, f"plan {outlines.status}; image sha256 {look.image_sha256}"
    yield 999, f"{look.um_per_px:.9g} um per px"
    yield (
        999,
        (
            f"origin at column {look.column_px:.9g} px, row {look.row_px:.9g} px, "
            f"turned by {math.degrees(pose.theta_rad):.9g} deg"
        ),
    )


def _header() -> Iterator[Tag]:
    yield from _section(
        "HEADER",
        iter([(9, "$ACADVER"), (1, "AC1009"), (9, "$INSUNITS"), (70, MICRONS)]),
    )


def _tables() -> Iterator[Tag]:
    """Yield the layers, and the name that extended data stand under."""
    layers: list[Tag] = []
    for name, colour in LAYERS.values():
        layers += [(0, "LAYER"), (2, name), (70, 0), (62, colour), (6, "CONTINUOUS")]
    line: list[Tag] = [(0, "LTYPE"), (2, "CONTINUOUS"), (70, 0), (3, "Solid line")]
    line += [(72, 65), (73, 0), (40, 0.0)]
    application: list[Tag] = [(0, "APPID"), (2, APPLICATION), (70, 0)]
    yield from _section(
        "TABLES",
        iter(
            [
                *_table("LTYPE", 1, line),
                *_table("LAYER", len(LAYERS), layers),
                *_table("APPID", 1, application),
            ]
        ),
    )


def _table(name: str, count: int, rows: list[Tag]) -> list[Tag]:
    return [(0, "TABLE"), (2, name), (70, count), *rows, (0, "ENDTAB")]


def _section(name: str, tags: Iterator[Tag]) -> Iterator[Tag]:
    yield 0, "SECTION"
    yield 2, name
    yield from tags
    yield 0, "ENDSEC"


def _entities(look: LookOutlines) -> Iterator[Tag]:
    """Yield a polyline a piece."""
    chord_um = CHORD_PX * look.um_per_px
    for piece in look.pieces:
        layer, _ = LAYERS[piece.polarity]
        yield from ((0, "POLYLINE"), (8, layer), (66, 1))
        yield from ((10, 0.0), (20, 0.0), (30, 0.0), (70, int(piece.closed)))
        yield from _extended(piece)
        for x, y in points_um(piece, chord_um):
            yield from ((0, "VERTEX"), (8, layer), (10, x), (20, y), (30, 0.0))
        yield from ((0, "SEQEND"), (8, layer))


def _extended(piece: EdgePiece) -> Iterator[Tag]:
    """Yield names and values of what is predicted of a piece."""
    yield 1001, APPLICATION
    yield from ((1000, "polarity"), (1000, piece.polarity))
    yield from ((1000, "contrast"), (1040, piece.contrast))
    yield from ((1000, "least_contrast"), (1040, piece.least_contrast))
    yield from ((1000, "body"), (1000, piece.body))


def _value(value: object) -> str:
    """Return a value as its line has it: numbers with nine digits, text in ASCII."""
    if isinstance(value, (float, np.floating)):
        return f"{value + 0.0:.9g}"
    text = str(value)
    plain = "".join(
        c if " " <= c <= "~" else f"\\U+{ord(c):04X}" for c in text if ord(c) < 1 << 16
    )
    return plain[:_MOST_TEXT]
