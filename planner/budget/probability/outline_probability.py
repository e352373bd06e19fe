"""Probability that a peg of any outline goes into its hole.

The mass of the error (x, y, theta) inside the free region, whose slices at constant
angle are polygons: exact over x and y, by Gauss nodes over the sizes as fabricated, and
over theta by polynomials through the masses of a panel's slices times the angle's
density, whose moments are exact: a panel is as wide as the masses are smooth, however
narrow the density is. The panels that count most are halved until two rules agree.
Slices do not depend on the error, and panels are dyadic parts of the circle, so that
another error meets the slices of the one before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray, IntArray
from microplan.planner.assembly.fits.peg_in_hole import (
    Pieces,
    Size,
    Slices,
    edges_of,
    slices_of,
)
from microplan.planner.budget.probability.angle_density import (
    angle_moments,
)
from microplan.planner.budget.probability.outline_fit import OutlineFit, PoseError
from microplan.planner.budget.probability.polygon_mass import masses
from microplan.planner.budget.probability.region_pieces import (
    components,
    planned_piece,
)

NEGLIGIBLE = 1e-13  # probability that does not matter
HALVINGS = 1000  # of panels, at most: then rounding keeps the rules apart
FINEST = 2.0**-30  # of the circle: no panel is shorter
EXACT = 16 * FINEST  # an angle known better has no error: panels see its density
# Half a panel's width in sigmas of the angle: where neighbouring slices must overlap,
# and where all of the density is within two panels.
NEAR_SIGMAS, FAR_SIGMAS = 1.0, 8.0
ODD_SHARE = 1 / 8  # of a cubic part, as an error: as finer rules find it to be
LEAST_ROOM = 1e-3  # of the hole's size: pieces shorter than that may be missed


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
        slices=slices_of(fit.shape),
        sizes=tuple(fit.sizes(error)),
        error=error,
        close=fit.close,
    )
    found = (min(1.0, max(0.0, value)) for value in integral.outcomes())
    seated, elsewhere, miss = found
    return Seating(seated=seated, elsewhere=elsewhere, miss=miss)


@dataclass(frozen=True, slots=True, eq=False)
class _Panel:
    """A part of the integral over the angle, sizes averaged."""

    low_rad: float
    high_rad: float
    turns: FloatArray  # (N,) rad
    slices: Sequence[tuple[Pieces, ...]]  # (N)(sizes)
    hits: list[FloatArray]  # (N)(P,) of all pieces of an angle, weighted
    hit: float  # in any piece
    miss: float
    off: float = 0.0  # how much both may be off

    @property
    def is_full(self) -> bool:
        """Return whether a peg of any size goes in at all angles."""
        return all(pieces for row in self.slices for pieces in row)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Integral:
    """The integral over angle and sizes."""

    slices: Slices
    sizes: tuple[Size, ...]
    error: PoseError
    close: float  # share of the rarer outcome by which two rules may differ

    def outcomes(self) -> tuple[float, float, float]:
        """Return P(as planned), P(otherwise) and P(not)."""
        freely = self.slices.fit.turns_freely
        if freely or self.error.angle.sigma_rad <= EXACT:
            turn = 0.0 if freely else self.error.middle_rad
            panels = [self._panel(turn, turn, np.zeros(1), np.eye(3, 1))]
        else:
            panels = self._refined(list(self._begun(-math.pi, math.pi)))
        planned = self._planned(panels)
        total = sum(panel.hit for panel in panels)
        return planned, total - planned, sum(panel.miss for panel in panels)

    def _refined(self, panels: list[_Panel]) -> list[_Panel]:
        """Return panels, the worst ones halved until the rules agree."""
        for _ in range(HALVINGS):
            rarer = min(sum(p.hit for p in panels), sum(p.miss for p in panels))
            if sum(p.off for p in panels) <= max(self.close * rarer, NEGLIGIBLE):
                break
            worst = max(panels, key=lambda panel: panel.off)
            panels.remove(worst)
            middle = (worst.low_rad + worst.high_rad) / 2
            panels += self._begun(worst.low_rad, middle)
            panels += self._begun(middle, worst.high_rad)
        return panels

    def _begun(self, low: float, high: float) -> Iterator[_Panel]:
        """Yield a panel, or parts of it, none too wide to see where the peg goes in."""
        middle, half = (low + high) / 2, (high - low) / 2
        moments = angle_moments(
            self.error.angle, self.error.middle_rad, low, high, len(_POINTS)
        )
        inside = float(moments[0])
        if inside <= 0:
            return
        if inside <= NEGLIGIBLE or self._is_blocked(middle, half):
            none = [((),) * len(self.sizes)]
            yield _Panel(
                low, high, np.array([middle]), none, [np.empty(0)], 0.0, inside
            )
            return
        if half <= self._widest():
            found = self._panel(low, high, _POINTS, _rules(moments))
            # a piece is about as long as what turns a point by the room that there is
            if half * self.slices.reach_um <= self._room_um() or found.is_full:
                yield found
                return
        yield from self._begun(low, middle)
        yield from self._begun(middle, high)

    def _widest(self) -> float:
        """Return half the width of a panel whose angles' slices may be compared.

        Neighbouring slices of a piece overlap if a turn moves no point by more than
        the room, or if they are as close as the angle's density asks for.
        """
        sigma = self.error.angle.sigma_rad
        room_rad = self._room_um() / self.slices.reach_um
        return min(max(room_rad, NEAR_SIGMAS * sigma), FAR_SIGMAS * sigma)

    def _room_um(self) -> float:
        return max(self.slices.capture_um(), LEAST_ROOM * self.slices.size_um)

    def _is_blocked(self, middle: float, half: float) -> bool:
        """Return whether the peg goes in at no angle of a panel, at no size.

        Turned by half of it, no point of the peg moves farther than its distance from
        the reference point times that.
        """
        far_um = half * self.slices.reach_um
        if far_um > self.slices.size_um:
            return False
        widest = max(size.hole_um for size in self.sizes)
        thinnest = min(size.peg_um for size in self.sizes)
        return not self.slices.at(middle, widest + far_um, thinnest)

    def _panel(
        self, low: float, high: float, points: FloatArray, rules: FloatArray
    ) -> _Panel:
        """Return a panel from slices at points in -1..1, (N,), by `_rules`, (3, N)."""
        turns = (low + high) / 2 + (high - low) / 2 * points
        slices = [
            tuple(self.slices.at(turn, s.hole_um, s.peg_um) for s in self.sizes)
            for turn in turns.tolist()
        ]
        inside, miss = self._masses(turns, slices)
        values = np.array([[float(each.sum()) for each in inside], miss])
        (hit, missed), *apart = (rules @ values.T).tolist()
        off = 0.0 if high - low <= 2 * FINEST else float(np.hypot(*apart).max())
        hits = [w * each for w, each in zip(rules[0], inside, strict=True)]
        return _Panel(low, high, turns, slices, hits, hit, missed, off)

    def _masses(
        self, turns: FloatArray, slices: Sequence[tuple[Pieces, ...]]
    ) -> tuple[list[FloatArray], FloatArray]:
        """Return P of the place in each piece, (N)(P,), and in none, (N,)."""
        counts = np.array([[len(pieces) for pieces in row] for row in slices])
        edges = edges_of([p for row in slices for pieces in row for p in pieces])
        off = np.repeat(turns - self.error.middle_rad, counts.sum(axis=1))
        shifts = off[:, None] * np.array(self.error.lever_um)
        inside, outside = masses(edges, self.error.plane, shifts)
        weight = np.array([size.weight for size in self.sizes])
        owner = np.repeat(np.arange(counts.size), counts.ravel())
        miss = _outside(inside, outside, owner, counts.size).reshape(counts.shape)
        inside *= np.tile(weight, len(turns))[owner]
        ends = np.cumsum(counts.sum(axis=1))[:-1]
        return np.split(inside, ends), miss @ weight

    def _planned(self, panels: Sequence[_Panel]) -> float:
        """Return P in the pieces of the region that hold the planned pose."""
        turns = np.concatenate([panel.turns for panel in panels])
        order = np.argsort(turns, kind="stable").tolist()
        rows = [row for panel in panels for row in panel.slices]
        hits = [hit for panel in panels for hit in panel.hits]
        parts = [_split(hits[k], rows[k]) for k in order]
        return sum(
            _planned_part(
                turns[order].tolist(),
                [rows[k][size] for k in order],
                [each[size] for each in parts],
                self.slices.reach_um,
            )
            for size in range(len(self.sizes))
        )


def _split(hits: FloatArray, row: Sequence[Pieces]) -> list[list[float]]:
    """Return P of each size's pieces, (sizes)(pieces)."""
    ends = np.cumsum([len(pieces) for pieces in row])[:-1]
    return [part.tolist() for part in np.split(hits, ends)]


def _planned_part(
    turns: Sequence[float],
    slices: Sequence[Pieces],
    hits: Sequence[Sequence[float]],
    reach_um: float,
) -> float:
    """Return P in the piece that holds the planned pose, slices by rising turn."""
    if all(len(pieces) == 1 for pieces in slices):
        return sum(hit for (hit,) in hits)
    names = components(turns, slices)
    start = planned_piece(turns, slices, names, reach_um)
    return sum(
        hit
        for found, owned in zip(hits, names, strict=True)
        for hit, name in zip(found, owned, strict=True)
        if name == start
    )


def _outside(
    inside: FloatArray, outside: FloatArray, owner: IntArray, count: int
) -> FloatArray:
    """Return P outside all pieces of each slice; the rarer outcome keeps its digits.

    Pieces (P,) with their owners, slices (count,).
    """
    least, most = np.ones(count), np.zeros(count)
    np.minimum.at(least, owner, outside)
    np.maximum.at(most, owner, inside)
    others = np.bincount(owner, inside, count) - most
    return np.asarray(np.maximum(least - others, 0.0), dtype=np.float64)


def _rules(moments: FloatArray) -> FloatArray:
    """Return weights of the rule, of what another one differs by, and of an odd part.

    Over an even density rules see nothing of that, nor of half a bend that causes it.
    """
    fine = moments @ _FINE
    coarse = moments[: len(_COARSE)] @ _COARSE
    return np.array([fine, fine - coarse, ODD_SHARE * moments[0] * _FINE[3]])


def _integrals(points: FloatArray) -> FloatArray:
    """Return what takes moments, (N,), to weights of values at points, (N,)."""
    chebyshev = np.polynomial.chebyshev.chebvander(points, len(points) - 1)
    return np.asarray(np.linalg.inv(chebyshev), dtype=np.float64)


_POINTS = -np.cos(np.arange(5) * math.pi / 4)
_FINE, _COARSE = _integrals(_POINTS), np.zeros((3, 5))
_COARSE[:, ::2] = _integrals(_POINTS[::2])
