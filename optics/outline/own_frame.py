"""An outline's own frame, in which outlines that only moved are the same.

An outline is turned and shifted until its first edge lies along x from the origin.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from microplan.arrays import Point
from microplan.optics.outline.clip import EdgeArrays, to_edges
from microplan.optics.outline.outline import Arc, Outline

_ROUND = 5  # digits of um: what is moved back lies within 1e-9 um of itself
_SEAM = 2.0  # rad: at -2 arcs' starts begin anew, where none of a drawing lies
OwnEdges = tuple[bytes, bytes]  # segments and arcs of `EdgeArrays`, rounded


@lru_cache(maxsize=64)
def own_frame(outline: Outline) -> tuple[Point, Point, OwnEdges]:
    """Return cosine and sine of an outline's frame in the world, its origin, its edges.

    The origin is um in the world; the edges are um in the outline's frame.
    """
    first = outline.rings[0].edges[0]
    origin, toward = np.array(first.start), first.end
    if isinstance(first, Arc):
        toward = first.at(0.25)
    turn = math.atan2(*(toward - origin)[::-1])
    c, s = math.cos(turn), math.sin(turn)
    back, edges = np.array([[c, -s], [s, c]]), to_edges(outline)
    lines, arcs = edges.segments.copy(), edges.arcs.copy()
    for points in (lines[:, :2], lines[:, 2:], arcs[:, :2]):
        points[:] = (points - origin) @ back
    arcs[:, 3] = (arcs[:, 3] - turn + _SEAM) % (2 * math.pi) - _SEAM
    # a rounded -0 is no other place
    own = tuple((np.round(each, _ROUND) + 0.0).tobytes() for each in (lines, arcs))
    return (c, s), first.start, (own[0], own[1])


@lru_cache(maxsize=64)
def own_edges(own: OwnEdges) -> EdgeArrays:
    """Return the edges of `own_frame` as arrays, not to be changed."""
    lines, arcs = (np.frombuffer(each) for each in own)
    return EdgeArrays(segments=lines.reshape(-1, 4), arcs=arcs.reshape(-1, 5))
