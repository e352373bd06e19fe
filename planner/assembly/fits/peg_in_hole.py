"""Slices of the free region of a peg in a hole, sizes as fabricated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry

from microplan.arrays import FloatArray, IntArray
from microplan.optics.outline.offset import offset
from microplan.optics.outline.outline import Arc, Edge, Outline, Ring, chords
from microplan.planner.assembly.fits.free_slice import Opening, Peg, free_slice

# Largest distance of an arc from its chord, as shares of the hole's size and of the
# clearance; in the mean it is 0.
CHORD_SHARES = (5e-5, 4e-4)
CHORD_OF_CLEARANCE = 0.005
MANY = 200  # edges, as a drawn curve may have: beyond, it is taken as its chords
KEPT = 4  # fits whose slices are kept
KEPT_SLICES, KEPT_SIZES = 2**15, 256  # the last ones of a fit, some 2 kB each


@dataclass(frozen=True, slots=True, kw_only=True)
class PegInHole:
    """A planar peg and the ring that it goes into, each about its reference point."""

    hole: Outline  # its material is outside: one clockwise ring
    peg: Outline  # one counter-clockwise ring
    angle_rad: float = 0.0  # of the peg in the hole's frame, as planned

    def __post_init__(self) -> None:
        if not len(self.hole.rings) == len(self.peg.rings) == 1:
            raise ValueError("a hole is one ring and a peg is one ring")
        if self.hole.area_um2 >= 0 or self.peg.area_um2 <= 0:
            raise ValueError("the ring of a hole is clockwise, that of a peg is not")

    @property
    def reach_um(self) -> float:
        """Return the distance from its origin to the peg's farthest point."""
        return float(np.hypot(*ring_points(self.peg.rings[0], self.chord_um).T).max())

    @property
    def peg_radius_um(self) -> float | None:
        """Return the radius of a peg that is a whole circle, None of another one."""
        first = self.peg.rings[0].edges[0]
        round_peg = isinstance(first, Arc) and is_whole_circle(self.peg.rings[0])
        return first.radius_um if isinstance(first, Arc) and round_peg else None

    @property
    def size_um(self) -> float:
        """Return the diagonal of the hole's box."""
        x0, y0, x1, y1 = self.hole.bounds_um
        return math.hypot(x1 - x0, y1 - y0)

    @property
    def chord_um(self) -> float:
        """Return how far an arc's chord may be from it."""
        radii = [math.sqrt(abs(o.area_um2) / math.pi) for o in (self.hole, self.peg)]
        least, most = (share * self.size_um for share in CHORD_SHARES)
        return min(max(CHORD_OF_CLEARANCE * abs(radii[0] - radii[1]), least), most)

    @property
    def turns_freely(self) -> bool:
        """Return whether the angle is of no matter: hole or peg is a whole circle.

        About its reference point; of the other one the slice turns with it.
        """
        return any(is_whole_circle(o.rings[0]) for o in (self.hole, self.peg))


def is_whole_circle(ring: Ring, about_um: tuple[float, float] = (0.0, 0.0)) -> bool:
    """Return whether a ring is one circle about a point, as one arc or several."""
    arcs = [edge for edge in ring.edges if isinstance(edge, Arc)]
    if len(arcs) < len(ring.edges):
        return False
    radius_um = arcs[0].radius_um
    slack_um = 1e-6 * radius_um
    return all(
        math.dist(arc.center, about_um) <= slack_um
        and abs(arc.radius_um - radius_um) <= slack_um
        for arc in arcs
    )


def ring_points(ring: Ring, chord_um: float) -> FloatArray:
    """Return the corners of a polygon for a ring of a body's outline, (N, 2) um.

    Between their ends arcs on which the body bulges become polygons of the arc's own
    length, r a / sin a at half the angle a of a chord: the distances of their tangents
    are right in the mean. Those on which it is hollow, along which another body slides,
    become tangents, r / cos a. Of many edges those that make less of a corner than
    chords do are left out: the time of a slice grows with the square of their number.
    """
    points = np.concatenate([_edge_points(edge, chord_um) for edge in ring.edges])
    if len(ring.edges) <= MANY:
        return points
    return shapely.get_coordinates(shapely.simplify(Polygon(points), chord_um))[:-1]


def _edge_points(edge: Edge, chord_um: float) -> FloatArray:
    """Return the corners for one edge, without its end, (N, 2) um."""
    if not isinstance(edge, Arc):
        return np.array([edge.start])
    count = chords(edge, chord_um)
    half = abs(edge.sweep_rad) / count / 2
    bulges = edge.sweep_rad > 0
    share = (np.arange(count) + (0.0 if bulges else 0.5)) / count
    angle = edge.start_rad + share * edge.sweep_rad
    radius = edge.radius_um * (half / math.sin(half) if bulges else 1 / math.cos(half))
    unit = np.column_stack([np.cos(angle), np.sin(angle)])
    points: FloatArray = np.array(edge.center) + radius * unit
    if not edge.is_circle:
        points = np.vstack([[edge.start], points[1:] if bulges else points])
    return points


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """Offsets of both edges as fabricated, and how much that counts."""

    hole_um: float  # of the hole's edge, out of the opening
    peg_um: float  # of the peg's edge, out of the peg
    weight: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PolygonEdges:
    """Edges of polygons' rings: outer counter-clockwise, inner clockwise."""

    starts_um: FloatArray  # (E, 2)
    ends_um: FloatArray  # (E, 2)
    owner: IntArray  # (E,) which polygon
    count: int  # of polygons


def edges_of(polygons: Sequence[Polygon]) -> PolygonEdges:
    """Return the edges of polygons."""
    oriented = shapely.orient_polygons(list(polygons))
    rings, owner = shapely.get_rings(oriented, return_index=True)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    joined = ring[:-1] == ring[1:]
    return PolygonEdges(
        starts_um=points[:-1][joined],
        ends_um=points[1:][joined],
        owner=owner[ring[:-1][joined]],
        count=len(polygons),
    )


Pieces = tuple[Polygon, ...]


class Slices:
    """Slices of one fit at offsets of both edges; the last ones found are kept."""

    def __init__(self, fit: PegInHole) -> None:
        self.fit = fit
        self.reach_um, self.size_um = fit.reach_um, fit.size_um
        self._chord_um = fit.chord_um
        self._opening = lru_cache(maxsize=KEPT_SIZES)(self._opened)
        self._peg = lru_cache(maxsize=KEPT_SIZES)(self._thickened)
        self._pieces = lru_cache(maxsize=KEPT_SLICES)(self._found)

    def at(self, turn_rad: float, hole_um: float = 0.0, peg_um: float = 0.0) -> Pieces:
        """Return the pieces of the slice at a turn from the planned angle.

        Parameters
        ----------
        turn_rad : float
            Angle of the peg beyond the planned one.
        hole_um, peg_um : float
            How far the hole's edge is out of its opening, and the peg's out of the peg.

        Returns
        -------
        tuple of Polygon
            Places of the peg's reference point about the hole's, um in its frame, by
            falling area.
        """
        return self._pieces(turn_rad, hole_um, peg_um)

    def _found(self, turn_rad: float, hole_um: float, peg_um: float) -> Pieces:
        parts = shapely.get_parts(self._eroded(turn_rad, hole_um, peg_um))
        whole = (p for p in parts if p.geom_type == "Polygon" and p.area > 0)
        return tuple(sorted(whole, key=lambda p: -p.area))

    def _eroded(self, turn_rad: float, hole_um: float, peg_um: float) -> BaseGeometry:
        """Return a slice; what narrows hole or peg's room narrows that of wider ones.

        A body grown by a distance is all that is within it: so of bodies larger than
        drawn the slice is that of the drawn ones, eroded.
        """
        less_um = max(peg_um, 0.0) - min(hole_um, 0.0)
        if less_um <= 0:
            return self._slice(turn_rad, hole_um, peg_um)
        drawn = self.at(turn_rad, max(hole_um, 0.0), min(peg_um, 0.0))
        return shapely.union_all(shapely.buffer(list(drawn), -less_um, quad_segs=16))

    def capture_um(self, wider_um: float = 0.0, turn_rad: float = 0.0) -> float:
        """Return the distance from the planned place to the edge of its slice, or 0."""
        middle, pieces = Point(0.0, 0.0), self.at(turn_rad, wider_um)
        holding = next((p for p in pieces if p.contains(middle)), None)
        return 0.0 if holding is None else float(holding.boundary.distance(middle))

    def _slice(self, turn_rad: float, hole_um: float, peg_um: float) -> BaseGeometry:
        """Return a slice; a peg that vanishes goes anywhere in the hole."""
        opening, radius_um = self._opening(hole_um), self.fit.peg_radius_um
        if radius_um is not None:
            return self._within(opening.polygon, radius_um + peg_um)
        peg = self._peg(peg_um)
        if peg is None:
            return opening.polygon
        return free_slice(opening, peg, self.fit.angle_rad + turn_rad)

    def _opened(self, hole_um: float) -> Opening:
        return Opening(self._grown(self.fit.hole, -hole_um))

    def _thickened(self, peg_um: float) -> Peg | None:
        points = shapely.get_coordinates(self._grown(self.fit.peg, peg_um).exterior)
        return Peg(points[:-1]) if len(points) else None

    def _within(self, opening: Polygon, radius_um: float) -> BaseGeometry:
        """Return where the middle of a disc may be; arcs about corners by chords."""
        if radius_um <= 0:
            return opening
        step_rad = 2 * math.acos(max(1 - self._chord_um / radius_um, 0.0))
        quarter = math.ceil(math.pi / 2 / step_rad)
        return opening.buffer(-radius_um, quad_segs=quarter)

    def _grown(self, outline: Outline, distance_um: float) -> Polygon:
        """Return the polygon of a ring whose material grows by a distance.

        Edges keep their form where they can; where some vanish, the polygon is taken.
        """
        try:
            ring = offset(outline, distance_um).rings[0]
            return Polygon(ring_points(ring, self._chord_um))
        except ValueError:
            ring = outline.rings[0]
            body = Polygon(ring_points(ring, self._chord_um))
            inward = ring.signed_area_um2 < 0
            found = body.buffer(-distance_um if inward else distance_um, quad_segs=32)
            parts = [p for p in shapely.get_parts(found) if p.geom_type == "Polygon"]
            return max(parts, key=lambda part: part.area, default=Polygon())


@lru_cache(maxsize=KEPT)
def slices_of(fit: PegInHole) -> Slices:
    """Return the slices of a fit, those found before among them."""
    return Slices(fit)
