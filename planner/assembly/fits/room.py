"""How much room a peg has in its hole as planned, or how much it lacks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import Point, Polygon

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Arc, Edge
from microplan.planner.assembly.fits.peg_in_hole import (
    PegInHole,
    Slices,
    ring_points,
    slices_of,
)

SHARP = 1e-4  # of a room or an angle, as a share of the hole's size or of a turn
LEAST_TURN = 1e-4  # rad: other angles are searched to that
LEAST_STEP = 1e-7  # rad: a stop is found to that
FINE_SHARE = 0.002  # of the hole's size: how far apart an overlap's edges are probed


@dataclass(frozen=True, slots=True, kw_only=True)
class Overlap:
    """Where a peg at its planned pose is in the material around the hole."""

    depth_um: float  # of its deepest point
    at_um: tuple[float, float]  # that point, about the hole's reference point


def capture_um(fit: PegInHole, wider_um: float = 0.0) -> float:
    """Return the largest sideways error that still goes in, at the planned angle.

    0 where the planned place is not free. Both edges together leave `wider_um` more
    than drawn. Of a whole circle it is exact: its centre's distance from the hole.
    """
    radius = fit.peg_radius_um
    if radius is not None:
        edges = fit.hole.rings[0].edges
        room = min(_distance_um(edge) for edge in edges) - radius
        inside = Polygon(ring_points(fit.hole.rings[0], fit.chord_um))
        return max(room + wider_um, 0.0) if inside.contains(Point(0, 0)) else 0.0
    return slices_of(fit).capture_um(wider_um)


def _distance_um(edge: Edge) -> float:
    """Return the distance of the origin from an edge."""
    if not isinstance(edge, Arc):
        (ax, ay), (bx, by) = edge.start, edge.end
        square = (bx - ax) ** 2 + (by - ay) ** 2
        share = -(ax * (bx - ax) + ay * (by - ay)) / square if square else 0.0
        share = min(max(share, 0.0), 1.0)
        return math.hypot(ax + share * (bx - ax), ay + share * (by - ay))
    ends = min(math.hypot(*edge.start), math.hypot(*edge.end))
    cx, cy = edge.center
    away = math.hypot(cx, cy)
    if away == 0:
        return edge.radius_um
    turn = math.atan2(-cy, -cx) - edge.start_rad  # of the point nearest to the origin
    turn = math.remainder(turn, math.tau) * math.copysign(1.0, edge.sweep_rad)
    passes = turn % math.tau <= abs(edge.sweep_rad)
    return min(ends, abs(away - edge.radius_um)) if passes else ends


def clearance_um(fit: PegInHole, wider_um: float = 0.0) -> float:
    """Return by how much the peg could be thicker at the planned angle, on both sides.

    At its best place; negative where it must be thinner to go in at all. For round
    mates the difference of their diameters.
    """
    slices = slices_of(fit)
    found = [_inscribed_um(piece) for piece in slices.at(0.0, wider_um)]
    if not found:
        return -2 * _lacking_um(slices, wider_um)
    return 2 * max(*found, capture_um(fit, wider_um))


def _inscribed_um(piece: Polygon) -> float:
    """Return the radius of the largest disc inside a piece of a slice."""
    x0, y0, x1, y1 = piece.bounds
    sharp = SHARP * max(x1 - x0, y1 - y0)
    return float(shapely.maximum_inscribed_circle(piece, tolerance=sharp).length)


def _lacking_um(slices: Slices, wider_um: float) -> float:
    """Return by how much the hole's edge is too near for any place, by bisection."""
    low, high = 0.0, slices.fit.size_um
    while high - low > SHARP * slices.fit.size_um:
        middle = (low + high) / 2
        if slices.at(0.0, wider_um + middle):
            high = middle
        else:
            low = middle
    return high


def free_angles_rad(fit: PegInHole, wider_um: float = 0.0) -> tuple[float, float]:
    """Return how far the peg can turn at the planned place, clockwise and back.

    (0, 0) where it is not free there; half a turn where nothing stops it.
    """
    if fit.turns_freely:
        return (-math.pi, math.pi)
    return _stop(fit, wider_um, -1.0), _stop(fit, wider_um, 1.0)


def _stop(fit: PegInHole, wider_um: float, side: float) -> float:
    """Return the angle at which the planned place is no longer free, one way round."""
    slices, turn = slices_of(fit), 0.0
    while turn < math.pi:
        # turned by that much more, no point of the peg moves by more than its room
        more = slices.capture_um(wider_um, side * turn) / slices.reach_um
        if more < max(SHARP * turn, LEAST_STEP):
            return side * turn
        turn += more
    return side * math.pi


def angle_elsewhere_rad(fit: PegInHole) -> float | None:
    """Return the angle, nearest to the planned one, at which the peg goes in.

    None if there is none: what is turned by less than the slack of a wider hole is
    searched no further where that is too narrow.
    """
    slices = slices_of(fit)
    found = [_first(slices, side, 0.0, math.pi) for side in (-1.0, 1.0)]
    turns = [turn for turn in found if turn is not None]
    return min(turns, key=abs) if turns else None


def _first(slices: Slices, side: float, low: float, high: float) -> float | None:
    """Return the first angle of a range at which a slice is not empty."""
    middle, half = (low + high) / 2, (high - low) / 2
    far_um = half * slices.reach_um
    if far_um < slices.fit.size_um and not slices.at(side * middle, far_um):
        return None
    if half < LEAST_TURN:
        return side * middle if slices.at(side * middle) else None
    before = _first(slices, side, low, middle)
    return _first(slices, side, middle, high) if before is None else before


def overlap_of(fit: PegInHole) -> Overlap | None:
    """Return the overlap at the planned pose, None if there is none."""
    hole = Polygon(ring_points(fit.hole.rings[0], fit.chord_um))
    points = peg_points(fit)
    peg = Polygon(points)
    outside = peg.difference(hole)
    if outside.is_empty:
        return None
    # a peg across two openings is deepest between its corners
    lines = shapely.segmentize(outside, FINE_SHARE * fit.size_um)
    middles = [shapely.maximum_inscribed_circle(p) for p in shapely.get_parts(outside)]
    places = shapely.get_coordinates([lines, *middles])
    depths = np.asarray(shapely.distance(hole, shapely.points(places)))
    x, y = places[int(np.argmax(depths))].tolist()
    return Overlap(depth_um=float(depths.max()), at_um=(x, y))


def peg_points(fit: PegInHole) -> FloatArray:
    """Return the peg's corners at its planned pose in the hole's frame, (N, 2) um."""
    c, s = math.cos(fit.angle_rad), math.sin(fit.angle_rad)
    points: FloatArray = ring_points(fit.peg.rings[0], fit.chord_um) @ np.array(
        [[c, s], [-s, c]]
    )
    return points
