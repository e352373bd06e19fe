"""Misfits of pictures at several places, and the shares that they amount to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import special

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.look.scenario import LookCase
from microplan.planner.calibration.discrepancy.expected_moments import moment_matrix
from microplan.planner.calibration.discrepancy.misfit_moments import NAMES, moments
from microplan.planner.calibration.discrepancy.picture_misfit import (
    PictureMisfit,
    misfit_of,
)
from microplan.planner.calibration.estimates import (
    BlockEstimate,
    Refused,
    jackknife_vector,
)

Place = tuple[float, float, str]  # stage readings, um, and group

_FEWEST_PX = 100  # edges and faces, each
_FEWEST_PLACES = 2  # one draw of an edge's field tells nothing of its size
_LEFT = 0.05  # of a share's square: what the fit must leave of it
_OTHER = 0.02  # of the pixels in view: no other fit
_SURE = 0.9987  # one-sided, as 3 normal standard deviations
_WORDS = "that which the workcell states"
_FITTED = "no discrepancy_{}: the part shows too little beside its edges"
_FEW = "no discrepancy_{}: too few places tell it from none; take six or more"
_LESS = (
    "no discrepancy_pixel: pictures have less noise than the workcell states; "
    "calibrate its noise, or take two frames or more at each place"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscrepancyEstimate:
    """Shares that pictures tell, by their names, and why they do not tell others."""

    shares: dict[str, BlockEstimate]
    untold: tuple[str, ...] = ()


@dataclass(slots=True, kw_only=True)
class PlaceMisfits:
    """Moments of misfits as pictures are read, a row for each picture."""

    # (3, 4) each: moments, and what they are expected to be of unit squares
    rows: dict[Place, list[FloatArray]] = field(default_factory=dict)
    pairs: dict[Place, list[float]] = field(default_factory=dict)  # pixel, of 2 frames
    fewest_px: tuple[int, int] = (0, 0)  # edges and faces in the first
    _last: tuple[Place, tuple[int, int], PictureMisfit] | None = None
    _matrix: tuple[int, FloatArray] | None = None  # (3, 3), of so many px

    def add(
        self,
        place: Place,
        case: LookCase,
        shown: FloatArray,
        meant: FloatArray,
        at_px: tuple[float, float],
        used: BoolArray,
    ) -> None:
        """Add a picture in which the part was found; arguments as in `misfit_of`."""
        seen = misfit_of(case, shown, meant, at_px, used)
        if seen is None:
            return
        if not self.rows:
            self.fewest_px = (int(seen.edges.sum()), int(seen.faces.sum()))
        row = np.column_stack([moments(seen), self._expected(case, seen)])
        self.rows.setdefault(place, []).append(row)
        corner = (case.window.row, case.window.column)
        if self._last is not None and self._last[:2] == (place, corner):
            pair = moments(seen, self._last[2])[2]
            self.pairs.setdefault(place, []).append(float(pair))
        self._last = (place, corner, seen)

    def _expected(self, case: LookCase, seen: PictureMisfit) -> FloatArray:
        """Return a picture's moments of unit squares, those of one as much in view."""
        count = int(seen.used.sum())
        if self._matrix is None or abs(count - self._matrix[0]) > _OTHER * count:
            self._matrix = (count, moment_matrix(case, seen))
        return self._matrix[1]

    def blocks(self) -> list[FloatArray]:
        """Return the mean row of each place, (3, 4).

        Where every place has frames that repeat, pixels are products of two of them.
        """
        found = [np.mean(rows, axis=0) for rows in self.rows.values()]
        if self.is_paired:
            for row, place in zip(found, self.rows, strict=True):
                row[2, 0] = np.mean(self.pairs[place])
        return found

    @property
    def is_paired(self) -> bool:
        """Return whether frames repeat at each place."""
        return bool(self.rows) and self.rows.keys() == self.pairs.keys()


def discrepancy_shares(seen: PlaceMisfits) -> DiscrepancyEstimate | Refused:
    """Return edge, flat and pixel as far as pictures tell them, or why they do not.

    Standard deviations are of the jackknife over places; negative squares are 0, unless
    the noise that was taken off is too large beyond doubt.
    """
    blocks = seen.blocks()
    if len(blocks) < _FEWEST_PLACES:
        why = f"the part is at {len(blocks)} places"
        return Refused(what="discrepancy", why=why, take="the part at six places")
    if seen.fewest_px[0] < _FEWEST_PX:
        why = f"edges fill {seen.fewest_px[0]} px, {_FEWEST_PX} are needed"
        return Refused(what="discrepancy", why=why, take="the part larger")
    left = np.diag(np.mean(blocks, axis=0)[:, 1:])
    told = [k for k in range(3) if left[k] > _LEFT]
    if seen.fewest_px[1] < _FEWEST_PX:
        told = [k for k in told if NAMES[k] != "flat"]
    untold = tuple(_FITTED.format(NAMES[k]) for k in range(3) if k not in told)

    def squares(some: Sequence[FloatArray]) -> FloatArray:
        mean = np.mean(some, axis=0)[told]
        return np.linalg.solve(mean[:, 1:][:, told], mean[:, 0])

    noise = "products of two frames" if seen.is_paired else _WORDS
    method = f"residuals, without noise: {noise}; jackknife over places"
    found = jackknife_vector(squares, blocks, method=method)
    each = {NAMES[k]: found.one(index) for index, k in enumerate(told)}
    none = [name for name, square in each.items() if _is_open(square)]
    untold = (*untold, *(_FEW.format(name) for name in none))
    each = {name: square for name, square in each.items() if name not in none}
    if "pixel" in each and _is_below(each["pixel"]):
        del each["pixel"]
        untold = (*untold, _LESS)
    shares = {name: _root(square) for name, square in each.items()}
    return DiscrepancyEstimate(shares=shares, untold=untold)


def _is_open(square: BlockEstimate) -> bool:
    """Return whether a square is nothing, or too few places show that it is not."""
    return square.sigma is None and square.value <= 0


def _is_below(square: BlockEstimate) -> bool:
    """Return whether a square is negative beyond doubt, by Student's t."""
    if square.sigma is None:
        return False
    sigmas = float(special.stdtrit(square.blocks - 1, _SURE))
    return square.value < -sigmas * square.sigma


def _root(found: BlockEstimate) -> BlockEstimate:
    """Return the root of a square, 0 if that is negative.

    One standard deviation up the square is one up the root: finite at 0, and half the
    square's over the root far from it.
    """
    square = max(found.value, 0.0)
    sigma = None
    if found.sigma is not None:
        sigma = math.sqrt(square + found.sigma) - math.sqrt(square)
    return BlockEstimate(
        value=math.sqrt(square),
        sigma=sigma,
        method=found.method,
        blocks=found.blocks,
    )
