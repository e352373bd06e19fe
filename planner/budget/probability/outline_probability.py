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
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy import special
from shapely.geometry import Point, Polygon

from microplan.arrays import FloatArray
from microplan.planner.assembly.fits.peg_in_hole import (
    PegInHole,
    PolygonEdges,
    Size,
    Slices,
    slices_of,
)
from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.budget.probability.polygon_mass import (
    PlaneError,
    masses,
)

ANGLE_SIGMAS = 8.0  # beyond which 1e-15 of an angle's error lies
# Between two rules a panel may differ by this share of the rarer outcome, or this much.
CLOSE, NEGLIGIBLE = 1e-3, 1e-9
FINEST = 2.0**-30  # of the circle: no panel is shorter
WIDEST_SIGMAS = 3.0  # of a panel: nine nodes see an angle's density over that
RARE = 1e-7  # share of angles of which one slice is enough
FREE_ANGLE_RAD = math.pi  # one sigma, from which on every angle is as likely
SIZES = ((1.0, 3), (3.0, 4), (10.0, 6), (math.inf, 8))  # power: nodes a side
LEFT_COUNTS = 0.5  # share of a cut-off residual's sigma that smooths like a normal one


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlineFit:
    """A planar peg and hole, edges as drawn, with what fabrication adds."""

    shape: PegInHole
    hole_tolerance_um: float  # hard limit of the edge's error, uniform within
    shaft_tolerance_um: float
    taper_um: float = 0.0  # what leaning walls take on each side
    wider_um: float = 0.0  # by which the hole's edge is farther out than drawn

    @property
    def capture_um(self) -> float:
        """Return the largest sideways error that still goes in, sizes as drawn."""
        return self.capture_at(0.0)

    def capture_at(self, thicker_um: float) -> float:
        """Return the distance from the planned place to the edge of its slice.

        `thicker_um` is what both edges together take; 0 where the place is not free.
        """
        slices, middle = slices_of(self.shape), Point(0.0, 0.0)
        pieces = slices.at(0.0, self.wider_um - self.taper_um - thicker_um)
        holding = next((p for p in pieces if p.contains(middle)), None)
        return 0.0 if holding is None else float(holding.boundary.distance(middle))

    def scaled(self, factor: float) -> OutlineFit:
        """Return the same fit with other tolerances."""
        return replace(
            self,
            hole_tolerance_um=self.hole_tolerance_um * factor,
            shaft_tolerance_um=self.shaft_tolerance_um * factor,
        )

    def widened(self, wider_um: float) -> OutlineFit:
        """Return the same fit with the hole's edge farther out."""
        return replace(self, wider_um=self.wider_um + wider_um)

    def sizes(self, error: PoseError) -> list[Size]:
        """Return sizes as fabricated, as many as the error asks for.

        Across a tolerance t a rare outcome changes by the power of t times capture
        radius over the least variance.
        """
        tolerance = max(self.hole_tolerance_um, self.shaft_tolerance_um)
        rest, left = error.plane.rest.principal[0], error.plane.residual.sigma_um
        square = max(rest**2, (LEFT_COUNTS * left) ** 2, 1e-12)
        power = tolerance * max(self.capture_um, tolerance) / square
        count = next(nodes for most, nodes in SIZES if power <= most)
        base = self.wider_um - self.taper_um
        return [
            Size(hole_um=base + hole, peg_um=peg, weight=a * b)
            for hole, a in _uniform(self.hole_tolerance_um, count)
            for peg, b in _uniform(self.shaft_tolerance_um, count)
        ]


def _uniform(tolerance_um: float, count: int) -> list[tuple[float, float]]:
    """Return nodes and weights of a uniform distribution within a tolerance."""
    if tolerance_um <= 0:
        return [(0.0, 1.0)]
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return list(
        zip((tolerance_um * nodes).tolist(), (weights / 2).tolist(), strict=True)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseError:
    """Error of a peg's pose in the frame of its hole."""

    plane: PlaneError  # of the place, at no error of the angle
    angle: AngleError
    # what an error of the angle moves the place by, um per rad
    lever_um: tuple[float, float] = (0.0, 0.0)
    middle_rad: float = 0.0  # of the angle


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
        if freely or self.error.angle.sigma_rad <= 0:
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
        inside = angle_mass(self.error, low, high)
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
        widest = WIDEST_SIGMAS * self.error.angle.sigma_rad
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
        density = angle_density(self.error, turns) * half
        hit, slices, hits, miss = self._at(turns)
        fine, coarse = (np.array([hit, miss]) * density @ w for w in (_FINE, _COARSE))
        off = np.abs(fine - coarse)
        if off.max() > max(CLOSE * fine.min(), CLOSE * half / math.tau / 4, NEGLIGIBLE):
            return False
        self._record(turns, density * _FINE, slices, hits, miss)
        return True

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
        names = _components(turns, slices)
        start = self._start(turns, slices, names)
        return sum(
            float(hit)
            for node, owned in zip(nodes, names, strict=True)
            for hit, name in zip(node.hits[size], owned, strict=True)
            if name == start
        )

    def _start(
        self,
        turns: Sequence[float],
        slices: Sequence[tuple[Polygon, ...]],
        names: Sequence[list[int]],
    ) -> int:
        """Return the piece that holds the planned pose, else the nearest one."""
        middle, reach_um = Point(0.0, 0.0), self.slices.reach_um
        found = [
            (abs(turn) * reach_um + piece.distance(middle), name)
            for turn, pieces, owned in zip(turns, slices, names, strict=True)
            for piece, name in zip(pieces, owned, strict=True)
        ]
        return min(found)[1] if found else -1


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


def _components(
    turns: Sequence[float], slices: Sequence[tuple[Polygon, ...]]
) -> list[list[int]]:
    """Return a name for each piece of each slice: one for what hangs together.

    Pieces of neighbouring slices that overlap do; so do the first and last ones.
    """
    names: list[list[int]] = []
    parents: list[int] = []
    for pieces in slices:
        names.append(list(range(len(parents), len(parents) + len(pieces))))
        parents += names[-1]
    pairs = list(pairwise(range(len(slices))))
    if turns[-1] - turns[0] >= math.tau - 1e-9:
        pairs.append((len(slices) - 1, 0))
    for here, there in pairs:
        for one, a in zip(slices[here], names[here], strict=True):
            for other, b in zip(slices[there], names[there], strict=True):
                if one is other or one.intersects(other):
                    parents[_root(parents, a)] = _root(parents, b)
    return [[_root(parents, name) for name in owned] for owned in names]


def _root(parents: list[int], name: int) -> int:
    while parents[name] != name:
        name = parents[name]
    return name


def angle_density(error: PoseError, turns: FloatArray) -> FloatArray:
    """Return the density of the angle's error, per rad, at turns (N,).

    A normal one of s cut off at c plus a normal one of r: the normal one of both times
    the share of what was cut off that leads there.
    """
    angle, off = error.angle, turns - error.middle_rad
    sigma = _uncut(angle)
    if sigma >= FREE_ANGLE_RAD and math.isinf(angle.cut_rad):
        return np.full(len(turns), 1 / math.tau)
    more = math.ceil(max(ANGLE_SIGMAS * sigma - math.pi, 0.0) / math.tau)
    around = off[:, None] + math.tau * np.arange(-more, more + 1)
    density = np.exp(-((around / sigma) ** 2) / 2) / sigma / math.sqrt(math.tau)
    if not math.isinf(angle.cut_rad) and angle.left_rad > 0:
        density = density * _cut_share(angle, around) / angle.left_inside
    found: FloatArray = density.sum(axis=1)
    return found


def _uncut(angle: AngleError) -> float:
    return math.hypot(angle.left_rad, angle.rest_rad)


def _cut_share(angle: AngleError, off: FloatArray) -> FloatArray:
    """Return the probability that an error `off` left from inside the cut, (N,)."""
    left, rest, cut = angle.left_rad, angle.rest_rad, angle.cut_rad
    if rest <= 0:
        return (np.abs(off) < cut).astype(np.float64)
    middle = off * (left / _uncut(angle)) ** 2
    sigma = left * rest / _uncut(angle)
    ends = [special.ndtr((side * cut - middle) / sigma) for side in (1, -1)]
    share: FloatArray = ends[0] - ends[1]
    return share


def angle_mass(error: PoseError, low: float, high: float) -> float:
    """Return the probability that the angle's error ends between two turns."""
    reach = ANGLE_SIGMAS * _uncut(error.angle)
    if _uncut(error.angle) < FREE_ANGLE_RAD:
        low = max(low, error.middle_rad - reach)
        high = min(high, error.middle_rad + reach)
    if high <= low:
        return 0.0
    count = 1 + math.ceil((high - low) / max(_uncut(error.angle), 1e-12) / 2)
    cuts = np.linspace(low, high, count + 1)
    half = np.diff(cuts)[:, None] / 2
    turns = cuts[:-1, None] + half * (1 + _GAUSS[0])
    density = angle_density(error, turns.ravel()).reshape(turns.shape)
    return float((half * density * _GAUSS[1]).sum())


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
_GAUSS = np.polynomial.legendre.leggauss(12)
