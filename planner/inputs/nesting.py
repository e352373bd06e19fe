"""Nest rings into an outline: outer rings counter-clockwise, holes clockwise."""

from __future__ import annotations

from collections.abc import Sequence

import shapely

from optics.outline import Outline, Ring, flatten
from planner.inputs.rings import edges_key

CHORD_UM = 0.005  # of the polygons that containment is judged by


class BadRingsError(ValueError):
    """Rings that cross themselves or each other."""


def nest(rings: Sequence[Ring]) -> tuple[Outline, int, int]:
    """Return the outline, how many rings were drawn twice, and how many are outer.

    Parameters
    ----------
    rings : sequence of Ring
        Counter-clockwise, in any order.

    Raises
    ------
    BadRingsError
        If a ring crosses itself or another one; the message says where.
    """
    once = _without_doubles(rings)
    shapes = [_polygon(ring) for ring in once]
    _refuse_crossings(once, shapes)
    depth = [0] * len(once)
    tree = shapely.STRtree(shapes)
    points = [shapely.Point(ring.edges[0].start) for ring in once]
    for inner, outer in tree.query(points, predicate="within").T.tolist():
        depth[inner] += inner != outer
    order = sorted(range(len(once)), key=lambda i: (depth[i], _box(once[i])))
    nested = [once[i] if depth[i] % 2 == 0 else once[i].reversed() for i in order]
    outer_count = sum(d % 2 == 0 for d in depth)
    return Outline(rings=tuple(nested)), len(rings) - len(once), outer_count


def _without_doubles(rings: Sequence[Ring]) -> list[Ring]:
    """Return each ring once, however its edges were split."""
    once: dict[object, Ring] = {}
    for ring in rings:
        once.setdefault(edges_key(ring.edges), ring)
    return list(once.values())


def _polygon(ring: Ring) -> shapely.Polygon:
    """Return a polygon near enough to judge containment by, also for tiny rings."""
    length_um = sum(edge.length_um for edge in ring.edges)
    points = flatten(ring, min(CHORD_UM, length_um / 1000))
    if len(points) < 3:
        x, y = ring.edges[0].start
        raise BadRingsError(
            f"a ring on layer '{ring.layer}' at ({x:.6g}, {y:.6g}) um encloses nothing"
        )
    return shapely.Polygon(points)


def _refuse_crossings(rings: Sequence[Ring], shapes: Sequence[shapely.Polygon]) -> None:
    """Raise BadRingsError if a ring is not simple or meets another one."""
    for ring, shape in zip(rings, shapes, strict=True):
        if not shape.is_valid:
            why = shapely.is_valid_reason(shape)
            raise BadRingsError(f"a ring on layer '{ring.layer}' crosses itself: {why}")
    borders = [shape.exterior for shape in shapes]
    pairs = shapely.STRtree(borders).query(borders, predicate="intersects").T.tolist()
    for i, j in sorted(pairs):
        if i < j:
            at = shapely.intersection(borders[i], borders[j]).representative_point()
            raise BadRingsError(
                f"rings on layers '{rings[i].layer}' and '{rings[j].layer}' meet near "
                f"({at.x:.6g}, {at.y:.6g}) um"
            )


def _box(ring: Ring) -> tuple[float, ...]:
    """Return a ring's box to 1 nm: the order of rings that are equally deep."""
    return tuple(round(value, 3) for value in Outline(rings=(ring,)).bounds_um)
