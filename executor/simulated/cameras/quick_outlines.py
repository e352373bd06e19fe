"""Outlines of the simulated world as the compiler's optics want them."""

from __future__ import annotations

import math

from microplan.executor.simulated.outlines.fabricated import FabricatedRing
from microplan.executor.simulated.shapes import Fabricated, is_hole
from microplan.optics.outline.outline import (
    JOIN_UM,
    Arc,
    Edge,
    Outline,
    Ring,
    Segment,
)
from microplan.schemas.files.world import WorldOutline, WorldRing

ROUNDED_UM = 0.05  # six digits of 2e4 um, the length of a finger
ROUNDED_RAD = 1e-5  # six digits of 2 pi


def outline_of(shape: WorldOutline, made: Fabricated | None = None) -> Outline:
    """Return an outline with arcs, its fabricated rings in place of drawn ones."""
    rings = []
    for i, ring in enumerate(shape.rings):
        if made is None or i not in made:
            rings.append(_ring(ring))
        elif (found := made[i]) is not None:
            rings.append(_fabricated(found, hole=is_hole(ring), layer=ring.layer))
    return Outline(rings=tuple(rings))


def _ring(ring: WorldRing) -> Ring:
    """Return a ring of edges from its numbers.

    Numbers in a file are rounded: ends that no longer meet are joined by a straight
    edge, so short that no image or contact shows it.
    """
    drawn = [_edge(edge) for edge in ring.edges]
    edges: list[Edge] = []
    for edge, after in zip(drawn, drawn[1:] + drawn[:1], strict=True):
        edges.append(edge)
        if JOIN_UM / 10 < math.dist(edge.end, after.start) <= ROUNDED_UM:
            edges.append(Segment(start=edge.end, end=after.start))
    return Ring(edges=tuple(edges), layer=ring.layer)


def _edge(numbers: tuple[float, ...]) -> Edge:
    """Return a segment (4 numbers) or an arc (5)."""
    if len(numbers) == 4:
        x0, y0, x1, y1 = numbers
        return Segment(start=(x0, y0), end=(x1, y1))
    if len(numbers) != 5:
        raise ValueError(f"an edge has 4 or 5 numbers, got {len(numbers)}")
    x, y, radius, start, sweep = numbers
    if abs(abs(sweep) - 2 * math.pi) < ROUNDED_RAD:
        sweep = math.copysign(2 * math.pi, sweep)  # a circle stays closed
    return Arc(center=(x, y), radius_um=radius, start_rad=start, sweep_rad=sweep)


def _fabricated(made: FabricatedRing, *, hole: bool, layer: str) -> Ring:
    """Return a fabricated ring as edges, in the sense of its kind."""
    sense = -1 if hole else 1
    if made.round_um is not None:
        circle = Arc(
            center=made.center_um, radius_um=made.round_um, start_rad=0.0,
            sweep_rad=sense * math.tau,
        )  # fmt: skip
        return Ring(edges=(circle,), layer=layer)
    corners = [(float(x), float(y)) for x, y in made.corners_um[::sense]]
    ends = corners[1:] + corners[:1]
    edges = (Segment(start=a, end=b) for a, b in zip(corners, ends, strict=True))
    return Ring(edges=tuple(edges), layer=layer)
