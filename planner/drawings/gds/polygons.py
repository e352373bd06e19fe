"""One GDSII shape as simple polygons, in database units of its own cell."""

from __future__ import annotations

import numpy as np
import shapely

from microplan.arrays import FloatArray
from microplan.planner.drawings.gds.library import AreaElement
from microplan.planner.drawings.gds.paths import stroke
from microplan.planner.drawings.gds.records import GdsError

MAX_WINDINGS = 20_000_000  # faces times corners of one boundary
MAX_TOUCHES = 20_000  # pairs of edges of one boundary whose boxes meet, so counted, too
FEW_EDGES = 400  # so many are united whatever they do
BATCH = 64  # edges asked about at once, which bounds the memory
# rounding of a slit's ends to the grid may leave faces narrower than this, in units
SLIVER = 1.0


def polygons(shape: AreaElement, mag: float = 1.0) -> list[shapely.Polygon]:
    """Return simple polygons whose union is what the shape covers.

    A boundary that touches itself, as one with a slit to a hole does, becomes what it
    goes round once.

    Parameters
    ----------
    shape : AreaElement
        A boundary, box or path.
    mag : float
        By how much its cell is magnified; an absolute width is divided by it.

    Raises
    ------
    GdsError
        MP233 for a shape without an exact reading, MP208 for a boundary that crosses
        itself, so that programs fill it differently.
    """
    points = np.frombuffer(shape.xy, dtype=">i4").astype(np.float64).reshape(-1, 2)
    if shape.kind == "PATH":
        width = shape.width if shape.width >= 0 else -shape.width / mag
        return [shapely.Polygon(p) for p in stroke(shape, points, width)]
    if len(points) < 4 or (points[0] != points[-1]).any():
        message = f"a {shape.kind} on layer '{shape.layer}' is not closed"
        raise GdsError("MP233", shape.offset, message, "save it again")
    whole = shapely.Polygon(points)
    return [whole] if whole.is_valid else _gone_round_once(shape, points)


def too_many_meetings(edges: FloatArray, limit: int) -> bool:
    """Return whether so many edges may cross that uniting them has no sensible end.

    Parameters
    ----------
    edges : (N, 2, 2) float array
        Both ends of each, database units [1].
    limit : int
        How many pairs may have boxes that meet, each counted both ways, in addition to
        every edge's own and its two neighbours'.
    """
    if len(edges) <= FEW_EDGES:
        return False
    lines = np.asarray(shapely.linestrings(edges))
    tree, met = shapely.STRtree(lines), -3 * len(lines)
    for k in range(0, len(lines), BATCH):
        met += tree.query(lines[k : k + BATCH]).shape[1]
        if met > limit:
            return True
    return False


def _gone_round_once(shape: AreaElement, points: FloatArray) -> list[shapely.Polygon]:
    """Return the faces of winding number 1, or -1 for all of them."""
    ends = np.stack([points[:-1], points[1:]], axis=1)
    if too_many_meetings(ends, MAX_TOUCHES):
        message = f"a {shape.kind} on layer '{shape.layer}' crosses itself too often"
        raise GdsError("MP215", shape.offset, message)
    edges = shapely.linestrings(ends)
    parts = shapely.get_parts(shapely.polygonize([shapely.union_all(edges)]))
    faces = [face for face in parts if isinstance(face, shapely.Polygon)]
    if not faces:
        message = f"a {shape.kind} on layer '{shape.layer}' encloses nothing"
        raise GdsError("MP233", shape.offset, message, "delete it")
    if len(faces) * len(points) > MAX_WINDINGS:
        message = f"a {shape.kind} on layer '{shape.layer}' touches itself too often"
        raise GdsError("MP215", shape.offset, message)
    turns = [(face, _winding(face, points)) for face in faces]
    wide = [(f, w) for f, w in turns if 2 * f.area > SLIVER * f.length]
    found = {w for _, w in wide if w}
    if found not in ({1}, {-1}):
        at = next((f for f, w in wide if w not in (0, 1)), faces[0])
        x, y = shapely.get_coordinates(at.representative_point())[0]
        message = (
            f"a {shape.kind} on layer '{shape.layer}' crosses or covers itself near "
            f"({x:g}, {y:g}) database units"
        )
        raise GdsError("MP208", shape.offset, message, "split it into simple ones")
    return [f for f, w in wide if w]


def _winding(face: shapely.Polygon, points: FloatArray) -> int:
    """Return how often a closed chain of points goes round a face."""
    x, y = shapely.get_coordinates(face.representative_point())[0]
    (x0, y0), (x1, y1) = points[:-1].T, points[1:].T
    left = (x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)
    up = (y0 <= y) & (y1 > y) & (left > 0)
    down = (y0 > y) & (y1 <= y) & (left < 0)
    return int(up.sum()) - int(down.sum())
