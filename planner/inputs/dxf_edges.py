"""DXF entities as edges in um: lines, arcs, circles, polylines with bulges, blocks.

Block definitions are walked with an own frame, a similarity of the plane, so that
circles stay circles. `ezdxf` is asked for raw attributes only: its paths turn arcs
into cubics, 2.7e-4 of the radius off.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from optics.outline import JOIN_UM, Arc, Edge, Segment

FAR_UM = 1e9  # a kilometre: beyond it doubles no longer resolve JOIN_UM well
MAX_ENTITIES = 100_000  # blocks expanded; a file of 5 kB can ask for 1e9


@dataclass(frozen=True, slots=True)
class Piece:
    """Edges of one entity; a closed piece is a ring by itself."""

    edges: tuple[Edge, ...]
    closed: bool
    layer: str
    handle: str


@dataclass(frozen=True, slots=True)
class Trouble:
    """Why an entity cannot be taken; those that differ in `handle` alone are one."""

    code: str
    message: str
    hint: str
    handle: str = ""


@dataclass(frozen=True, slots=True)
class Frame:
    """A similarity of the plane, z -> a z + t, or a conj(z) + t if mirrored."""

    a: complex
    mirrored: bool = False
    t: complex = 0j

    def point(self, z: complex) -> complex:
        """Return the image of `z`."""
        return self.a * (z.conjugate() if self.mirrored else z) + self.t

    def of(self, inner: Frame) -> Frame:
        """Return the frame that applies `inner` first."""
        a = self.a * (inner.a.conjugate() if self.mirrored else inner.a)
        return Frame(a, self.mirrored != inner.mirrored, self.point(inner.t))

    def arc(self, center: complex, radius: float, start: float, sweep: float) -> Arc:
        """Return the image of an arc; angles in radians."""
        turn = cmath.phase(self.a)
        c = self.point(center)
        return Arc(
            center=(c.real, c.imag),
            radius_um=radius * abs(self.a),
            start_rad=turn - start if self.mirrored else turn + start,
            sweep_rad=-sweep if self.mirrored else sweep,
        )


def pieces(
    document: Any, layers: frozenset[str], scale_um: float
) -> Iterator[Piece | Trouble]:
    """Yield what `layers` of the model space hold, blocks expanded one level.

    Parameters
    ----------
    document : ezdxf document
        Audited.
    layers : frozenset of str
        Layer names, lower case as DXF compares them.
    scale_um : float
        um per drawing unit.
    """
    space = document.modelspace()
    if (count := _count(document, space)) > MAX_ENTITIES:
        message = f"{count} entities with blocks expanded, at most {MAX_ENTITIES}"
        yield Trouble("MP215", message, "draw fewer or smaller arrays")
        return
    world = Frame(complex(scale_um))
    for entity in space:
        layer = entity.dxf.layer
        if entity.dxftype() == "INSERT":
            yield from _insert(document, entity, layers, world)
        elif layer.lower() in layers:
            yield from _entity(entity, layer, world)


def layer_counts(document: Any) -> dict[str, int]:
    """Return how many drawn entities each layer holds, blocks expanded one level."""
    counts: dict[str, int] = {}
    for entity in document.modelspace():
        inner: Iterable[Any] = [entity]
        if entity.dxftype() == "INSERT":
            inner = document.blocks.get(entity.dxf.name) or ()
        for part in inner:
            layer = part.dxf.layer
            layer = entity.dxf.layer if layer == "0" else layer
            counts[layer] = counts.get(layer, 0) + 1
    return dict(sorted(counts.items()))


def _count(document: Any, space: Any) -> int:
    """Return the number of entities with one level of blocks expanded."""
    total = 0
    for entity in space:
        block = None
        if entity.dxftype() == "INSERT":
            block = document.blocks.get(entity.dxf.name)
        copies = 1 if block is None else len(block) * _copies(entity)
        total += max(copies, 1)
    return total


def _copies(insert: Any) -> int:
    """Return how many copies an INSERT makes."""
    rows = int(insert.dxf.get("row_count", 1))
    return max(rows, 1) * max(int(insert.dxf.get("column_count", 1)), 1)


def _insert(
    document: Any, insert: Any, layers: frozenset[str], world: Frame
) -> Iterator[Piece | Trouble]:
    """Yield the pieces of every copy of a block."""
    block = document.blocks.get(insert.dxf.name)
    inner = list(block) if block is not None else []
    own = insert.dxf.layer
    wanted = []
    for entity in inner:
        if entity.dxftype() == "INSERT":
            if _reaches(document, entity, own, layers, set()):
                message = f"block '{insert.dxf.name}' holds a block in turn"
                hint = "explode the inner block"
                yield Trouble("MP206", message, hint, _handle(entity))
            continue
        layer = own if entity.dxf.layer == "0" else entity.dxf.layer
        if layer.lower() in layers:
            wanted.append((entity, layer))
    if not wanted:
        return
    sx, sy = insert.dxf.get("xscale", 1.0), insert.dxf.get("yscale", 1.0)
    if not math.isclose(abs(sx), abs(sy), rel_tol=1e-9) or not sx:
        message = f"block '{insert.dxf.name}' is inserted scaled {sx} x {sy}"
        hint = "scale it evenly, or explode it"
        yield Trouble("MP207", message, hint, _handle(insert))
        return
    flat = _plane(insert, world)
    if isinstance(flat, Trouble):
        yield flat
        return
    base = _xy(block.block.dxf.base_point)
    for shift in _shifts(insert):
        frame = Frame(complex(sx), mirrored=sx * sy < 0)
        turn = cmath.rect(1.0, math.radians(insert.dxf.get("rotation", 0.0)))
        placed = Frame(turn, t=_xy(insert.dxf.insert) + turn * shift)
        whole = flat.of(placed.of(frame.of(Frame(1 + 0j, t=-base))))
        for entity, layer in wanted:
            yield from _entity(entity, layer, whole)


def _shifts(insert: Any) -> Iterator[complex]:
    """Yield the offset of each copy in an INSERT's grid, drawing units."""
    dx, dy = insert.dxf.get("column_spacing", 0.0), insert.dxf.get("row_spacing", 0.0)
    for row in range(max(int(insert.dxf.get("row_count", 1)), 1)):
        for column in range(max(int(insert.dxf.get("column_count", 1)), 1)):
            yield complex(column * dx, row * dy)


def _reaches(
    document: Any, insert: Any, outer: str, layers: frozenset[str], seen: set[str]
) -> bool:
    """Return whether a nested block holds anything on a selected layer."""
    own = outer if insert.dxf.layer == "0" else insert.dxf.layer
    name = insert.dxf.name.lower()
    block = document.blocks.get(name)
    if block is None or f"{name}/{own}" in seen:
        return False
    seen.add(f"{name}/{own}")
    for entity in block:
        layer = own if entity.dxf.layer == "0" else entity.dxf.layer
        if entity.dxftype() == "INSERT":
            if _reaches(document, entity, own, layers, seen):
                return True
        elif layer.lower() in layers:
            return True
    return False


def _entity(entity: Any, layer: str, frame: Frame) -> Iterator[Piece | Trouble]:
    """Yield the pieces of one entity, or why it cannot be taken."""
    read = _READERS.get(entity.dxftype())
    if read is None:
        message = f"{entity.dxftype()} on layer '{layer}' cannot be read"
        hint = "redraw it as " + ", ".join(sorted(_READERS)) + ", or leave it out"
        yield Trouble("MP203", message, hint, _handle(entity))
        return
    flat = frame if entity.dxftype() == "LINE" else _plane(entity, frame)
    if isinstance(flat, Trouble):
        yield flat
        return
    try:
        edges, closed = read(entity, flat)
        for edge in edges:
            _refuse_far(edge)
    except (ValueError, OverflowError) as error:
        message = f"{entity.dxftype()} on layer '{layer}' is no outline: {error}"
        yield Trouble("MP214", message, "redraw or delete it", _handle(entity))
        return
    handle = _handle(entity)
    kept = tuple(edge for edge in edges if edge.length_um > JOIN_UM)
    if closed and kept:
        yield Piece(kept, closed=True, layer=layer, handle=handle)
    else:
        for edge in kept:
            yield Piece((edge,), closed=False, layer=layer, handle=handle)


def _refuse_far(edge: Edge) -> None:
    """Raise ValueError for an edge that no drawing of a part can hold."""
    points = [edge.start, edge.end]
    if isinstance(edge, Arc):
        points += [edge.center, (edge.radius_um, 0.0)]
    far = max(abs(c) for point in points for c in point)
    if far > FAR_UM:
        raise ValueError(f"it reaches to {far:.3g} um, at most {FAR_UM:g}")


def _plane(entity: Any, frame: Frame) -> Frame | Trouble:
    """Return the frame of an entity's own plane, which may be seen from behind."""
    x, y, z = entity.dxf.get("extrusion", (0.0, 0.0, 1.0))
    if abs(x) > 1e-9 or abs(y) > 1e-9 or not z:
        message = f"{entity.dxftype()} is tilted out of the drawing plane"
        return Trouble("MP214", message, "flatten the drawing", _handle(entity))
    return frame if z > 0 else frame.of(Frame(-1 + 0j, mirrored=True))


def _line(entity: Any, frame: Frame) -> tuple[list[Edge], bool]:
    start, end = entity.dxf.start, entity.dxf.end
    if abs(start[2] - end[2]) * abs(frame.a) > JOIN_UM:
        raise ValueError(f"it runs from z = {start[2]} to z = {end[2]}")
    return [_segment(frame.point(_xy(start)), frame.point(_xy(end)))], False


def _arc(entity: Any, frame: Frame) -> tuple[list[Edge], bool]:
    start, end = entity.dxf.start_angle, entity.dxf.end_angle
    sweep = math.radians((end - start) % 360 or 360.0)
    arc = frame.arc(
        _xy(entity.dxf.center), entity.dxf.radius, math.radians(start), sweep
    )
    return [arc], arc.is_circle


def _circle(entity: Any, frame: Frame) -> tuple[list[Edge], bool]:
    center = _xy(entity.dxf.center)
    return [frame.arc(center, entity.dxf.radius, 0.0, math.tau)], True


def _polyline(entity: Any, frame: Frame) -> tuple[list[Edge], bool]:
    points = [(complex(x, y), float(b)) for x, y, b in entity.get_points("xyb")]
    if len(points) < 2:
        raise ValueError("it has fewer than two points")
    ends = points[1:] + (points[:1] if entity.closed else [])
    edges = [
        _bulged(start, end, bulge, frame)
        for (start, bulge), (end, _) in zip(points, ends, strict=False)
    ]
    return edges, bool(entity.closed)


def _bulged(start: complex, end: complex, bulge: float, frame: Frame) -> Edge:
    """Return the edge from `start` to `end`; bulge = tan(sweep / 4)."""
    chord = end - start
    # below 1e-7 um of sagitta an arc is a line to far less than a drawing resolves
    if abs(bulge * chord / 2) * abs(frame.a) < 1e-7:
        return _segment(frame.point(start), frame.point(end))
    center = (start + end) / 2 + 1j * chord * (1 - bulge**2) / (4 * bulge)
    radius = abs(chord) * (1 + bulge**2) / (4 * abs(bulge))
    return frame.arc(center, radius, cmath.phase(start - center), 4 * math.atan(bulge))


def _segment(start: complex, end: complex) -> Segment:
    return Segment(start=(start.real, start.imag), end=(end.real, end.imag))


def _xy(vector: Any) -> complex:
    """Return the x and y of a point in the drawing."""
    return complex(vector[0], vector[1])


def _handle(entity: Any) -> str:
    """Return the handle by which a CAD program finds the entity."""
    return str(entity.dxf.handle)


_READERS = {"LINE": _line, "ARC": _arc, "CIRCLE": _circle, "LWPOLYLINE": _polyline}
