"""Nest rings into an outline: outer rings counter-clockwise, holes clockwise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely

from optics.outline import Arc, Outline, Ring, flatten
from planner.inputs.rings import edges_key

CHORD_UM = 0.005  # of the polygons that containment is judged by
_CHORD_PART = 1e-7  # and of a ring's length, where that is more
MAX_CORNERS = 1_500_000  # of all these polygons
_CHUNK = 64  # rings compared with all others at a time
_MOST_PAIRS = 1_000_000  # of rings within each other


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
    once = _without_doubles(rings, handles)
    shapes = _polygons(once)
    _refuse_crossings(once, shapes)
    depth = _depths(once, shapes)
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
    rings: Sequence[_Named], shapes: Sequence[shapely.Polygon]
) -> None:
    """Raise BadRingsError if a ring is not simple or meets another one."""
    for named, shape in zip(rings, shapes, strict=True):
        if not shape.is_valid:
            why = shapely.is_valid_reason(shape)
            place = why[why.find("[") + 1 : -1].split() if "[" in why else []
            at = f" near ({', '.join(place)}) um" if place else ""
            raise BadRingsError(f"a ring {named.name} crosses itself{at}")
    borders = np.array([shape.exterior for shape in shapes])
    for i, j in _pairs(borders, borders, "intersects"):
        if i < j:
            at = shapely.intersection(borders[i], borders[j]).representative_point()
            raise BadRingsError(
                f"a ring {rings[i].name} and one {rings[j].name} meet near "
                f"({at.x:.6g}, {at.y:.6g}) um"
            )


def _depths(
    rings: Sequence[_Named], shapes: Sequence[shapely.Polygon]
) -> npt.NDArray[np.int64]:
    """Return within how many others each ring lies."""
    points = np.array([shapely.Point(named.ring.edges[0].start) for named in rings])
    depth = np.zeros(len(rings), dtype=np.int64)
    for count, (inner, outer) in enumerate(_pairs(points, np.array(shapes), "within")):
        depth[inner] += inner != outer
        if count > _MOST_PAIRS:
            raise BadRingsError(f"{len(rings)} rings lie within each other too deep")
    return depth


def _pairs(
    left: npt.NDArray[np.object_],
    right: npt.NDArray[np.object_],
    predicate: Literal["intersects", "within"],
) -> Iterator[tuple[int, int]]:
    """Yield which of `left` and `right` belong together, a few at a time."""
    tree = shapely.STRtree(right)
    for first in range(0, len(left), _CHUNK):
        found = tree.query(list(left[first : first + _CHUNK]), predicate=predicate)
        for row, j in found.T.tolist():
            yield first + row, j


def _box(ring: Ring) -> tuple[float, ...]:
    """Return a ring's box to 1 nm: the order of rings that are equally deep."""
    return tuple(round(value, 3) for value in Outline(rings=(ring,)).bounds_um)
