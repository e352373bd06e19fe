"""How much of the lamp's cone reaches points at one height, past other bodies."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from microplan.arrays import BoolArray, Box, FloatArray, IntArray
from microplan.executor.simulated.imaging.imaging_view import ImagingView, RaySampling
from microplan.executor.simulated.imaging.rays.beams import beams_from, pass_up
from microplan.executor.simulated.imaging.rays.lattice import (
    PointLattice,
    cubic_weights,
    filled,
    lattice_over,
)
from microplan.executor.simulated.imaging.rays.marching import (
    RayFan,
    Reals32,
    Solids,
    fan_through,
)
from microplan.executor.simulated.imaging.rays.pupil_rays import (
    beam_spread,
    pupil_slopes,
)
from microplan.executor.simulated.imaging.rays.regions import moved_outside

MOST_RAYS = 1 << 18  # at once
PATCH = 8  # steps across a cell: read along straight lines between them
FEW = 4  # points of a shading seen at once: fewer are as good as one
LEAST_SHARE = 0.75  # of the lamp's rays: wide beams are biased
MOST_EVENED = 4.0  # what errors are divided by, at most: those side by side are alike
CLEAR_UM = 1.0  # above a map's error and a beam's least width


class ShadeMap:
    """Share of the lamp's cone that reaches points at one height, where asked for.

    In cells of two steps of a lattice: smooth ones from points at their corners and
    round them, the others from all of the lattice's points there. What a cell holds
    depends on nothing but the scene.
    """

    def __init__(
        self,
        solids: Solids,
        view: ImagingView,
        sampling: RaySampling,
        at_um: float,
        box: Box,
        away_um: float,  # from the plane that is seen
    ) -> None:
        self._solids, self._at_um = solids, at_um
        above = min(b.top_um - at_um for b in solids.bodies if b.top_um > at_um)
        blur_um = view.steepest * view.lamp_share * above
        spacing = float(
            np.clip(
                sampling.spacing * blur_um,
                sampling.least_spacing_um,
                sampling.most_spacing_um,
            )
        )
        # errors, those of N rays as N**-.75, even out over the points seen at once
        seen = max(math.pi * (view.steepest * away_um / spacing) ** 2, FEW)
        count = round(sampling.lamp_rays * max((FEW / seen) ** (2 / 3), LEAST_SHARE))
        evened = min(math.sqrt(seen / FEW), MOST_EVENED)
        self._most_bend = 2 * sampling.tolerance * evened
        self._slopes = pupil_slopes(
            view, count, turn_rad=sampling.turn_rad, share=view.lamp_share
        )
        self._spread = beam_spread(view, count, share=view.lamp_share)
        self._cells: PointLattice = lattice_over(box, 2 * spacing)
        self._points = self._cells.finer(2)
        shape = (len(self._points.y_um), len(self._points.x_um))
        self._values, self._known = np.zeros(shape), np.zeros(shape, dtype=bool)
        self._good = np.zeros(shape, dtype=bool)
        cells = (len(self._cells.y_um), len(self._cells.x_um))
        self._drawn = np.zeros(cells, dtype=bool)
        self._patches = np.zeros((*cells, PATCH + 1, PATCH + 1), dtype=np.float32)

    def ask(self, fans: Sequence[RayFan]) -> None:
        """Compute what is needed at the ends of rays."""
        used = np.zeros_like(self._drawn)
        for rays in fans:
            used |= self._cells.holding(rays.x, rays.y)
        row, column = np.nonzero(used & ~self._drawn)
        if not len(row):
            return
        self._drawn[row, column] = True
        # the cubic reads one point more to each side than a cell's corners
        wide = self._read(row, column, 2 * np.arange(-1, 3))
        inner = np.linspace(1, 2, PATCH + 1)
        self._patches[row, column] = _drawn(wide, cubic_weights(inner, 4))
        bent = np.max(_bends(wide), axis=(1, 2)) > self._most_bend
        row, column = row[bent], column[bent]
        if len(row):
            close = self._read(row, column, np.arange(-1, 4))
            inner = np.linspace(1, 3, PATCH + 1)
            self._patches[row, column] = _drawn(close, cubic_weights(inner, 5))

    def at(self, x: Reals32, y: Reals32) -> Reals32:
        """Return shares at points that were asked for, (N,)."""
        cells, (rows, columns) = self._cells, self._drawn.shape
        scale = np.float32(PATCH / cells.spacing_um)
        u = (x - np.float32(cells.x_um[0])) * scale
        v = (y - np.float32(cells.y_um[0])) * scale
        np.clip(u, 0, PATCH * (columns - 1) - 0.01, out=u)
        np.clip(v, 0, PATCH * (rows - 1) - 0.01, out=v)
        left, low = u.astype(np.int32), v.astype(np.int32)
        u -= left.astype(np.float32)
        v -= low.astype(np.float32)
        side = np.int32(PATCH + 1)
        index = low // PATCH * np.int32(columns) + left // PATCH
        index = (index * side + low % PATCH) * side + left % PATCH
        flat = self._patches.ravel()
        first = flat.take(index)
        first += u * (flat.take(index + np.int32(1)) - first)
        index += side
        after = flat.take(index)
        after += u * (flat.take(index + np.int32(1)) - after)
        mixed: Reals32 = first + v * (after - first)
        return mixed

    def _read(self, row: IntArray, column: IntArray, around: IntArray) -> FloatArray:
        """Return values round cells, (N, K, K), at K of the lattice's points each way.

        What cannot be computed is taken from its neighbours there.
        """
        rows, columns = self._known.shape
        down = np.clip(2 * row[:, None] + around, 0, rows - 1)[:, :, None]
        across = np.clip(2 * column[:, None] + around, 0, columns - 1)[:, None, :]
        asked = np.zeros_like(self._known)
        asked[down, across] = True
        self._compute(asked & ~self._known)
        values: FloatArray = self._values[down, across]
        good = self._good[down, across]
        for k in np.flatnonzero(~good.all(axis=(1, 2))):
            values[k] = filled(values[k], good[k])
        return values

    def _compute(self, new: BoolArray) -> None:
        """Compute the points of a (rows, columns) mask."""
        rows, columns = np.nonzero(new)
        self._known |= new
        x, y, good = moved_outside(
            self._points.x_um[columns],
            self._points.y_um[rows],
            self._solids.crossing(self._at_um),
        )
        shares = np.ones(len(x))
        shaded = np.flatnonzero(self._shaded(x, y))
        many = max(1, MOST_RAYS // len(self._slopes))
        for first in range(0, len(shaded), many):
            some = shaded[first : first + many]
            shares[some] = self._shares(x[some], y[some])
        self._values[rows, columns] = shares
        self._good[rows, columns] = good

    def _shaded(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return at which (N,) um points a body stands in the lamp's cone."""
        shaded = np.zeros(len(x), dtype=bool)
        steepest = math.sqrt(float(np.max(np.sum(self._slopes**2, axis=1))))
        for body in self._solids.bodies:
            high_um = body.top_um - self._at_um
            if high_um > 0:
                reach = (steepest + self._spread) * high_um + CLEAR_UM
                shaded |= body.distance(x, y, exact=True) < reach
        return shaded

    def _shares(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the lamp's share that reaches points, (N,)."""
        start = beams_from(fan_through(x, y, self._slopes), 0.0, self._spread)
        beams, bent = pass_up(self._solids, start, self._at_um, self._spread)
        count, total = len(self._slopes), np.zeros(len(x))
        for sky in (beams.rays, bent):
            owner = sky.owner // count
            total += np.bincount(owner, weights=sky.weight, minlength=len(x))
        share: FloatArray = total / count
        return share


def _drawn(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return patches, (N, P, P), of (N, K, K) values, by (P, K) weights."""
    patches: FloatArray = weights @ values @ weights.T
    return patches


def _bends(values: FloatArray) -> FloatArray:
    """Return how far (N, 4, 4) values are from straight, (N, 4, 4)."""
    down = np.abs(np.diff(values, 2, axis=1)).reshape(len(values), 2, 4)
    across = np.abs(np.diff(values, 2, axis=2)).reshape(len(values), 2, 4)
    return np.concatenate([down, across], axis=1)
