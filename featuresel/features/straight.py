"""Straight edges of an outline, parallel pairs of them, and corners."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from microplan.arrays import Point
from microplan.featuresel.features.feature import Feature
from microplan.featuresel.features.ring_cleanup import SAME, Clean
from microplan.optics.outline.outline import Segment

LONG = 0.1  # of the extent: shorter edges say too little of a position
PARALLEL_RAD = 1e-3  # what a drawing that rounds to 1 nm may err over a 1 um edge
_OVERLAP = 0.5  # of the shorter edge that has to face the other one
# rad inside the material; flatter or sharper legs meet at no well-known point
_CORNER_RAD = (math.radians(30), math.radians(150))


@dataclass(frozen=True, slots=True)
class Side:
    """A straight edge with the material on its left."""

    segment: Segment
    ring: int
    place: int  # among the ring's edges

    @property
    def direction(self) -> Point:
        """Return the unit vector along the edge."""
        (x0, y0), (x1, y1) = self.segment.start, self.segment.end
        length = self.segment.length_um
        return ((x1 - x0) / length, (y1 - y0) / length)

    @property
    def normal_rad(self) -> float:
        """Return the angle of the normal that leads out of the material."""
        dx, dy = self.direction
        return _angle(math.atan2(-dx, dy))

    def rank(self, unit_um: float) -> tuple[int, ...]:
        """Return what orders edges: the longest first, then by position, in units."""
        x, y = _middle(self.segment.start, self.segment.end)
        values = (-self.segment.length_um, x, y, *self.segment.start)
        return tuple(round(value / unit_um) for value in values)

    def along(self, point: Point) -> float:
        """Return how far along the edge's line a point lies from its start, um."""
        dx, dy = self.direction
        x, y = self.segment.start
        return (point[0] - x) * dx + (point[1] - y) * dy

    def beyond(self, point: Point) -> float:
        """Return how far outside the edge's line a point lies, um."""
        dx, dy = self.direction
        x, y = self.segment.start
        return (point[0] - x) * dy - (point[1] - y) * dx


def sides(rings: Sequence[Clean], least_um: float) -> tuple[Side, ...]:
    """Return the straight edges that are at least `least_um` long."""
    return tuple(
        Side(edge, k, place)
        for k, ring in enumerate(rings)
        for place, edge in enumerate(ring.edges)
        if isinstance(edge, Segment) and edge.length_um >= least_um
    )


def edge_features(found: Sequence[Side]) -> list[Feature]:
    """Return each edge as a feature without a name; its position is its middle."""
    return [
        Feature(
            kind="edge",
            center_um=_middle(side.segment.start, side.segment.end),
            angle_rad=side.normal_rad,
            parameters={"length_um": side.segment.length_um},
            finest_um=side.segment.length_um,
            bright=True,
            edge_um=side.segment.length_um,
        )
        for side in found
    ]


def pair_features(found: Sequence[Side]) -> list[Feature]:
    """Return pairs of parallel edges that face each other, without names.

    Of several edges that face one, its pair is the nearest on each side. The material
    lies between the two (a bar, bright) or outside them (a slot).
    """
    pairs: dict[tuple[int, int], Feature] = {}
    for i, first in enumerate(found):
        nearest: dict[bool, tuple[float, int, Feature]] = {}
        for j, second in enumerate(found):
            feature = _pair(first, second) if i != j else None
            if feature is not None:
                rank = (feature.parameters["width_um"], j, feature)
                if feature.bright not in nearest or rank < nearest[feature.bright]:
                    nearest[feature.bright] = rank
        for _, j, feature in nearest.values():
            pairs.setdefault((min(i, j), max(i, j)), feature)
    return list(pairs.values())


def corner_features(rings: Sequence[Clean], found: Sequence[Side]) -> list[Feature]:
    """Return the corners at which two long edges meet, without names."""
    extent = max((abs(x) for r in rings for p in r.points for x in p), default=0.0)
    by_place = {(side.ring, side.place): side for side in found}
    corners = []
    for side in found:
        after = (side.place + 1) % len(rings[side.ring].edges)
        then = by_place.get((side.ring, after))
        if then is None or then is side:
            continue
        if math.dist(side.segment.end, then.segment.start) > SAME * extent:
            continue
        corner = _corner(side, then)
        if corner is not None:
            corners.append(corner)
    return corners


def _pair(first: Side, second: Side) -> Feature | None:
    """Return two edges as a pair, None if they do not face each other."""
    turn = math.remainder(second.normal_rad - first.normal_rad - math.pi, math.tau)
    if abs(turn) > PARALLEL_RAD:
        return None
    ends = [first.along(p) for p in (second.segment.end, second.segment.start)]
    low, high = max(0.0, ends[0]), min(first.segment.length_um, ends[1])
    shorter = min(first.segment.length_um, second.segment.length_um)
    middle = _middle(second.segment.start, second.segment.end)
    width = first.beyond(middle)
    if high - low < _OVERLAP * shorter or width == 0:
        return None
    dx, dy = first.direction
    (x, y), at = first.segment.start, (low + high) / 2
    center = (x + at * dx + width / 2 * dy, y + at * dy - width / 2 * dx)
    return Feature(
        kind="pair",
        center_um=center,
        angle_rad=_angle(first.normal_rad, math.pi),  # either edge may be the first
        parameters={"length_um": high - low, "width_um": abs(width)},
        symmetry=2,
        finest_um=abs(width),
        bright=width < 0,  # the second edge lies on the material's side of the first
        edge_um=2 * (high - low),
    )


def _corner(before: Side, after: Side) -> Feature | None:
    """Return the corner between two edges, None if it is too flat or too sharp."""
    turn = math.remainder(after.normal_rad - before.normal_rad, math.tau)
    if not _CORNER_RAD[0] <= math.pi - abs(turn) <= _CORNER_RAD[1]:
        return None
    reach = min(before.segment.length_um, after.segment.length_um)
    return Feature(
        kind="corner",
        center_um=before.segment.end,
        angle_rad=_angle(before.normal_rad + turn / 2),
        parameters={"angle_rad": math.pi - turn, "reach_um": reach},
        finest_um=reach,
        bright=True,
        edge_um=2 * reach,
    )


def _angle(angle_rad: float, period_rad: float = math.tau) -> float:
    """Return the angle in (-period / 2, period / 2], the same whatever was rounded."""
    found = math.remainder(angle_rad, period_rad)
    return found + period_rad if found < 1e-9 - period_rad / 2 else found + 0.0


def _middle(a: Point, b: Point) -> Point:
    """Return the point midway."""
    return ((a[0] + b[0]) / 2, (a[1] + b[1]) / 2)
