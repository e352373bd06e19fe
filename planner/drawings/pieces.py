"""Pieces of outlines as drawn, with reasons why some cannot be taken."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from microplan.optics.outline.outline import Edge


@dataclass(frozen=True, slots=True)
class Piece:
    """Edges of one shape in a row; a closed piece is a ring by itself."""

    edges: tuple[Edge, ...]
    closed: bool
    layer: str
    handle: str  # or the line of a file without handles
    curved: bool = False  # its edges are near a curve, not on it


@dataclass(frozen=True, slots=True)
class Trouble:
    """Why an entity cannot be taken; those that differ in `handle` alone are one."""

    code: str
    message: str
    hint: str
    handle: str = ""


@dataclass(slots=True)
class Drawn:
    """What the selected layers draw, and what of them was left out."""

    pieces: list[Piece] = field(default_factory=list)
    hatched: list[Piece] = field(default_factory=list)  # borders of hatches
    troubles: list[Trouble] = field(default_factory=list)
    # how many entities, by layer and kind; of what was left out also why
    taken: Counter[tuple[str, str]] = field(default_factory=Counter)
    skipped: Counter[tuple[str, str]] = field(default_factory=Counter)
    strokes: list[str] = field(default_factory=list)  # handles of lines with a width
    # hatches without an exact reading, with their layers; needed only without lines
    unread: list[tuple[str, Trouble]] = field(default_factory=list)
    arc_count: int = 0  # of curves
