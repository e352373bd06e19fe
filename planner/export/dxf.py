"""Predicted outlines as DXF contours for shape matching: AutoCAD R12, polylines."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from io import StringIO

from ezdxf._options import options
from ezdxf.document import Drawing

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
_FIRST = "  9\n$DWGCODEPAGE\n"  # a variable of every header


def dxf(outlines: Outlines, look: LookOutlines) -> bytes:
    """Return a DXF file with one look's pieces, in um in the target's frame.

    AutoCAD R12 (AC1009), which is what HALCON's `read_contour_xld_dxf` asks for. Each
    piece is one POLYLINE with the material on its left, on a layer named after its
    polarity; its extended data hold contrast and polarity. The same look gives the
    same bytes.
    """
    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True  # neither time nor version
    try:
        drawn = _drawn(look)
    finally:
        options.write_fixed_meta_data_for_testing = before
    comments = "".join(f"999\n{_text(line)}\n" for line in _comments(outlines, look))
    # ezdxf writes no units into R12, though programs read them there
    units = f"  9\n$INSUNITS\n 70\n{MICRONS}\n{_FIRST}"
    return f"{comments}{drawn.replace(_FIRST, units, 1)}".encode("ascii")


def _drawn(look: LookOutlines) -> str:
    """Return the text of a drawing with a polyline for each piece."""
    document = Drawing.new("R12")
    document.appids.add(APPLICATION)
    for name, colour in LAYERS.values():
        document.layers.add(name, color=colour)
    space, chord_um = document.modelspace(), CHORD_PX * look.um_per_px
    for piece in look.pieces:
        corners = [(_digits(x), _digits(y)) for x, y in points_um(piece, chord_um)]
        layer = {"layer": LAYERS[piece.polarity][0]}
        line = space.add_polyline2d(corners, close=piece.closed, dxfattribs=layer)
        line.set_xdata(APPLICATION, _extended(piece))
    stream = StringIO()
    document.write(stream)
    return stream.getvalue()


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


def _comments(outlines: Outlines, look: LookOutlines) -> Iterator[str]:
    """Yield what a reader of the file as text wants to know."""
    yield f"microplan: look {look.look} of plan {outlines.plan}, simulated"
    yield f"target {look.target}, its frame, um, y up"
    yield f"plan {outlines.status}; image sha256 {look.image_sha256}"
    yield f"{look.um_per_px:.9g} um per px"
    yield (
        f"origin at column {look.column_px:.9g} px, row {look.row_px:.9g} px, "
        f"turned by {math.degrees(look.pose.theta_rad):.9g} deg"
    )


def _extended(piece: EdgePiece) -> list[tuple[int, str | float]]:
    """Return names and values of what is predicted of a piece."""
    return [
        (1000, "polarity"), (1000, piece.polarity),
        (1000, "contrast"), (1040, _digits(piece.contrast)),
        (1000, "least_contrast"), (1040, _digits(piece.least_contrast)),
        (1000, "body"), (1000, _text(piece.body)),
    ]  # fmt: skip


def _digits(value: float) -> float:
    """Return a number with nine digits: the same on every machine."""
    return float(f"{value:.9g}") + 0.0


def _text(text: str) -> str:
    """Return text in ASCII: other characters as R12 has them, \\U+XXXX."""
    plain = "".join(
        c if " " <= c <= "~" else f"\\U+{ord(c):04X}" for c in text if ord(c) < 1 << 16
    )
    return plain[:_MOST_TEXT]
