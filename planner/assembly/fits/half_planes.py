"""The convex polygon that half planes have in common."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import shapely
from shapely.geometry import LineString

from microplan.arrays import FloatArray, Point

Line = tuple[float, float, float]  # unit normal, reach along it
# Directions this close, as the sine of the angle, are one.
PARALLEL = 1e-9
# A corner may miss another half plane by this share of the largest distance: rounding.
ROUNDING = 1e-9


def common_polygon(normals: FloatArray, reaches: FloatArray) -> FloatArray | None:
    """Return the corners of all points u with normals @ u <= reaches.

    Parameters
    ----------
    normals : (N, 2) float array
        Unit normals by rising angle, around the whole circle.
    reaches : (N,) float array
        How far along each normal the half plane goes, um.

    Returns
    -------
    (M, 2) float array or None
        Counter-clockwise, um; None where nothing is left but a line or a point.

    Notes
    -----
    Around a point inside all of them, the corners of their normals' hull over the
    reaches are the lines that count. Else half planes by rising angle on a deque: a new
    one takes off what it makes redundant at either end. Where rounding defeats that,
    one by one off a box.
    """
    corners = _dual(normals, reaches) if reaches.min() > 0 else None
    if corners is not None and _fits(corners, normals, reaches):
        return corners
    lines = list(_distinct(zip(*normals.T.tolist(), reaches.tolist(), strict=True)))
    corners = _enclosed(lines)
    if corners is None or not _fits(corners, normals, reaches):
        far = 2 * float(np.abs(reaches).max())
        box = [(-far, -far), (far, -far), (far, far), (-far, far)]
        found = clipped(box, [line[:2] for line in lines], [line[2] for line in lines])
        corners = np.array(found).reshape(-1, 2)
    return corners if len(corners) > 2 and _area(corners) > 0 else None


def _dual(normals: FloatArray, reaches: FloatArray) -> FloatArray:
    """Return the corners about the origin, which is inside all half planes."""
    hull = LineString(normals / reaches[:, None]).convex_hull
    points = shapely.get_coordinates(shapely.orient_polygons(hull))
    (x, y), (x1, y1) = points[:-1].T, points[1:].T
    cross = x * y1 - y * x1
    meet = cross > PARALLEL * np.hypot(x, y) * np.hypot(x1, y1)
    corners: FloatArray = np.column_stack([y1 - y, x - x1])[meet] / cross[meet, None]
    return corners


def _fits(corners: FloatArray, normals: FloatArray, reaches: FloatArray) -> bool:
    """Return whether corners are in all half planes, up to rounding."""
    if len(corners) < 3:
        return False
    slack = (corners @ normals.T - reaches).max()
    return bool(slack <= ROUNDING * np.abs(reaches).max()) and _area(corners) > 0


def _enclosed(lines: Sequence[Line]) -> FloatArray | None:
    """Return the corners where neighbours on the deque meet, None if some do not."""
    kept: list[Line] = []
    for line in lines:
        while len(kept) > 1 and _beyond(line, _meet(kept[-2], kept[-1])):
            kept.pop()
        while len(kept) > 1 and _beyond(line, _meet(kept[0], kept[1])):
            kept.pop(0)
        kept.append(line)
    while len(kept) > 2 and _beyond(kept[0], _meet(kept[-2], kept[-1])):
        kept.pop()
    while len(kept) > 2 and _beyond(kept[-1], _meet(kept[0], kept[1])):
        kept.pop(0)
    if len(kept) < 3:
        return None
    pairs = zip(kept, kept[1:] + kept[:1], strict=True)
    met = [_meet(one, other) for one, other in pairs]
    if any(corner is None for corner in met):
        return None
    return np.array(met)


def _distinct(lines: Iterable[Line]) -> Iterator[Line]:
    """Yield the narrower of neighbours that have one direction."""
    last: Line | None = None
    for line in lines:
        if last is not None and _cross(last, line) < PARALLEL:
            last = min(last, line, key=lambda found: found[2])
            continue
        if last is not None:
            yield last
        last = line
    if last is not None:
        yield last


def _cross(one: Line, other: Line) -> float:
    return one[0] * other[1] - one[1] * other[0]


def _meet(one: Line, other: Line) -> Point | None:
    """Return where two lines cross, None if they are parallel."""
    (a, b, c), (d, e, f) = one, other
    cross = _cross(one, other)
    if abs(cross) < PARALLEL:
        return None
    return ((c * e - b * f) / cross, (a * f - c * d) / cross)


def _beyond(line: Line, point: Point | None) -> bool:
    """Return whether a point is outside a half plane; no point never is."""
    return point is not None and line[0] * point[0] + line[1] * point[1] > line[2]


def _area(corners: FloatArray) -> float:
    """Return the signed area, positive counter-clockwise."""
    (x, y), (x1, y1) = corners.T, np.roll(corners, -1, axis=0).T
    return float((x * y1 - y * x1).sum() / 2)


def clipped(
    corners: list[Point], normals: Sequence[Sequence[float]], reaches: Sequence[float]
) -> list[Point]:
    """Return what half planes leave of a convex polygon."""
    for (nx, ny), reach in zip(normals, reaches, strict=True):
        over = [nx * x + ny * y - reach for x, y in corners]
        kept: list[Point] = []
        for k, (here, off) in enumerate(zip(corners, over, strict=True)):
            before, last = corners[k - 1], over[k - 1]
            if (off > 0) != (last > 0):
                share = last / (last - off)
                kept.append(
                    (
                        before[0] + share * (here[0] - before[0]),
                        before[1] + share * (here[1] - before[1]),
                    )
                )
            if off <= 0:
                kept.append(here)
        corners = kept
        if not corners:
            break
    return corners
