"""DXF entities as edges in um: what the selected layers of a model space draw.

Block definitions are walked with affine maps of our own, nothing is exploded before it
is needed, and the whole is weighed before any of it is expanded.
"""

from __future__ import annotations

import cmath
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from microplan.optics.outline.outline import JOIN_UM, Arc, Edge
from microplan.planner.drawings.affine import Affine
from microplan.planner.drawings.biarcs import TooManyError
from microplan.planner.drawings.dxf.blocks import (
    EndlessError,
    Weights,
    copies,
    hidden,
    inherited,
    wanted_weight,
    weigh,
)
from microplan.planner.drawings.dxf.curves import Line, Shape
from microplan.planner.drawings.dxf.entities import READERS, from_behind, read_entity
from microplan.planner.drawings.dxf.file import Block, DamagedError, DxfFile, Entity
from microplan.planner.drawings.dxf.paths import Path, UnreadableError
from microplan.planner.drawings.pieces import Drawn, Piece, Trouble

FAR_UM = 1e9  # a kilometre: beyond it doubles no longer resolve JOIN_UM well
MAX_ENTITIES = 20_000  # with vertices, blocks expanded; 5 kB can ask for 1e9
MAX_ARCS = 20_000  # of curves: `benchmarks.robustness.hostile` says what they cost

_INEXACT = ("MP203", "MP214")  # nothing is damaged, but there is no exact reading

# written on drawings, no part of what is drawn
ANNOTATION = frozenset(
    (
        "TEXT", "MTEXT", "ATTRIB", "ATTDEF", "RTEXT", "ARCALIGNEDTEXT", "DIMENSION",
        "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION", "LEADER", "MULTILEADER", "MLEADER",
        "TOLERANCE", "ACAD_TABLE", "POINT", "VIEWPORT", "IMAGE", "WIPEOUT", "OLEFRAME",
        "OLE2FRAME", "PDFUNDERLAY", "DWFUNDERLAY", "DGNUNDERLAY", "XLINE", "RAY",
        "LIGHT", "SUN", "SECTION",
    )
)  # fmt: skip


def draw(file: DxfFile, layers: frozenset[str], scale_um: float) -> Drawn:
    """Return what `layers` of the model space hold, blocks expanded.

    Parameters
    ----------
    file : DxfFile
        As it was read.
    layers : frozenset of str
        Layer names, lower case as DXF compares them.
    scale_um : float
        um per drawing unit.

    Returns
    -------
    Drawn
        With troubles instead of pieces where something cannot be taken.
    """
    drawn = Drawn()
    try:
        weights = weigh(file, layers)
    except EndlessError as error:
        drawn.troubles.append(Trouble("MP217", str(error), "redraw the block"))
        return drawn
    except DamagedError as error:
        drawn.troubles.append(Trouble("MP202", str(error), "save the drawing again"))
        return drawn
    if weights.model > MAX_ENTITIES:
        message = (
            f"{weights.model} entities and vertices with blocks expanded, "
            f"at most {MAX_ENTITIES}"
        )
        hint = "draw fewer or smaller arrays"
        drawn.troubles.append(Trouble("MP215", message, hint))
        return drawn
    walk = _BlockWalk(file, layers, weights, drawn)
    for entity in file.model:
        walk.visit(entity, "0", Affine(complex(scale_um)))
    for entity in file.paper:
        if entity.layer.lower() in layers and entity.kind in READERS:
            drawn.skipped[entity.layer, f"{entity.kind} in paper space"] += 1
    _settle_hatches(drawn)
    return drawn


def _settle_hatches(drawn: Drawn) -> None:
    """Leave hatches out, read or not, where there are lines; else take them."""
    if not drawn.pieces:
        drawn.pieces, drawn.hatched = drawn.hatched, []
        drawn.troubles += [trouble for _, trouble in drawn.unread]
        return
    beside = Counter(layer for layer, _ in drawn.unread)
    for layer, kind in [key for key in drawn.taken if key[1] == "HATCH"]:
        beside[layer] += drawn.taken.pop((layer, kind))
    for layer, count in beside.items():
        drawn.skipped[layer, "HATCH beside linework"] += count


@dataclass(frozen=True, slots=True)
class _BlockWalk:
    """A traversal of blocks that collects pieces and troubles."""

    file: DxfFile
    layers: frozenset[str]
    weights: Weights
    drawn: Drawn
    # entities of a block that matter, by its name and whether layer "0" is selected
    matter: dict[tuple[str, bool], tuple[Entity, ...]] = field(default_factory=dict)

    def visit(self, entity: Entity, own: str, frame: Affine) -> None:
        """Take an entity in a block that was inserted on layer `own`."""
        layer = inherited(entity.layer, own)
        if entity.kind == "INSERT":
            self._insert(entity, layer, frame)
        elif layer.lower() in self.layers:
            why = self._hidden(entity, layer)
            if why or entity.kind in ANNOTATION:
                self.drawn.skipped[layer, f"{entity.kind}{why}"] += 1
            else:
                self._take(entity, layer, frame)

    def _hidden(self, entity: Entity, layer: str) -> str:
        """Return why an entity is not seen, "" if it is."""
        insert = entity.kind == "INSERT"
        return hidden(self.file, layer, invisible=entity.invisible, insert=insert)

    def _insert(self, insert: Entity, own: str, frame: Affine) -> None:
        """Take every copy of a block."""
        for part in insert.parts:
            layer = inherited(part.layer, own)
            if layer.lower() in self.layers:
                self.drawn.skipped[layer, part.kind] += 1
        block = self.file.blocks[insert.text(2).lower()]
        if not wanted_weight(self.weights, block, own, self.layers):
            return
        if why := self._hidden(insert, own):
            self.drawn.skipped[own, f"INSERT{why}"] += 1
            return
        try:
            frames = list(_frames(insert, block, frame))
        except (ValueError, OverflowError) as error:
            message = f"block '{block.name}' cannot be placed: {error}"
            trouble = Trouble("MP214", message, "redraw or explode it", insert.label)
            self.drawn.troubles.append(trouble)
            return
        for whole in frames:
            for entity in self._mattering(block, own):
                self.visit(entity, own, whole)

    def _mattering(self, block: Block, own: str) -> tuple[Entity, ...]:
        """Return what of a block is on selected layers or leads to them."""
        key = block.name.lower(), own.lower() in self.layers
        if key not in self.matter:
            self.matter[key] = tuple(
                entity for entity in block.entities if self._matters(entity, own)
            )
        return self.matter[key]

    def _matters(self, entity: Entity, own: str) -> bool:
        layer = inherited(entity.layer, own)
        if entity.kind != "INSERT" or entity.parts:
            return entity.kind == "INSERT" or layer.lower() in self.layers
        block = self.file.blocks[entity.text(2).lower()]
        return wanted_weight(self.weights, block, layer, self.layers) > 0

    def _take(self, entity: Entity, layer: str, frame: Affine) -> None:
        """Write down the pieces of one entity, or why it cannot be taken."""
        drawn = self.drawn
        if entity.kind not in READERS:
            message = f"{entity.kind} on layer '{layer}' cannot be read"
            hint = "redraw it as " + ", ".join(sorted(READERS)) + ", or leave it out"
            drawn.troubles.append(Trouble("MP203", message, hint, entity.label))
            return
        try:
            found = list(self._pieces(entity, layer, frame))
        except (ValueError, OverflowError, ZeroDivisionError) as error:
            trouble = _trouble(entity, layer, error)
            if entity.kind == "HATCH" and trouble.code in _INEXACT:
                drawn.unread.append((layer, trouble))
            else:
                drawn.troubles.append(trouble)
            return
        if found:
            drawn.taken[layer, entity.kind] += 1
        else:
            drawn.skipped[layer, f"{entity.kind} without length"] += 1
        (drawn.hatched if entity.kind == "HATCH" else drawn.pieces).extend(found)

    def _pieces(self, entity: Entity, layer: str, frame: Affine) -> Iterator[Piece]:
        """Yield the pieces of one entity."""
        if from_behind(entity):
            frame = frame.of(_BEHIND)
        label = entity.label
        for path in read_entity(entity):
            _refuse_rise(path, frame)
            if path.stroke and label not in self.drawn.strokes:
                self.drawn.strokes.append(label)
            rows = [self._edges(shape.under(frame)) for shape in path.shapes]
            curved = any(near for _, near in rows)
            kept = [(tuple(e for e in row if e.length_um > JOIN_UM), near)
                    for row, near in rows]  # fmt: skip
            if path.closed:
                ring = tuple(edge for row, _ in kept for edge in row)
                if ring:
                    yield Piece(ring, True, layer, label, curved)  # noqa: FBT003
                continue
            for row, near in kept:
                if row:
                    yield Piece(row, False, layer, label, near)  # noqa: FBT003

    def _edges(self, shape: Shape) -> tuple[list[Edge], bool]:
        """Return a shape's edges, and whether they are only near it."""
        try:
            edges = shape.edges(MAX_ARCS - self.drawn.arc_count)
        except TooManyError:
            self.drawn.arc_count = MAX_ARCS  # the rest need not be tried as far
            raise
        if len(edges) > 1:
            self.drawn.arc_count += len(edges)
        for edge in edges:
            _refuse_far(edge)
        near = not isinstance(shape, Line) and len(edges) > 1
        return edges, near and any(isinstance(edge, Arc) for edge in edges)


_BEHIND = Affine(0j, -1 + 0j)  # x is reversed


def _frames(insert: Entity, block: Block, frame: Affine) -> Iterator[Affine]:
    """Yield the map from a block's coordinates for every copy of it."""
    if block.external:
        raise ValueError("it is a reference to another file")
    sx, sy = insert.number(41, 1.0), insert.number(42, 1.0)
    if not sx or not sy:
        raise ValueError(f"it is scaled {sx:g} x {sy:g}")
    if from_behind(insert):
        frame = frame.of(_BEHIND)
    turn = cmath.rect(1.0, math.radians(insert.number(50, 0.0)))
    inner = Affine(turn).of(Affine.scale(sx, sy)).of(Affine(t=-block.base))
    at = insert.point(10)
    dx, dy = insert.number(44, 0.0), insert.number(45, 0.0)
    columns, rows = copies(insert)
    for row in range(rows):
        for column in range(columns):
            shift = at + turn * complex(column * dx, row * dy)
            yield frame.of(Affine(t=shift)).of(inner)


def _refuse_rise(path: Path, frame: Affine) -> None:
    """Raise ValueError for a path that leaves the drawing's plane."""
    if path.rise * frame.stretch > JOIN_UM:
        raise ValueError(f"it runs from one height to another {path.rise:g} above")


def _refuse_far(edge: Edge) -> None:
    """Raise ValueError for an edge that no drawing of a part can hold."""
    points = [edge.start, edge.end]
    if isinstance(edge, Arc):
        points += [edge.center, (edge.radius_um, 0.0)]
    far = max(abs(c) for point in points for c in point)
    if far > FAR_UM:
        raise ValueError(f"it reaches to {far:.3g} um, at most {FAR_UM:g}")


def _trouble(entity: Entity, layer: str, error: Exception) -> Trouble:
    """Return why an entity cannot be taken."""
    what = f"{entity.kind} on layer '{layer}'"
    if isinstance(error, UnreadableError):
        hint = "redraw it as lines and arcs, or leave it out"
        return Trouble("MP203", f"{what} cannot be read: {error}", hint, entity.label)
    if isinstance(error, DamagedError):
        hint = "save it again from the CAD program"
        return Trouble("MP202", f"{what} is damaged: {error}", hint, entity.label)
    if isinstance(error, TooManyError):
        return Trouble("MP215", f"{what}: {error}", "draw less", entity.label)
    hint = "redraw or delete it"
    return Trouble("MP214", f"{what} is no outline: {error}", hint, entity.label)
