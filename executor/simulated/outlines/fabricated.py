"""Rings as fabricated: polygon, discs inside and around it, radius of whole circles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.simulated.outlines.crossing import enclosed
from microplan.executor.simulated.outlines.flattening import (
    ROUNDED,
    Edges,
    centroid_um,
    offset,
    polygon,
)

MIDDLES = 8  # of arcs, tried as centres


@dataclass(frozen=True, slots=True, kw_only=True)
class FabricatedRing:
    """A ring with its edge offset, in its part's frame."""

    corners_um: FloatArray  # (N, 2), counter-clockwise
    center_um: tuple[float, float]  # of the circle, else of the disc inside
    round_um: float | None  # radius of a whole circle; None for any other ring
    inner_um: float  # radius about the centre within which all is inside
    outer_um: float  # radius about the centre beyond which all is outside


def fabricated_ring(
    edges: Edges, offset_um: float, *, post: bool
) -> FabricatedRing | None:
    """Return a drawn ring with its edges `offset_um` farther out; None if it vanishes.

    Parameters
    ----------
    edges : sequence of tuples
        Of a `microplan.schemas.files.world.WorldRing`.
    offset_um : float
        Positive enlarges the region in the ring: a larger post, a larger hole.
    post : bool
        Whether the polygon errs outwards, as a post's has to; a hole's errs inwards.
    """
    corners = offset(polygon(edges, larger=post), offset_um)
    if len(corners) < 3:
        return None
    circle = whole_circle(edges)
    if circle is not None:
        center, round_um = circle[:2], circle[2] + offset_um
        inner_um, outer_um = round_um, round_um
    else:
        round_um, (inner_um, outer_um, center) = None, _discs(edges, corners)
    return FabricatedRing(
        corners_um=corners,
        center_um=center,
        round_um=round_um,
        inner_um=inner_um,
        outer_um=outer_um,
    )


def whole_circle(edges: Edges) -> tuple[float, float, float] | None:
    """Return centre and radius, um, of a ring that is one circle; None for others."""
    x, y, radius, _, sweep = edges[0] if len(edges[0]) == 5 else (0.0,) * 5
    near_um = ROUNDED * max(abs(x), abs(y), radius)
    total = 0.0
    for edge in edges:
        if len(edge) != 5 or edge[4] * sweep <= 0:
            return None
        if math.dist(edge[:3], (x, y, radius)) > 2 * near_um:
            return None
        total += abs(edge[4])
    return (x, y, radius) if abs(total - math.tau) < 10 * ROUNDED else None


def _discs(
    edges: Edges, corners: FloatArray
) -> tuple[float, float, tuple[float, float]]:
    """Return radii, um, of discs inside and around a ring, and their centre.

    Tried are the middles of arcs and that of the area: the largest disc inside wins.
    """
    arcs = sorted({edge[:3] for edge in edges if len(edge) == 5}, key=lambda e: -e[2])
    middles = [centroid_um(corners), *((x, y) for x, y, _ in arcs[:MIDDLES])]
    return max((*_radii(corners, middle), middle) for middle in middles)


def _radii(corners: FloatArray, center: tuple[float, float]) -> tuple[float, float]:
    """Return radii about a point of discs inside (0: none) and around, um."""
    from_center = corners - np.array(center)
    edge = np.roll(from_center, -1, axis=0) - from_center
    share = -(from_center * edge).sum(axis=1) / (edge**2).sum(axis=1)
    nearest = from_center + np.clip(share, 0, 1)[:, None] * edge
    inside = bool(enclosed(np.array([center]), corners)[0])
    inner = float(np.hypot(*nearest.T).min()) if inside else 0.0
    return inner, float(np.hypot(*from_center.T).max())
