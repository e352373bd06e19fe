"""The room that parts and fingers take up, as convex polygons of few corners."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import shapely

from optics.outline import Outline
from planner.inputs.task import Task
from planner.model.shapes import CHORD_UM, hull
from schemas.solids import MOST_CORNERS, Fingers, Prism, Solid

FloatArray = npt.NDArray[np.float64]

ROUNDING = 4  # decimals, um: far within CHORD_UM, by which every prism is wider
_PARALLEL = 1e-12  # of the lengths' product: edges whose neighbours never meet


def part_solids(task: Task) -> tuple[Solid, ...]:
    """Return every part's plate and posts, by name."""
    return tuple(
        Solid(
            name=part.name,
            prisms=(
                _prism(part.outline, 0.0, part.thickness_um),
                *(
                    _prism(
                        post.outline,
                        part.thickness_um,
                        part.thickness_um + post.height_um,
                    )
                    for post in part.posts.values()
                ),
            ),
        )
        for _, part in sorted(task.parts.items())
    )


def finger_solids(task: Task) -> tuple[Fingers, ...]:
    """Return the fingers of every tool that the task uses, by name."""
    tools = (task.workcell.tools[name] for name in sorted(task.tool_starts))
    return tuple(
        Fingers(
            tool=tool.name,
            left=_prism(tool.left, 0.0, tool.thickness_um),
            right=_prism(tool.right, 0.0, tool.thickness_um),
        )
        for tool in tools
    )


def few_corners(corners: FloatArray, most: int = MOST_CORNERS) -> FloatArray:
    """Return a convex polygon of at most `most` corners around a convex polygon.

    The edge goes first whose going adds the least area: its neighbours are drawn out
    until they meet.

    Parameters
    ----------
    corners : (N, 2) float array
        Counter-clockwise, um.
    most : int
        At least 4, for less may not enclose anything.

    Returns
    -------
    (M, 2) float array
        Counter-clockwise, um; M <= max(N, most).

    Raises
    ------
    ValueError
        If `most` is below 4.
    """
    if most < 4:
        raise ValueError(f"a polygon needs room for 4 corners, got {most}")
    left = corners
    while len(left) > most:
        gone = [_without_edge(left, k) for k in range(len(left))]
        best = min(range(len(left)), key=lambda k: gone[k][0])
        if math.isinf(gone[best][0]):  # no edge can go
            break
        left = gone[best][1]
    return left


def _without_edge(corners: FloatArray, k: int) -> tuple[float, FloatArray]:
    """Return the area added, and the corners, if the edge from corner k goes."""
    n = len(corners)
    before, start, end, after = (corners[(k + i) % n] for i in (-1, 0, 1, 2))
    out, ahead, way = start - before, after - end, end - start
    cross = out[0] * ahead[1] - out[1] * ahead[0]
    if cross <= _PARALLEL * np.hypot(*out) * np.hypot(*ahead):  # they never meet
        return math.inf, corners
    share = (way[0] * ahead[1] - way[1] * ahead[0]) / cross
    tip = start + share * out
    area = abs(way[0] * (tip - start)[1] - way[1] * (tip - start)[0]) / 2
    kept = np.array([corners[i] for i in range(n) if i not in (k, (k + 1) % n)])
    # the tip takes the place of corners k and k + 1
    at = 0 if k == n - 1 else k
    return float(area), np.insert(kept, at, tip, axis=0)


def _prism(outline: Outline, low_um: float, high_um: float) -> Prism:
    """Return the prism around an outline; chords are put outside their arcs."""
    around = hull(outline).buffer(CHORD_UM, join_style="mitre")
    ring = shapely.geometry.polygon.orient(around).exterior
    corners = few_corners(shapely.get_coordinates(ring)[:-1])
    rounded = np.round(corners, ROUNDING) + 0.0  # never -0.0
    return Prism(
        corners_um=tuple((float(x), float(y)) for x, y in rounded),
        low_um=low_um,
        high_um=high_um,
    )
