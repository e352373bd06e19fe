"""Geometric features of an outline: circles, toothed rings, notches."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from microplan.arrays import Point
from microplan.optics.outline.outline import Arc, Edge, Outline, Ring
from microplan.planner.drawings.biarcs import fit_circle
from microplan.planner.drawings.rings import SAME_UM, same_circle
from microplan.planner.task.regions.teeth import Teeth, samples, teeth_of

LEAST_CORNERS = 8  # of a polygon that may be taken for a circle
# of the radius: what a program that rounds to 1 nm makes of a 2 um circle
_ON = 5e-4
_TRIMMED = 20  # fits without what the one before left off the circle
_CLEAR = 4.0  # chords' heights: what departs by less may be a coarse circle


class NotFoundError(ValueError):
    """The outline has no such feature; the message says what it has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DominantCircle:
    """The circle that most of a ring lies on."""

    center_um: Point
    radius_um: float
    hole: bool
    ring: Ring
    on: tuple[bool, ...]  # per edge of the ring, whether it lies on the circle
    chord_um: float = 0.0  # how far the edges of a polygon run inside it


@dataclass(frozen=True, slots=True, kw_only=True)
class RingNotch:
    """Where a round ring departs from its circle."""

    center_um: Point  # of the circle
    radius_um: float  # of the notch's middle, from that centre
    angle_rad: float  # of the notch's middle, in [0, 2 pi)
    width_um: float  # between the points where it leaves the circle
    depth_um: float


def on_layer(outline: Outline, layer: str) -> tuple[Ring, ...]:
    """Return the rings that came from `layer`, whatever its case."""
    return tuple(r for r in outline.rings if r.layer.lower() == layer.lower())


def circle(rings: Sequence[Ring]) -> DominantCircle:
    """Return the dominant circle of the only ring that has one.

    A ring is round if more than half its length lies on one circle: a notch or a flat
    does not hide a bore. A polygon is round if its corners lie as near to one circle as
    its edges do.
    """
    found = [c for ring in rings if (c := dominant_circle(ring)) is not None]
    if len(found) == 1:
        return found[0]
    if not found:
        raise NotFoundError(f"none of its {len(rings)} rings is a circle")
    said = ", ".join(
        f"R {c.radius_um:.6g} at ({c.center_um[0]:.6g}, {c.center_um[1]:.6g})"
        for c in found[:8]
    )
    raise NotFoundError(f"it holds {len(found)} circles, um: {said}")


def teeth(rings: Sequence[Ring], count: int = 0) -> Teeth:
    """Return the teeth of the only ring that has tips and roots about one centre.

    Of several it is the only one with `count` of them: a cross has four.
    """
    found = [t for ring in rings if (t := teeth_of(ring)) is not None]
    alike = [t for t in found if t.count == count]
    found = alike if len(alike) == 1 else found
    if len(found) != 1:
        raise NotFoundError(
            f"{len(found)} of its {len(rings)} rings have tips and roots about one "
            "centre"
        )
    return found[0]


def notch(rings: Sequence[Ring]) -> RingNotch:
    """Return the only departure of a round ring from its circle."""
    round_ring = circle(rings)
    runs = _runs([not on for on in round_ring.on])
    if len(runs) != 1:
        raise NotFoundError(f"its circle is interrupted {len(runs)} times, not once")
    edges = [round_ring.ring.edges[i] for i in runs[0]]
    (cx, cy), radius = round_ring.center_um, round_ring.radius_um
    start, end = edges[0].start, edges[-1].end
    middle = ((start[0] + end[0]) / 2 - cx, (start[1] + end[1]) / 2 - cy)
    reach = _along(edges, (cx, cy), middle)
    return RingNotch(
        center_um=(cx, cy),
        radius_um=(radius + reach) / 2,
        angle_rad=math.atan2(middle[1], middle[0]) % math.tau,
        width_um=math.dist(start, end),
        depth_um=abs(reach - radius),
    )


def extent(outline: Outline, center: Point | None = None) -> tuple[Point, float]:
    """Return a reference point, and the radius about it that holds `outline`.

    The point is the middle of the outline's box unless `center` is given.
    """
    if center is None:
        x0, y0, x1, y1 = outline.bounds_um
        center = ((x0 + x1) / 2, (y0 + y1) / 2)
    edges = [edge for ring in outline.rings for edge in ring.edges]
    return center, max(_reach(edge, center) for edge in edges)


def dominant_circle(ring: Ring) -> DominantCircle | None:
    """Return the circle that holds more than half of the ring's length."""
    arcs = [edge for edge in ring.edges if isinstance(edge, Arc)]
    if not arcs:
        return _around(ring) or _around_most(ring)
    half = sum(edge.length_um for edge in ring.edges) / 2
    for arc in _frequent(arcs, half):
        on = tuple(
            isinstance(edge, Arc) and same_circle(edge, arc) for edge in ring.edges
        )
        length = sum(
            e.length_um for e, is_on in zip(ring.edges, on, strict=True) if is_on
        )
        if length > half:
            return DominantCircle(
                center_um=arc.center, radius_um=arc.radius_um,
                hole=ring.signed_area_um2 < 0, ring=ring, on=on,
            )  # fmt: skip
    return None


def is_round(outline: Outline) -> bool:
    """Return whether the first ring is a whole circle, as arcs or as a polygon."""
    found = dominant_circle(outline.rings[0])
    return found is not None and all(found.on)


def _frequent(arcs: Sequence[Arc], least_um: float) -> Iterator[Arc]:
    """Yield the arcs about whose circle there is enough length of others.

    Each is compared with those in the cells around its own, not with all.
    """
    cells = [
        tuple(math.floor(v / SAME_UM) for v in (*a.center, a.radius_um)) for a in arcs
    ]
    lengths: dict[tuple[int, ...], float] = {}
    for arc, cell in zip(arcs, cells, strict=True):
        lengths[cell] = lengths.get(cell, 0.0) + arc.length_um
    steps = list(product((-1, 0, 1), repeat=3))
    for arc, (x, y, r) in zip(arcs, cells, strict=True):
        near = sum(lengths.get((x + i, y + j, r + k), 0.0) for i, j, k in steps)
        if near > least_um * (1 - 1e-9):  # sums in another order
            yield arc


def _around(ring: Ring) -> DominantCircle | None:
    """Return the circle that a polygon's corners lie on, in least squares."""
    if len(ring.edges) < LEAST_CORNERS:
        return None
    corners = np.array([edge.start for edge in ring.edges])
    center, radius_um = fit_circle(corners)
    rays = corners - center
    (x, y), (x1, y1) = rays.T, np.roll(rays, -1, axis=0).T
    steps = np.arctan2(x * y1 - y * x1, x * x1 + y * y1)
    widest = math.tau / LEAST_CORNERS
    once = abs(abs(steps.sum()) - math.tau) < 1e-6  # else it goes round elsewhere
    if not (once and (np.abs(steps) <= widest * (1 + 1e-6)).all()):
        return None
    chord_um = radius_um * (1 - math.cos(np.abs(steps).max() / 2))
    off_um = np.abs(np.hypot(*rays.T) - radius_um).max()
    if not off_um <= chord_um:
        return None
    return DominantCircle(
        center_um=center, radius_um=radius_um, hole=ring.signed_area_um2 < 0,
        ring=ring, on=(True,) * len(ring.edges), chord_um=chord_um,
    )  # fmt: skip


def _around_most(ring: Ring) -> DominantCircle | None:
    """Return the circle that most of a polygon lies on, what departs from it clear.

    The fit is repeated without the farther half of what it leaves off the circle.
    """
    corners = np.array([edge.start for edge in ring.edges])
    if len(corners) < LEAST_CORNERS:
        return None
    on = np.ones(len(corners), dtype=np.bool_)
    for _ in range(_TRIMMED):
        center, radius_um = fit_circle(corners[on])
        off = np.abs(np.hypot(*(corners - center).T) - radius_um)
        before, on = on, off <= max(_ON * radius_um, float(np.median(off)))
        if np.count_nonzero(on) < LEAST_CORNERS:
            return None
        if (on == before).all():
            break
    on = off <= _ON * radius_um
    lengths = np.array([edge.length_um for edge in ring.edges])
    widest_um = 2 * radius_um * math.sin(math.pi / LEAST_CORNERS) * (1 + 1e-6)
    both = on & np.roll(on, -1) & (lengths <= widest_um)
    if on.all() or lengths[both].sum() <= lengths.sum() / 2:
        return None
    half = np.minimum(lengths[both].max() / (2 * radius_um), 1.0)
    chord_um = float(radius_um * (1 - math.sqrt(1 - half**2)))
    if off.max() < _CLEAR * chord_um:
        return None
    return DominantCircle(
        center_um=center, radius_um=radius_um, hole=ring.signed_area_um2 < 0,
        ring=ring, on=tuple(both.tolist()), chord_um=chord_um,
    )  # fmt: skip


def _runs(marks: Sequence[bool]) -> list[list[int]]:
    """Return runs of marked positions around a ring, each in order."""
    if all(marks):
        return [list(range(len(marks)))]
    first = next(i for i, mark in enumerate(marks) if not mark)
    runs: list[list[int]] = []
    fresh = True
    for step in range(len(marks)):
        i = (first + step) % len(marks)
        if marks[i]:
            if fresh:
                runs.append([])
            runs[-1].append(i)
        fresh = not marks[i]
    return runs


def _along(edges: Sequence[Edge], center: Point, axis: Point) -> float:
    """Return the distance from `center` at which `edges` cross the axis."""
    points = [point for edge in edges for point in samples(edge)]
    rays = [(x - center[0], y - center[1]) for x, y in points]
    sides = [axis[0] * y - axis[1] * x for x, y in rays]
    for (a, b), (p, q) in zip(pairwise(sides), pairwise(rays), strict=True):
        if a * b <= 0 and a != b:
            share = a / (a - b)
            x, y = p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])
            if x * axis[0] + y * axis[1] > 0:
                return math.hypot(x, y)
    raise NotFoundError("its notch does not cross its own middle")


def _reach(edge: Edge, center: Point) -> float:
    """Return the largest distance from `center` to a point of the edge, exact."""
    ends = max(math.dist(edge.start, center), math.dist(edge.end, center))
    if not isinstance(edge, Arc):
        return ends
    dx, dy = edge.center[0] - center[0], edge.center[1] - center[1]
    away = math.hypot(dx, dy)
    turn = math.remainder(math.atan2(dy, dx) - edge.start_rad, math.tau)
    turn = turn if turn * edge.sweep_rad >= 0 else turn + math.copysign(
        math.tau, edge.sweep_rad
    )  # fmt: skip
    passes = edge.is_circle or abs(turn) <= abs(edge.sweep_rad) or away == 0
    return away + edge.radius_um if passes else ends
