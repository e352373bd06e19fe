"""Nesting of rings into an outline: outer ones counter-clockwise, holes clockwise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from microplan.optics.outline.outline import Arc, Outline, Ring, flatten
from microplan.planner.drawings.rings import cell, edges_key

CHORD_UM = 0.005  # of the polygons that containment is judged by
_CHORD_PART = 1e-7  # and of a ring's length, where that is more
MAX_CORNERS = 1_500_000  # of all these polygons
MAX_RINGS = 10_000  # of a part: reading so many holes takes 2 s
_CHUNK = 64  # rings whose neighbours are sought at a time
# Corners of the lesser ring of each pair whose boxes meet: a second of work. A body
# with holes apart from each other has fewer than MAX_CORNERS of them.
MAX_COMPARED = 3_000_000


class BadRingsError(ValueError):
    """Rings that cross themselves or each other."""


def nest(
    rings: Sequence[Ring], handles: Sequence[Sequence[str]] = ()
) -> tuple[Outline, int, int]:
    """Return the outline, how many rings were drawn twice, and how many are outer.

    Parameters
    ----------
    rings : sequence of Ring
        Counter-clockwise, in any order.
    handles : sequence of sequence of str, optional
        Entities that each ring was made of, to name in errors.

    Raises
    ------
    BadRingsError
        If a ring crosses itself or another one; the message says where.
    """
    if len(rings) > MAX_RINGS:
        raise BadRingsError(f"{len(rings)} rings are too many, at most {MAX_RINGS}")
    once = _without_doubles(rings, handles)
    shapes = np.array(_polygons(once))
    near = _near(once, shapes)
    _refuse_crossings(once, shapes, near)
    depth = _depths(once, shapes, near)
    order = sorted(range(len(once)), key=lambda i: (depth[i], _box(once[i].ring)))
    nested = [
        once[i].ring if depth[i] % 2 == 0 else once[i].ring.reversed() for i in order
    ]
    outer_count = int((depth % 2 == 0).sum())
    return Outline(rings=tuple(nested)), len(rings) - len(once), outer_count


@dataclass(frozen=True, slots=True)
class _Named:
    """A ring and how to call it."""

    ring: Ring
    handles: tuple[str, ...]

    @property
    def name(self) -> str:
        said = ", ".join(self.handles[:4]) + (", ..." if len(self.handles) > 4 else "")
        return f"on layer '{self.ring.layer}'" + (f" ({said})" if said else "")


def _without_doubles(
    rings: Sequence[Ring], handles: Sequence[Sequence[str]]
) -> list[_Named]:
    """Return each ring once, however its edges were split."""
    once: dict[object, _Named] = {}
    for k, ring in enumerate(rings):
        named = _Named(ring, tuple(handles[k]) if handles else ())
        once.setdefault(edges_key(ring.edges), named)
    return list(once.values())


def _polygons(rings: Sequence[_Named]) -> list[shapely.Polygon]:
    """Return polygons near enough to judge containment by, also for tiny rings."""
    lengths = [sum(edge.length_um for edge in named.ring.edges) for named in rings]
    chords = [
        min(max(CHORD_UM, _CHORD_PART * length), length / 1000) for length in lengths
    ]
    corners = sum(
        _corners(named.ring, chord) for named, chord in zip(rings, chords, strict=True)
    )
    if corners > MAX_CORNERS:
        raise BadRingsError(f"{len(rings)} rings are too many to be compared")
    return [_polygon(named, chord) for named, chord in zip(rings, chords, strict=True)]


def _corners(ring: Ring, chord_um: float) -> float:
    """Return about how many corners a ring has as a polygon."""
    return sum(
        1 + edge.length_um / math.sqrt(8 * chord_um * edge.radius_um)
        if isinstance(edge, Arc)
        else 1
        for edge in ring.edges
    )


def _polygon(named: _Named, chord_um: float) -> shapely.Polygon:
    points = flatten(named.ring, chord_um)
    if len(points) < 3 or not named.ring.signed_area_um2:
        x, y = named.ring.edges[0].start
        raise BadRingsError(
            f"a ring {named.name} at ({x:.6g}, {y:.6g}) um encloses nothing"
        )
    return shapely.Polygon(points)


def _refuse_crossings(
    rings: Sequence[_Named],
    shapes: npt.NDArray[np.object_],
    near: npt.NDArray[np.int64],
) -> None:
    """Raise BadRingsError if a ring is not simple or meets another one."""
    for k in np.flatnonzero(~shapely.is_valid(shapes)).tolist():
        why = shapely.is_valid_reason(shapes[k])
        place = why[why.find("[") + 1 : -1].split() if "[" in why else []
        at = f" near ({', '.join(place)}) um" if place else ""
        raise BadRingsError(f"a ring {rings[k].name} crosses itself{at}")
    borders = shapely.get_exterior_ring(shapes)
    shapely.prepare(borders)
    for i, j in near[shapely.intersects(*borders[near].T)]:
        at = shapely.intersection(borders[i], borders[j]).representative_point()
        raise BadRingsError(
            f"a ring {rings[i].name} and one {rings[j].name} meet near "
            f"({at.x:.6g}, {at.y:.6g}) um"
        )


def _depths(
    rings: Sequence[_Named],
    shapes: npt.NDArray[np.object_],
    near: npt.NDArray[np.int64],
) -> npt.NDArray[np.int64]:
    """Return within how many others each ring lies."""
    points = np.array([shapely.Point(named.ring.edges[0].start) for named in rings])
    shapely.prepare(shapes)
    outer, inner = np.concatenate([near, near[:, ::-1]]).T
    holds = shapely.contains(shapes[outer], points[inner])
    depth: npt.NDArray[np.int64] = np.bincount(inner[holds], minlength=len(rings))
    return depth


def _near(
    rings: Sequence[_Named], shapes: npt.NDArray[np.object_]
) -> npt.NDArray[np.int64]:
    """Return each pair of rings whose boxes meet, that with more corners first.

    Shape (N, 2). A body and its holes make few of them, however many the holes are;
    rings within rings within rings make many, and are refused before they are compared.
    """
    corners = shapely.get_num_coordinates(shapes)
    boxes = shapely.envelope(shapes)
    tree = shapely.STRtree(boxes)
    found, work = [np.empty((0, 2), dtype=np.int64)], 0
    for first in range(0, len(shapes), _CHUNK):
        row, other = tree.query(boxes[first : first + _CHUNK])
        pairs = np.column_stack([row + first, other])
        pairs = pairs[pairs[:, 0] < pairs[:, 1]]
        work += int(corners[pairs].min(axis=1).sum())
        found.append(pairs)
        if work > MAX_COMPARED:
            raise BadRingsError(f"{len(rings)} rings lie over each other too often")
    near = np.concatenate(found)
    swap = corners[near[:, 0]] < corners[near[:, 1]]
    near[swap] = near[swap, ::-1]
    return near


def _box(ring: Ring) -> tuple[int, ...]:
    """Return a ring's box to 1 nm: the order of rings that are equally deep."""
    return tuple(cell(value) for value in Outline(rings=(ring,)).bounds_um)
