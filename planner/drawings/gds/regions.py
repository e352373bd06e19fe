"""GDSII shapes of one layer as rings: united, holes found, circles recognised."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Arc, Ring, Segment
from microplan.planner.drawings.affine import Affine
from microplan.planner.drawings.biarcs import fit_circle
from microplan.planner.drawings.gds.cells import MAX_UNITS, PlacedShape
from microplan.planner.drawings.gds.paths import sagitta
from microplan.planner.drawings.gds.polygons import BATCH, polygons, too_many_meetings
from microplan.planner.drawings.gds.records import GdsError
from microplan.planner.drawings.rings import canonical

# Corners are taken to multiples of this part of a database unit: copies rotated by odd
# angles then meet again, and what lies on the grid stays where it is.
GRID = 2.0**-14
# What two edges that are one leave between them after that is narrower than this, in
# database units: a whole step of the grid along x and along y at each end.
SLIVER = 4 * GRID
MAX_RINGS = 2000  # around and inside the shapes of one layer
MAX_MEETINGS = 200_000  # pairs of edges whose boxes meet, neighbours aside
ROUND_CORNERS = 32  # fewer on a circle may be meant as corners


@dataclass(frozen=True, slots=True, kw_only=True)
class Rounded:
    """A ring of corners that was taken for a circle, and by how much it misses it."""

    corners: int
    circle: Arc
    chord_um: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Regions:
    """The rings of one layer, counter-clockwise, holes like bodies."""

    rings: tuple[Ring, ...]
    rounded: tuple[Rounded, ...]
    chord_um: float  # largest sagitta of what was round and is not any more


def unite(placed: Sequence[PlacedShape], unit_um: float) -> Regions:
    """Return the rings that bound what the shapes cover together.

    Parameters
    ----------
    placed : sequence of PlacedShape
        The shapes of one layer, at least one.
    unit_um : float
        One database unit.

    Raises
    ------
    GdsError
        As `polygons`; MP215 where uniting them could take for ever.
    """
    pieces = _pieces(placed)
    _refuse_too_many_meetings(pieces)
    groups = _groups(pieces)
    if len(groups) > MAX_RINGS:
        raise _too_many_rings(len(groups))
    try:
        united = [shapely.union_all(group, grid_size=GRID) for group in groups]
    except shapely.errors.GEOSException as error:
        raise GdsError("MP233", -1, f"the shapes cannot be united: {error}") from None
    layer = placed[0].shape.layer
    rings, rounded = [], []
    for border in _borders(united):
        corners = shapely.get_coordinates(border)[:-1] * unit_um
        found = as_circle(corners, unit_um)
        rounded += [found] if found else []
        edges = (found.circle,) if found else _segments(corners)
        rings.append(canonical(Ring(edges=edges, layer=layer)))
    ends = max(_round_end(p) for p in placed) * unit_um
    chord_um = max([ends, *(found.chord_um for found in rounded)])
    return Regions(rings=tuple(rings), rounded=tuple(rounded), chord_um=chord_um)


def as_circle(corners: FloatArray, unit_um: float) -> Rounded | None:
    """Return the circle that a ring's corners are samples of, None where in doubt.

    All corners must lie on one circle within a database unit. Then either the chords
    do too, or there are at least ROUND_CORNERS and they divide it evenly.

    Parameters
    ----------
    corners : (N, 2) float array
        In order, um.
    unit_um : float
        One database unit: what corners are rounded to.
    """
    if len(corners) < 8:
        return None
    (x, y), radius = fit_circle(corners)
    off = np.hypot(*(corners - (x, y)).T) - radius
    if not np.abs(off).max() <= unit_um < radius / 4:
        return None
    angles = np.unwrap(np.arctan2(corners[:, 1] - y, corners[:, 0] - x))
    steps = np.diff(
        np.append(angles, angles[0] + math.copysign(math.tau, angles[-1] - angles[0]))
    )
    chord_um = radius * (1 - math.cos(np.abs(steps).max() / 2))
    once = (steps > 0).all() or (steps < 0).all()
    # each end of a step is rounded by up to half a unit along x and along y
    even = np.abs(np.abs(steps) - math.tau / len(corners)).max() * radius <= 2 * unit_um
    certain = chord_um <= unit_um or (len(corners) >= ROUND_CORNERS and even)
    if not (once and certain):
        return None
    circle = Arc(center=(x, y), radius_um=radius, start_rad=0.0, sweep_rad=math.tau)
    return Rounded(corners=len(corners), circle=circle, chord_um=chord_um)


def _pieces(placed: Sequence[PlacedShape]) -> list[shapely.Polygon]:
    """Return the shapes' polygons where they are placed."""
    own: dict[object, list[shapely.Polygon]] = {}
    found: list[shapely.Polygon] = []
    for item in placed:
        absolute = item.shape.kind == "PATH" and item.shape.width < 0
        mag = item.at.stretch if absolute else 1.0
        key = (item.shape.offset, mag)
        if key not in own:
            own[key] = polygons(item.shape, mag)
        for polygon in own[key]:
            moved = _moved(item.at, polygon)
            if not np.abs(moved.bounds).max() <= MAX_UNITS:
                message = f"a {item.shape.kind} of cell '{item.cell}' is out of range"
                raise GdsError("MP233", item.shape.offset, message)
            found.append(moved)
    return found


def _moved(at: Affine, polygon: shapely.Polygon) -> shapely.Polygon:
    """Return a polygon where a map brings it."""

    a, b, c, d = at.matrix

    def move(points: FloatArray) -> FloatArray:
        x, y = points.T
        return np.column_stack([a * x + b * y + at.t.real, c * x + d * y + at.t.imag])

    return shapely.transform(polygon, move)


def _refuse_too_many_meetings(pieces: Sequence[shapely.Polygon]) -> None:
    """Raise if so many edges may cross that uniting them has no sensible end."""
    rings = [shapely.get_coordinates(shapely.get_rings(p)) for p in pieces]
    edges = np.concatenate([np.stack([r[:-1], r[1:]], axis=1) for r in rings])
    if too_many_meetings(edges, MAX_MEETINGS):
        message = f"{len(edges)} edges cross each other too often"
        raise GdsError("MP215", -1, message, "draw fewer shapes over each other")


def _groups(pieces: Sequence[shapely.Polygon]) -> list[list[shapely.Polygon]]:
    """Return the pieces in groups that do not meet, by their boxes.

    Uniting many that lie apart takes the most time of all, and does nothing.
    """
    shapes = np.array(pieces)
    bounds = shapely.bounds(shapes) + [-SLIVER, -SLIVER, SLIVER, SLIVER]
    near = np.asarray(shapely.box(*bounds.T))
    tree = shapely.STRtree(near)
    group = list(range(len(pieces)))

    def root(k: int) -> int:
        while group[k] != k:
            group[k] = group[group[k]]
            k = group[k]
        return k

    for first in range(0, len(pieces), BATCH):
        for row, j in tree.query(near[first : first + BATCH]).T.tolist():
            one, other = sorted((root(first + row), root(j)))
            group[other] = one
    found: dict[int, list[shapely.Polygon]] = {}
    for k, piece in enumerate(pieces):
        found.setdefault(root(k), []).append(piece)
    return list(found.values())


def _borders(united: Sequence[BaseGeometry]) -> list[shapely.LinearRing]:
    """Return the rings around and inside regions, slivers left out."""
    found = [
        border
        for border in shapely.get_rings(shapely.get_parts(united))
        if 2 * shapely.Polygon(border).area > SLIVER * border.length
    ]
    if not found:
        message = f"the shapes cover nothing that is {SLIVER:.3g} database units wide"
        raise GdsError("MP233", -1, message)
    if len(found) > MAX_RINGS:
        raise _too_many_rings(len(found))
    return found


def _too_many_rings(count: int) -> GdsError:
    message = f"the shapes have {count} outlines and holes, {MAX_RINGS} allowed"
    return GdsError("MP215", -1, message, "select the cell of one part")


def _segments(corners: FloatArray) -> tuple[Segment, ...]:
    """Return the straight edges between corners, the last one back to the first."""
    points = [(float(x), float(y)) for x, y in corners]
    return tuple(Segment(start=a, end=b) for a, b in pairwise([*points, points[0]]))


def _round_end(placed: PlacedShape) -> float:
    """Return the sagitta of a path's round ends, database units; 0 if it has none."""
    shape, mag = placed.shape, placed.at.stretch
    if shape.kind != "PATH" or shape.path_type != 1:
        return 0.0
    own = 1.0 if shape.width >= 0 else mag
    return sagitta(abs(shape.width) / own / 2) * mag


def by_layer(placed: Sequence[PlacedShape]) -> Mapping[str, list[PlacedShape]]:
    """Return the shapes of each layer."""
    found: dict[str, list[PlacedShape]] = {}
    for item in placed:
        found.setdefault(item.shape.layer, []).append(item)
    return found
