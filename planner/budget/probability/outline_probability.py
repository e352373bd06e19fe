"""Probability that a peg of any outline goes into its hole.

The mass of the error (x, y, theta) inside the free region, whose slices at constant
angle are polygons: exact over x and y, by nested Clenshaw-Curtis rules over theta on
panels that are halved until two of them agree, by Gauss nodes over the sizes as
fabricated. Slices do not depend on the error, and panels are dyadic parts of the
circle, so that another error meets the slices of the one before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from shapely.geometry import Polygon

from microplan.arrays import FloatArray
from microplan.planner.assembly.fits.peg_in_hole import (
    PolygonEdges,
    Size,
    Slices,
    slices_of,
)
from microplan.planner.budget.probability.angle_density import (
    angle_density,
    angle_mass,
)
from microplan.planner.budget.probability.outline_fit import OutlineFit, PoseError
from microplan.planner.budget.probability.polygon_mass import masses
from microplan.planner.budget.probability.region_pieces import (
    components,
    planned_piece,
)

# Between two rules a panel may differ by this share of the rarer outcome, or this much.
CLOSE, NEGLIGIBLE = 1e-3, 1e-9
FINEST = 2.0**-30  # of the circle: no panel is shorter
EXACT = 16 * FINEST  # an angle known better has no error: panels see its density
WIDEST_SIGMAS = 3.0  # of a panel: nine nodes see an angle's density over that
LEAST_ROOM = 1e-3  # of the hole's size: pieces shorter than that may be missed
RARE = 1e-7  # share of angles of which one slice is enough


@dataclass(frozen=True, slots=True, kw_only=True)
class Seating:
    """Probabilities of what comes of an insertion; they add up to 1."""

    seated: float  # in the piece of the region that holds the planned pose
    elsewhere: float  # in another one
    miss: float  # neither; its own digits kept


def seating(fit: OutlineFit, error: PoseError) -> Seating:
    """Return the probabilities that a peg goes in as planned, otherwise, or not.

    Parameters
    ----------
    fit : OutlineFit
        Peg and hole.
    error : PoseError
        Law of the error.

    Returns
    -------
    Seating
        Averaged over the sizes as fabricated.
    """
    integral = _Integral(
        slices=slices_of(fit.shape), sizes=tuple(fit.sizes(error)), error=error
    )
    found = (min(1.0, max(0.0, value)) for value in integral.outcomes())
    seated, elsewhere, miss = found
    return Seating(seated=seated, elsewhere=elsewhere, miss=miss)


@dataclass(frozen=True, slots=True, eq=False)
class _Node:
    """Slices of all sizes at one angle, with their parts in the integral."""

    turn_rad: float
    slices: tuple[tuple[Polygon, ...], ...]  # (sizes) the pieces of each
    hits: tuple[FloatArray, ...]  # (sizes) of each piece, times the weights


@dataclass(slots=True, kw_only=True, eq=False)
class _Integral:
    """The integral over angle and sizes."""

    slices: Slices
    sizes: tuple[Size, ...]
    error: PoseError
    nodes: list[_Node] = field(default_factory=list)
    miss: float = 0.0

    def outcomes(self) -> tuple[float, float, float]:
        """Return P(as planned), P(otherwise) and P(not)."""
        freely = self.slices.fit.turns_freely
        if freely or self.error.angle.sigma_rad <= EXACT:
            turns = np.array([0.0 if freely else self.error.middle_rad])
            self._record(turns, np.ones(1), *self._at(turns)[1:])
        else:
            self._panel(-math.pi, math.pi)
        total = sum(float(hit.sum()) for node in self.nodes for hit in node.hits)
        planned = sum(self._planned(k) for k in range(len(self.sizes)))
        return planned, total - planned, self.miss

    def _panel(self, low: float, high: float) -> None:
        """Add the integral over a panel, or over its halves."""
        middle, half = (low + high) / 2, (high - low) / 2
        angle = self.error.angle
        inside = angle_mass(angle, self.error.middle_rad, low, high)
        if inside <= 0:
            return
        if half <= FINEST or inside <= NEGLIGIBLE or self._is_blocked(middle, half):
            self.miss += inside
            none: tuple[tuple[Polygon, ...], ...] = ((),) * len(self.sizes)
            self.nodes.append(_Node(middle, none, (np.empty(0),) * len(self.sizes)))
            return
        if inside <= RARE:
            self._record(
                np.array([middle]),
                np.array([inside]),
                *self._at(np.array([middle]))[1:],
            )
            return
        widest = WIDEST_SIGMAS * angle.sigma_rad
        if 2 * half <= widest and self._rule(middle, half):
            return
        self._panel(low, middle)
        self._panel(middle, high)

    def _is_blocked(self, middle: float, half: float) -> bool:
        """Return whether the peg goes in at no angle of a panel, at no size.

        Turned by half of it, no point of the peg moves farther than its distance from
        the reference point times that.
        """
        far_um = half * self.slices.reach_um
        if far_um > self.slices.fit.size_um:
            return False
        widest = max(size.hole_um for size in self.sizes)
        thinnest = min(size.peg_um for size in self.sizes)
        return not self.slices.at(middle, widest + far_um, thinnest)

    def _rule(self, middle: float, half: float) -> bool:
        """Add a panel if two rules agree on it; return whether they do."""
        turns = middle + half * _POINTS
        angle, middle_rad = self.error.angle, self.error.middle_rad
        density = angle_density(angle, middle_rad, turns) * half
        hit, slices, hits, miss = self._at(turns)
        fine, coarse = (np.array([hit, miss]) * density @ w for w in (_FINE, _COARSE))
        if any(not each for found in slices for each in found) and not self._sees(half):
            return False
        off = np.abs(fine - coarse)
        if off.max() > max(CLOSE * fine.min(), CLOSE * half / math.tau / 4, NEGLIGIBLE):
            return False
        self._record(turns, density * _FINE, slices, hits, miss)
        return True

    def _sees(self, half: float) -> bool:
        """Return whether nine angles of a panel cannot all miss a piece of note.

        A piece is about as long as what turns a point by the room that there is.
        """
        room_um = max(self.slices.capture_um(), LEAST_ROOM * self.slices.fit.size_um)
        return half * self.slices.reach_um <= room_um

    def _record(
        self,
        turns: FloatArray,
        weights: FloatArray,
        slices: Sequence[tuple[tuple[Polygon, ...], ...]],
        hits: Sequence[tuple[FloatArray, ...]],
        miss: FloatArray,
    ) -> None:
        """Add slices with their weights."""
        for k, turn in enumerate(turns.tolist()):
            parts = tuple(weights[k] * each for each in hits[k])
            self.nodes.append(_Node(turn, slices[k], parts))
        self.miss += float(weights @ miss)

    def _at(
        self, turns: FloatArray
    ) -> tuple[
        FloatArray,
        list[tuple[tuple[Polygon, ...], ...]],
        list[tuple[FloatArray, ...]],
        FloatArray,
    ]:
        """Return P inside, (N,), slices, P of their pieces, and P outside, (N,)."""
        found = [self.slices.edges_at(turn, self.sizes) for turn in turns.tolist()]
        counts = np.array([[len(s) for s in slices] for slices, _ in found])
        off = np.repeat(turns - self.error.middle_rad, counts.sum(axis=1))
        shifts = off[:, None] * np.array(self.error.lever_um)
        inside, outside = masses(
            _together([edges for _, edges in found]), self.error.plane, shifts
        )
        weight = np.array([size.weight for size in self.sizes])
        ends = np.cumsum(counts.ravel())
        within = np.split(inside, ends)[:-1]
        beyond = np.split(outside, ends)[:-1]
        misses = [_outside(*pair) for pair in zip(within, beyond, strict=True)]
        hits = [
            tuple(w * each for w, each in zip(weight, row, strict=True))
            for row in _rows(within, len(weight))
        ]
        hit = np.array([sum(float(each.sum()) for each in row) for row in hits])
        miss = np.array(misses).reshape(counts.shape) @ weight
        return hit, [slices for slices, _ in found], hits, miss

    def _planned(self, size: int) -> float:
        """Return P in the piece of the region that holds the planned pose."""
        nodes = sorted(self.nodes, key=lambda node: node.turn_rad)
        if all(len(node.slices[size]) == 1 for node in nodes):
            return sum(float(node.hits[size][0]) for node in nodes)
        slices = [node.slices[size] for node in nodes]
        turns = [node.turn_rad for node in nodes]
        names = components(turns, slices)
        start = planned_piece(turns, slices, names, self.slices.reach_um)
        return sum(
            float(hit)
            for node, owned in zip(nodes, names, strict=True)
            for hit, name in zip(node.hits[size], owned, strict=True)
            if name == start
        )


def _rows(items: Sequence[FloatArray], width: int) -> list[Sequence[FloatArray]]:
    return [items[k : k + width] for k in range(0, len(items), width)]


def _outside(inside: FloatArray, outside: FloatArray) -> float:
    """Return P outside all pieces; the rarer outcome keeps its digits."""
    if not len(inside):
        return 1.0
    least = int(np.argmin(outside))
    return max(float(outside[least] - (inside.sum() - inside[least])), 0.0)


def _together(found: Sequence[PolygonEdges]) -> PolygonEdges:
    """Return all edges, owners counted on."""
    before = np.cumsum([0, *(edges.count for edges in found)])
    owners = [edges.owner + n for edges, n in zip(found, before, strict=False)]
    return PolygonEdges(
        starts_um=np.concatenate([edges.starts_um for edges in found]),
        ends_um=np.concatenate([edges.ends_um for edges in found]),
        owner=np.concatenate(owners),
        count=int(before[-1]),
    )


def _clenshaw_curtis(count: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes, rising, and weights in -1..1; (count + 1,) each, count even."""
    k = np.arange(count + 1)
    powers = np.arange(0, count + 1, 2)
    terms = np.cos(np.outer(k, powers) * math.pi / count)
    share = 2.0 / (1 - powers**2)
    share[0] /= 2
    share[-1] /= 2
    weights = (terms * share).sum(axis=1) * 2 / count
    weights[[0, -1]] /= 2
    return -np.cos(k * math.pi / count), weights


def _embedded() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return nine nodes, their weights, and the weights of the five among them."""
    points, fine = _clenshaw_curtis(8)
    coarse = np.zeros(9)
    coarse[::2] = _clenshaw_curtis(4)[1]
    return points, fine, coarse


_POINTS, _FINE, _COARSE = _embedded()
