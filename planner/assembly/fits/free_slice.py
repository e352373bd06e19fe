"""Places at which a peg, at one angle, lies inside a hole.

The hole eroded by the peg. Between the hole's convex hull and the peg's the half planes
of the hull's edges leave a convex polygon; of that, the sums of every other edge of the
hole with every convex piece of the mirrored peg are taken away, and what is left counts
where a point of the peg is inside the hole.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from microplan.arrays import Box, FloatArray
from microplan.planner.assembly.fits.convex_cover import convex_cover
from microplan.planner.assembly.fits.half_planes import common_polygon

NOWHERE = Polygon()
Geometries = npt.NDArray[np.object_]
# Corners of the hole this close to its hull are on it, as a share of its size.
ON_HULL = 1e-9
# Places are rounded to this share of the room where exact ones cannot be ordered.
GRID = 1e-9


@dataclass(frozen=True)
class Opening:
    """A hole, with the edges that are not on its hull."""

    polygon: Polygon  # what stands in it is an interior

    @cached_property
    def hull(self) -> tuple[FloatArray, FloatArray]:
        """Return normals, (N, 2) by rising angle, and reaches, (N,) um, of the hull."""
        hull = shapely.remove_repeated_points(self.polygon.convex_hull)
        points = shapely.get_coordinates(shapely.orient_polygons(hull))[:-1]
        steps = np.roll(points, -1, axis=0) - points
        normals = np.column_stack([steps[:, 1], -steps[:, 0]])
        normals /= np.hypot(*normals.T)[:, None]
        order = np.argsort(np.arctan2(normals[:, 1], normals[:, 0]))
        return normals[order], (normals * points).sum(axis=1)[order]

    @cached_property
    def inner_edges(self) -> tuple[FloatArray, FloatArray]:
        """Return where the edges that are not on the hull begin and end, (N, 2) um."""
        rings = (self.polygon.exterior, *self.polygon.interiors)
        points = [shapely.get_coordinates(ring) for ring in rings]
        starts = np.concatenate([ring[:-1] for ring in points])
        ends = np.concatenate([ring[1:] for ring in points])
        normals, reaches = self.hull
        slack = ON_HULL * np.abs(reaches).max()
        on = [reaches - side @ normals.T < slack for side in (starts, ends)]
        inner = ~(on[0] & on[1]).any(axis=1)
        return starts[inner], ends[inner]


@dataclass(frozen=True)
class Peg:
    """A peg without holes, in its own frame."""

    points: FloatArray  # (N, 2) um, in order

    @cached_property
    def pieces(self) -> tuple[FloatArray, ...]:
        """Return convex pieces that together are the peg, (M, 2) um each."""
        return convex_cover(self.points)


def free_slice(hole: Opening, peg: Peg, theta_rad: float) -> BaseGeometry:
    """Return the places of the peg's origin at which it does not leave the hole.

    Parameters
    ----------
    hole : Opening
        In its own frame, um.
    peg : Peg
        In its own frame, um.
    theta_rad : float
        Angle of the peg in the frame of the hole.

    Returns
    -------
    Polygon or MultiPolygon
        Exact for polygons; empty where no place is free, or only a line of them.
    """
    if hole.polygon.is_empty:
        return NOWHERE
    turn = _turn(theta_rad)
    normals, reaches = hole.hull
    farthest = (normals @ (peg.points @ turn.T).T).max(axis=1)
    corners = common_polygon(normals, reaches - farthest)
    if corners is None:
        return NOWHERE
    room = Polygon(corners)
    starts, ends = hole.inner_edges
    if not len(starts):
        return room
    turned = [piece @ turn.T for piece in peg.pieces]
    taken = _taken(starts, ends, turned, room)
    left = _without(room, taken) if taken else room
    x, y = turned[0].mean(axis=0)  # a point of the peg
    inside = [part for part in shapely.get_parts(left) if _holds(hole, part, x, y)]
    return shapely.union_all(inside) if inside else NOWHERE


def _without(room: Polygon, bodies: Sequence[BaseGeometry]) -> BaseGeometry:
    """Return a room without bodies; where rounding defeats that, on a fine grid."""
    try:
        return room.difference(shapely.union_all(bodies))
    except shapely.GEOSException:
        x0, y0, x1, y1 = room.bounds
        grid_um = GRID * max(x1 - x0, y1 - y0)
        taken = shapely.union_all(bodies, grid_size=grid_um)
        return shapely.difference(room, taken, grid_size=grid_um)


def _turn(theta_rad: float) -> FloatArray:
    """Return a rotation, (2, 2)."""
    c, s = math.cos(theta_rad), math.sin(theta_rad)
    return np.array([[c, -s], [s, c]])


def _taken(
    starts: FloatArray, ends: FloatArray, pieces: Sequence[FloatArray], room: Polygon
) -> list[BaseGeometry]:
    """Return the places in the box of a room at which pieces touch the edges.

    The sum of an edge and a convex piece, mirrored, is the hull of its corners'.
    """
    x0, y0, x1, y1 = room.bounds
    least = np.array([piece.min(axis=0) for piece in pieces])[:, None]
    most = np.array([piece.max(axis=0) for piece in pieces])[:, None]
    near = (np.minimum(starts, ends) - most < (x1, y1)).all(axis=2)
    near &= (np.maximum(starts, ends) - least > (x0, y0)).all(axis=2)
    which, edge = np.nonzero(near)
    if not len(edge):
        return []
    corners = [pieces[k] for k in which.tolist()]
    owner = np.repeat(np.arange(len(edge)), [len(piece) for piece in corners])
    sides = np.stack([starts[edge][owner], ends[edge][owner]], axis=1)
    sums = (sides - np.concatenate(corners)[:, None]).reshape(-1, 2)
    lines = shapely.linestrings(sums, indices=np.repeat(owner, 2))
    hulls = np.asarray(shapely.convex_hull(lines))
    inside = _inside(hulls, (x0, y0, x1, y1))
    hulls = np.asarray(shapely.convex_hull(inside))  # valid, rounded or not
    return [body for body in hulls if body.geom_type == "Polygon"]


def _inside(hulls: Geometries, box: Box) -> Geometries:
    """Return what of convex bodies is in a box, (N,) each."""
    try:
        return np.asarray(shapely.clip_by_rect(hulls, *box))
    except shapely.GEOSException:  # one touches a side within rounding
        return np.asarray(shapely.intersection(hulls, shapely.box(*box)))


def _holds(hole: Opening, part: BaseGeometry, x: float, y: float) -> bool:
    """Return whether the peg is inside the hole, not outside of it, at its places."""
    if part.geom_type != "Polygon" or part.is_empty:
        return False
    place = part.representative_point()
    if place.is_empty:  # too thin for a point inside
        return False
    return bool(shapely.contains_xy(hole.polygon, place.x + x, place.y + y))
