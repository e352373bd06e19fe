"""Regions of a plane that bodies cut, cover or leave open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.executor.simulated.imaging.rays.marching import STAGE
from microplan.executor.simulated.imaging.solids.solid_scene import MappedBody

PUSH_UM = 0.3  # so far inside its region a point is taken, above a map's error
MOST_MOVES = 6
CUT = -2  # as a region's face: inside a body
OPEN = -3  # as a region's face: nothing in the plane

Distances = Callable[[FloatArray, FloatArray], list[FloatArray]]


@dataclass(frozen=True, eq=False)
class PlaneRegion:
    """Where in a plane one and the same thing is: within some bodies, not in others."""

    face: int  # index of the body, STAGE, CUT or OPEN
    within: tuple[MappedBody, ...]  # in any of them; none: everywhere
    without: tuple[MappedBody, ...]  # in none of them

    def distance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return signed distances, (N,) um, negative within; nearly so at corners."""
        away: FloatArray = np.max(self._terms(x, y), axis=0)
        return away

    def drawn_in(
        self, x: FloatArray, y: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return (N,) um points moved into the region, and which got there."""
        x, y = x.copy(), y.copy()
        for _ in range(MOST_MOVES):
            terms = self._terms(x, y)
            worst, far = np.argmax(terms, axis=0), np.max(terms, axis=0)
            out = np.flatnonzero(far > -PUSH_UM)
            if not len(out):
                break
            for k in range(len(terms)):
                at = out[worst[out] == k]
                nx, ny = self._normal(k, x[at], y[at])
                step = far[at] + 1.1 * PUSH_UM
                x[at] -= step * nx
                y[at] -= step * ny
        return x, y, self.distance(x, y) < 0

    def _terms(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return distances, all of which are negative within, (terms, N)."""
        terms = [-body.distance(x, y, exact=True) for body in self.without]
        if self.within:
            inner = [body.distance(x, y, exact=True) for body in self.within]
            terms.append(np.min(inner, axis=0))
        if not terms:
            terms.append(np.full(x.shape, -np.inf))
        return np.array(terms)

    def _normal(
        self, term: int, x: FloatArray, y: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return unit vectors along which a term grows."""
        if term < len(self.without):
            bx, by = self.without[term].normal(x, y)
            return -np.asarray(bx, float), -np.asarray(by, float)
        inner = [body.distance(x, y, exact=True) for body in self.within]
        nearest = np.argmin(inner, axis=0)
        nx, ny = np.zeros_like(x), np.zeros_like(y)
        for i, body in enumerate(self.within):
            at = nearest == i
            nx[at], ny[at] = body.normal(x[at], y[at])
        return nx, ny


def moved_outside(
    x: FloatArray, y: FloatArray, bodies: Sequence[MappedBody]
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return (N,) um points moved out of bodies, and which of them are out."""
    if not bodies:
        return x, y, np.ones(len(x), dtype=bool)
    return PlaneRegion(OPEN, (), tuple(bodies)).drawn_in(x, y)


def regions_of(
    bodies: Sequence[MappedBody], at_um: float, *, stage: bool
) -> list[PlaneRegion]:
    """Return what is in the plane of a height, front to back.

    Parameters
    ----------
    bodies : sequence of MappedBody
        All that there are.
    at_um : float
        The plane's height.
    stage : bool
        Whether the stage's surface is in the plane.
    """
    cut = tuple(b for b in bodies if b.bottom_um <= at_um < b.top_um)
    found = [PlaneRegion(CUT, cut, ())] if cut else []
    before = cut
    for i, body in enumerate(bodies):
        if body.top_um == at_um:
            found.append(PlaneRegion(i, (body,), before))
            before = (*before, body)
    found.append(PlaneRegion(STAGE if stage else OPEN, (), before))
    return found
