"""The room that parts and fingers take up, as convex polygons of few corners."""

from __future__ import annotations

import math

import numpy as np
import shapely

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Outline
from microplan.planner.assembly.shapes import CHORD_UM, hull
from microplan.planner.task.task import Task
from microplan.schemas.plan.solids import MOST_CORNERS, Fingers, Prism, Solid

ROUNDING = 4  # decimals, um: far within CHORD_UM, by which every prism is wider
TIE = 1e-6  # relative: areas that differ by less are equal but for rounding
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
        areas, tips = _tips(left)
        least = float(areas.min())
        if math.isinf(least):  # no edge can go
            break
        k = int(np.argmax(areas <= least * (1 + TIE)))  # the first of the least
        left = np.roll(left, -k, axis=0)  # edge k is now the first
        left = np.concatenate((tips[k : k + 1], left[2:]))
    return left


def _tips(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the area that each edge's going adds, (N,), and where its neighbours
    meet, (N, 2)."""
    start, end = corners, np.roll(corners, -1, axis=0)
    out, ahead = start - np.roll(corners, 1, axis=0), np.roll(corners, -2, axis=0) - end
    way, cross = end - start, _cross(out, ahead)
    lengths = np.hypot(*out.T) * np.hypot(*ahead.T)
    meet = cross > _PARALLEL * lengths
    share = _cross(way, ahead) / np.where(meet, cross, 1.0)
    tips = start + share[:, None] * out
    areas = np.where(meet, np.abs(_cross(way, tips - start)) / 2, np.inf)
    return areas, tips


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products of plane vectors, (N, 2) each, (N,)."""
    crossed: FloatArray = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return crossed


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
