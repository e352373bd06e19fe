"""Random outlines of pegs and holes, by families."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from microplan.arrays import Point
from microplan.optics.outline.outline import Arc, Edge, Outline, Ring, Segment

FAMILIES = (
    "D", "rectangle", "slot", "key", "keyway", "cross", "spline", "square", "dumbbell",
    "L", "star", "hexagon",
)  # fmt: skip
NON_CONVEX = ("key", "keyway", "cross", "spline", "dumbbell", "L", "star")
SEVERAL = ("cross", "spline", "square", "dumbbell", "hexagon")  # pieces of the region
# Shares of the size: so little that no hexagon or square turns from a fit to the next.
GAPS = {
    "square": (0.1, 0.22),
    "hexagon": (0.03, 0.065),
    "cross": (0.08, 0.2),
    "spline": (0.03, 0.08),
    "dumbbell": (0.1, 0.3),
}  # shares of the size


def closed(points: Sequence[Point]) -> Outline:
    """Return a counter-clockwise polygon."""
    ends = [*points[1:], points[0]]
    edges = (Segment(start=a, end=b) for a, b in zip(points, ends, strict=True))
    return Outline(rings=(Ring(edges=tuple(edges)),))


def hollow(outline: Outline) -> Outline:
    """Return the same ring as that of a hole."""
    return Outline(rings=(outline.rings[0].reversed(),))


def _arc(radius: float, start: float, end: float) -> Arc:
    return Arc(
        center=(0.0, 0.0), radius_um=radius, start_rad=start, sweep_rad=end - start
    )


def chain(edges: Sequence[Edge]) -> Outline:
    """Return a ring of edges, straight ones put in where ends are apart."""
    found: list[Edge] = []
    for edge, after in zip(edges, [*edges[1:], edges[0]], strict=True):
        found.append(edge)
        if math.dist(edge.end, after.start) > 1e-9:
            found.append(Segment(start=edge.end, end=after.start))
    return Outline(rings=(Ring(edges=tuple(found)),))


def d_shape(radius: float, flat: float) -> Outline:
    """Return a circle with a flat at a distance from its centre."""
    half = math.acos(flat / radius)
    return chain([_arc(radius, half, math.tau - half)])


def box(x: float, y: float) -> Outline:
    """Return a rectangle of half sides."""
    return closed([(-x, -y), (x, -y), (x, y), (-x, y)])


def slot(half: float, radius: float) -> Outline:
    """Return a rectangle with round ends about (+-half, 0)."""
    return chain(
        [
            Arc(center=(x, 0.0), radius_um=radius, start_rad=a, sweep_rad=math.pi)
            for x, a in ((half, -math.pi / 2), (-half, math.pi / 2))
        ]
    )


def keyed(radius: float, reach: float, width: float) -> Outline:
    """Return a circle with a rectangle out to `reach`, or in to it, at 90 degrees."""
    half = math.asin(width / 2 / radius)
    y = math.sqrt(radius**2 - width**2 / 4)
    w = width / 2
    way: list[Edge] = [
        Segment(start=(w, y), end=(w, reach)),
        Segment(start=(w, reach), end=(-w, reach)),
        Segment(start=(-w, reach), end=(-w, y)),
    ]
    return chain([_arc(radius, math.pi / 2 + half, 2.5 * math.pi - half), *way])


def cross(reach: float, half: float) -> Outline:
    """Return a plus sign."""
    r, h = reach, half
    return closed(
        [(-r, -h), (-h, -h), (-h, -r), (h, -r), (h, -h), (r, -h),
         (r, h), (h, h), (h, r), (-h, r), (-h, h), (-r, h)]
    )  # fmt: skip


def spline(count: int, outer: float, inner: float, more: float) -> Outline:
    """Return teeth of a quarter pitch plus `more` um on each side."""
    pitch = math.tau / count
    edges: list[Edge] = []
    for k in range(count):
        tip, root = pitch / 4 + more / outer, pitch / 4 + more / inner
        edges.append(_arc(outer, k * pitch - tip, k * pitch + tip))
        edges.append(_arc(inner, k * pitch + root, (k + 1) * pitch - root))
    return chain(edges)


def star(radii: Sequence[float]) -> Outline:
    """Return a polygon with corners at equal angles."""
    turns = [math.tau * k / len(radii) for k in range(len(radii))]
    return closed(
        [(r * math.cos(t), r * math.sin(t)) for r, t in zip(radii, turns, strict=True)]
    )


def ell(long: float, wide: float) -> Outline:
    """Return an L about the middle of its corner."""
    a, w = long, wide / 2
    return closed([(-w, -w), (a, -w), (a, w), (w, w), (w, a), (-w, a)])


def dumbbell(apart: float, half: float, neck: float) -> Outline:
    """Return two squares, the left one about 0, joined by a neck."""
    h, n = half, neck
    return closed(
        [(-h, -h), (h, -h), (h, -n), (apart - h, -n), (apart - h, -h), (apart + h, -h),
         (apart + h, h), (apart - h, h), (apart - h, n), (h, n), (h, h), (-h, h)]
    )  # fmt: skip


def outlines(
    family: str, rng: np.random.Generator, size: float, gap: float
) -> tuple[Outline, Outline]:
    """Return a hole's ring, counter-clockwise, and a peg, about `gap` apart all round.

    Both are drawn by themselves, so that the gap differs from edge to edge.
    """
    s, g = size, gap
    more = g * rng.uniform(0.6, 1.6, 3)
    a = rng.uniform(0.3, 0.8)
    if family == "D":
        return d_shape(s + more[0], a * s + more[1]), d_shape(s, a * s)
    if family == "rectangle":
        return box(s + more[0], a * s + more[1]), box(s, a * s)
    if family == "slot":
        return slot(s, a * s + more[1]), slot(s - more[0] / 3, a * s)
    if family == "key":
        wide = 0.5 * a * s
        return (
            keyed(s + more[0], 1.3 * s + more[1], wide + 2 * more[2]),
            keyed(s, 1.3 * s, wide),
        )
    if family == "keyway":
        wide = 0.5 * a * s
        return (
            keyed(s + more[0], 0.7 * s + more[1], wide),
            keyed(s, 0.7 * s, wide + 2 * more[2]),
        )
    if family == "cross":
        return cross(s + more[0], 0.4 * a * s + more[1]), cross(s, 0.4 * a * s)
    if family == "spline":
        count = int(rng.integers(4, 9))
        return (
            spline(count, s + more[0], 0.8 * s + more[1], more[2]),
            spline(count, s, 0.8 * s, 0.0),
        )
    if family == "square":
        return box(s + more[0], s + more[0]), box(s, s)
    if family == "hexagon":
        return star([s + 1.2 * more[0]] * 6), star([s] * 6)
    if family == "dumbbell":
        # the neck lets no peg through at the angles that occur
        return dumbbell(2 * s + 4 * g, s + more[0], 0.6 * s), box(s, s)
    if family == "L":
        return ell(s + more[0], a * s + 2 * more[1]), ell(s, a * s)
    radii = s * rng.uniform(0.55, 1.0, 9)
    return star((radii + 1.4 * more.mean()).tolist()), star(radii.tolist())
