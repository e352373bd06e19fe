"""Outlines of planar parts: segments and arcs, chained into closed rings with holes.

Values only. Lengths are um in the frame of the caller's choice (part or world).
Outer rings run counter-clockwise and holes clockwise, so that the signed area of an
outline is the sum over its rings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from microplan.arrays import FloatArray, Point

# Two edge ends closer than this are the same point: a tenth of a nanometre is far
# below any drawing's resolution and far above the rounding of 1e4 um coordinates.
JOIN_UM = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """A straight edge from `start` to `end`, um."""

    start: Point
    end: Point

    def __post_init__(self) -> None:
        if not all(math.isfinite(c) for c in (*self.start, *self.end)):
            raise ValueError(f"segment ends must be finite, got {self}")

    @property
    def length_um(self) -> float:
        """Return the length of the edge."""
        return math.dist(self.start, self.end)


@dataclass(frozen=True, slots=True, kw_only=True)
class Arc:
    """A circular edge; `sweep_rad` is positive counter-clockwise, 2 pi is a circle."""

    center: Point
    radius_um: float
    start_rad: float
    sweep_rad: float

    def __post_init__(self) -> None:
        values = (*self.center, self.radius_um, self.start_rad, self.sweep_rad)
        if not all(math.isfinite(c) for c in values):
            raise ValueError(f"arc values must be finite, got {self}")
        if not self.radius_um > 0:
            raise ValueError(f"radius_um must be positive, got {self.radius_um}")
        if not 0 < abs(self.sweep_rad) <= 2 * math.pi * (1 + 1e-12):
            raise ValueError(f"sweep_rad must be in (0, 2 pi], got {self.sweep_rad}")

    def at(self, fraction: float) -> Point:
        """Return the point after `fraction` (0..1) of the sweep, um."""
        angle = self.start_rad + fraction * self.sweep_rad
        return (
            self.center[0] + self.radius_um * math.cos(angle),
            self.center[1] + self.radius_um * math.sin(angle),
        )

    @property
    def start(self) -> Point:
        """Return where the arc begins, um."""
        return self.at(0.0)

    @property
    def end(self) -> Point:
        """Return where the arc ends, um."""
        return self.at(1.0)

    @property
    def length_um(self) -> float:
        """Return the arc length."""
        return self.radius_um * abs(self.sweep_rad)

    @property
    def is_circle(self) -> bool:
        """Return whether the arc closes on itself."""
        return abs(abs(self.sweep_rad) - 2 * math.pi) < 1e-9


Edge = Segment | Arc


@dataclass(frozen=True, slots=True, kw_only=True)
class Ring:
    """A closed chain of edges, each starting where the one before ends.

    `layer` is the drawing layer the ring came from, "" where there is none.
    """

    edges: tuple[Edge, ...]
    layer: str = ""

    def __post_init__(self) -> None:
        if not self.edges:
            raise ValueError("a ring needs at least one edge")
        for edge, after in zip(
            self.edges, self.edges[1:] + self.edges[:1], strict=True
        ):
            gap = math.dist(edge.end, after.start)
            if gap > JOIN_UM:
                raise ValueError(
                    f"ring is open: gap of {gap:.6g} um at {edge.end}, "
                    f"at most {JOIN_UM}"
                )

    @property
    def signed_area_um2(self) -> float:
        """Return the enclosed area, positive if counter-clockwise."""
        return sum(_swept_area(edge) for edge in self.edges)

    def reversed(self) -> Ring:
        """Return the ring in the opposite direction."""
        return Ring(
            edges=tuple(_reverse(edge) for edge in reversed(self.edges)),
            layer=self.layer,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Outline:
    """Rings of one part: outer ones counter-clockwise, holes clockwise."""

    rings: tuple[Ring, ...]
    _hash: int = field(default=0, init=False, repr=False, compare=False)

    def __hash__(self) -> int:
        """Return a hash of the edges, found once: keys of caches ask for it often."""
        found = getattr(self, "_hash", 0)  # not in what was pickled without it
        if found == 0:
            # of numbers alone: the same in any process
            found = hash(tuple(ring.edges for ring in self.rings))
            object.__setattr__(self, "_hash", found)
        return found

    @property
    def area_um2(self) -> float:
        """Return the area, holes taken off."""
        return sum(ring.signed_area_um2 for ring in self.rings)

    @property
    def perimeter_um(self) -> float:
        """Return the total length of all rings."""
        return sum(edge.length_um for ring in self.rings for edge in ring.edges)

    @property
    def bounds_um(self) -> tuple[float, float, float, float]:
        """Return (x_min, y_min, x_max, y_max), exact for arcs."""
        boxes = [edge_bounds(edge) for ring in self.rings for edge in ring.edges]
        return (
            min(box[0] for box in boxes),
            min(box[1] for box in boxes),
            max(box[2] for box in boxes),
            max(box[3] for box in boxes),
        )


def place(
    outline: Outline, x_um: float, y_um: float, theta_rad: float = 0.0
) -> Outline:
    """Return `outline` rotated about its origin by `theta_rad`, then shifted."""
    c, s = math.cos(theta_rad), math.sin(theta_rad)

    def moved(point: Point) -> Point:
        x, y = point
        return (c * x - s * y + x_um, s * x + c * y + y_um)

    def placed(edge: Edge) -> Edge:
        if isinstance(edge, Segment):
            return Segment(start=moved(edge.start), end=moved(edge.end))
        return Arc(
            center=moved(edge.center),
            radius_um=edge.radius_um,
            start_rad=edge.start_rad + theta_rad,
            sweep_rad=edge.sweep_rad,
        )

    return Outline(
        rings=tuple(
            Ring(edges=tuple(map(placed, ring.edges)), layer=ring.layer)
            for ring in outline.rings
        )
    )


def flatten(ring: Ring, chord_um: float) -> FloatArray:
    """Return the corners of `ring` with arcs split into chords.

    Parameters
    ----------
    chord_um : float
        Largest distance between an arc and its chord (sagitta), um, > 0.

    Returns
    -------
    (N, 2) float64 array
        Points in order, the first not repeated, um. Points of arcs lie on the arc.

    Raises
    ------
    ValueError
        If `chord_um` is not positive.
    """
    if not chord_um > 0:
        raise ValueError(f"chord_um must be positive, got {chord_um}")
    parts = [_chord_starts(edge, chord_um) for edge in ring.edges]
    return np.concatenate(parts)


def _chord_starts(edge: Edge, chord_um: float) -> FloatArray:
    """Return where the chords of one edge begin, (N, 2) um."""
    if isinstance(edge, Segment):
        return np.array([edge.start], dtype=np.float64)
    count = chords(edge, chord_um)
    angle = edge.start_rad + np.arange(count) / count * edge.sweep_rad
    unit = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.array(edge.center) + edge.radius_um * unit


def chords(arc: Arc, chord_um: float) -> int:
    """Return how many chords keep the sagitta below `chord_um`, at least 3 a circle."""
    half = math.acos(max(1 - chord_um / arc.radius_um, 0.5))  # never above 60 degrees
    return max(1, math.ceil(abs(arc.sweep_rad) / (2 * half) - 1e-12))


def _swept_area(edge: Edge) -> float:
    """Return the area swept by the ray from the origin to a point on `edge`, um2."""
    (x0, y0), (x1, y1) = edge.start, edge.end
    chord = (x0 * y1 - x1 * y0) / 2
    if isinstance(edge, Segment):
        return chord
    return chord + edge.radius_um**2 / 2 * (edge.sweep_rad - math.sin(edge.sweep_rad))


def _reverse(edge: Edge) -> Edge:
    """Return the edge run from its end to its start."""
    if isinstance(edge, Segment):
        return Segment(start=edge.end, end=edge.start)
    return Arc(
        center=edge.center,
        radius_um=edge.radius_um,
        start_rad=edge.start_rad + edge.sweep_rad,
        sweep_rad=-edge.sweep_rad,
    )


def edge_bounds(edge: Edge) -> tuple[float, float, float, float]:
    """Return the box around one edge; an arc adds the axis points it passes."""
    points = [edge.start, edge.end]
    if isinstance(edge, Arc):
        low, high = sorted((edge.start_rad, edge.start_rad + edge.sweep_rad))
        first = math.ceil(low / (math.pi / 2))
        for k in range(first, math.floor(high / (math.pi / 2)) + 1):
            (cx, cy), r = edge.center, edge.radius_um
            dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[k % 4]
            points.append((cx + r * dx, cy + r * dy))
    xs, ys = zip(*points, strict=True)
    return (min(xs), min(ys), max(xs), max(ys))
