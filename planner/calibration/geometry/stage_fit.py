"""Image of a stage's readings, fitted to the places of a part in pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from microplan.arrays import BoolArray, FloatArray
from microplan.planner.calibration.estimates import (
    FEWEST_BLOCKS,
    BlockEstimate,
    Refused,
    VectorEstimate,
    jackknife_vector,
)
from microplan.planner.calibration.geometry.affine_scale import (
    axes_of,
    pitches,
    scales,
    stretch_of,
)
from microplan.planner.calibration.geometry.stage_stop import StageStop, shake_of

FEWEST_PLACES = 4  # of the stage: an affine map takes three
_FLAT = 0.02  # of the longer side of the readings' cloud: it is a line
_FEWEST_BENT = 9  # places that a distortion is fitted to
_BETTER = 0.9  # of the squared error of stops left out that a distortion must reach
_SURE = 3.0  # standard deviations of it from none
_ROBUST = 3.0  # standard deviations beyond which a place counts less
_ODD = 6.0  # times the median misfit: a stop to be looked at
_LEAST_PX = 1e-4  # scale of residuals of pictures without noise
_METHOD = "robust affine fit of places over stage readings, places left out in turn"


@dataclass(frozen=True, slots=True, kw_only=True)
class StageFit:
    """A stage's readings in the image, and the drawing's scale beside them."""

    names: tuple[str, ...]
    numbers: VectorEstimate  # by names
    # standard deviation of where the stage stops, px, right and up; of a picture's
    # place where it stopped once for each
    residual_px: tuple[BlockEstimate, BlockEstimate]
    shake_px: tuple[float, float] | None  # of a picture while the stage rests
    misfits_px: FloatArray  # (N, 2) of stops, right and up, the distortion taken off
    off: tuple[int, ...]  # stops far off all others

    def one(self, name: str) -> BlockEstimate | None:
        """Return one of the numbers, None if it is not told."""
        return self.numbers.one(self.names.index(name)) if name in self.names else None

    @property
    def ruler(self) -> str:
        """Return the prefix of the pitches that are taken: the drawing's where told."""
        return "drawn_" if "drawn_pitch_x" in self.names else ""

    def matrix(self) -> FloatArray:
        """Return the image of the readings, right and up over x and y, (2, 2) px/um."""
        return self.numbers.values[:4].reshape(2, 2)


_PLACES = ("right_x", "right_y", "up_x", "up_y", "pitch_x", "pitch_y", "skew")
_DRAWN = (
    "drawn_pitch_x", "drawn_pitch_y", "drawn_skew", "scale_x", "scale_y", "stage_skew",
    "offset_px",
)  # fmt: skip


def fit_stage(stops: Sequence[StageStop], corner_px: float) -> StageFit | Refused:
    """Return the image of a stage's readings.

    Parameters
    ----------
    stops : sequence of StageStop
        In any order; one reading may be gone to several times.
    corner_px : float
        From the middle of the picture to its corner.
    """
    why = _unfit(stops)
    if why:
        take = "one part at six places of the stage or more, over all of the field"
        return Refused(what="scale of the stage", why=why, take=take)
    if len(stops) >= _FEWEST_BENT and _bends(stops, corner_px):
        bent = _fitted(stops, corner_px, bent=True)
        found = bent.one("distortion")
        if found and found.sigma and abs(found.value) > _SURE * found.sigma:
            return bent
    return _fitted(stops, corner_px, bent=False)


def _fitted(stops: Sequence[StageStop], corner_px: float, *, bent: bool) -> StageFit:
    """Return the numbers of stops, with a distortion or without."""
    drawn = any(stop.stretch is not None for stop in stops)

    def numbers(some: Sequence[StageStop]) -> FloatArray:
        solved = _solved(some, corner_px, bent=bent)
        found = [solved[:4], pitches(stretch_of(solved[:4].reshape(2, 2)))]
        found += [_by_drawing(some, solved, corner_px)] if drawn else []
        return np.concatenate([*found, solved[6:] if bent else solved[:0]])

    named = (*_PLACES, *(_DRAWN if drawn else ()), *(("distortion",) if bent else ()))
    off = _misfits(_solved(stops, corner_px, bent=bent), _rows(stops), corner_px)
    told = [stop for stop in stops if stop.stretch is not None]
    found, shake = jackknife_vector(numbers, stops, method=_METHOD), shake_of(stops)
    mean = float(np.mean([1 / stop.pictures for stop in stops])) ** 0.5
    return StageFit(
        names=named,
        numbers=_with_trueness(found, named, (told or stops)[0]),
        residual_px=(
            _scatter(off[:, 0], 3 + bent / 2, shake[0] * mean),
            _scatter(off[:, 1], 3 + bent / 2, shake[1] * mean),
        ),
        shake_px=shake if any(shake) else None,
        misfits_px=off,
        off=tuple(np.flatnonzero(_far(off)).tolist()),
    )


def _with_trueness(
    found: VectorEstimate, names: Sequence[str], stop: StageStop
) -> VectorEstimate:
    """Return numbers with what no number of pictures takes off those by the drawing."""
    if found.covariance is None:
        return found
    covariance = found.covariance.copy()
    for name in set(_DRAWN) & set(names):
        at = names.index(name)
        size = 1.0 if name.endswith("skew") else float(found.values[at])
        off = stop.true_px if name == "offset_px" else stop.true_share * size
        covariance[at, at] += off**2
    return replace(found, covariance=covariance)


def _by_drawing(
    stops: Sequence[StageStop], numbers: FloatArray, corner_px: float
) -> FloatArray:
    """Return the drawing's pitches, the stage's scales by it, and the offset, (7,).

    A stretch is what the lens has at its place: the distortion is taken off each.
    `numbers` (7,) as of `_misfits`.
    """
    known = [
        stretch_of(stop.straightening(float(numbers[6]), corner_px) @ stop.stretch)
        for stop in stops
        if stop.stretch is not None
    ]
    if not known:
        return np.full(len(_DRAWN), math.nan)
    stretch, matrix = np.asarray(np.mean(known, axis=0)), numbers[:4].reshape(2, 2)
    offset = [float(np.mean([s.offset_px for s in stops if s.stretch is not None]))]
    stage = scales(axes_of(matrix, stretch))
    return np.concatenate([pitches(stretch), stage, offset])


def _unfit(stops: Sequence[StageStop]) -> str:
    """Return why stops tell no scale, "" if they do."""
    readings = np.array([[stop.x_um, stop.y_um] for stop in stops]).reshape(-1, 2)
    count = len(np.unique(readings, axis=0))
    if count < FEWEST_PLACES:
        return f"{count} places of the stage, {FEWEST_PLACES} are needed"
    sides = np.linalg.svd(readings - readings.mean(axis=0), compute_uv=False)
    if sides[1] < _FLAT * sides[0]:
        return "all stage readings lie on a line"
    return ""


def _rows(stops: Sequence[StageStop]) -> FloatArray:
    """Return readings and places, (N, 4)."""
    return np.array([[s.x_um, s.y_um, s.right_px, s.up_px] for s in stops])


def _misfits(numbers: FloatArray, rows: FloatArray, corner_px: float) -> FloatArray:
    """Return by how much places are off, (N, 2) px.

    `numbers` (7,): the matrix by rows, place at reading 0, distortion at the corner.
    """
    seen = rows[:, 2:]
    radial = np.sum(seen**2, axis=1, keepdims=True) / corner_px**2
    meant = rows[:, :2] @ numbers[:4].reshape(2, 2).T + numbers[4:6]
    found: FloatArray = seen * (1 - numbers[6] * radial) - meant
    return found


def _solved(stops: Sequence[StageStop], corner_px: float, *, bent: bool) -> FloatArray:
    """Return the numbers (7,) of `_misfits` that suit stops best."""
    rows, free = _rows(stops), 7 if bent else 6
    middle = rows[:, :2].mean(axis=0)
    span = max(float(np.ptp(rows[:, :2])), 1e-9)
    rows[:, :2] = (rows[:, :2] - middle) / span  # numbers of one size
    zero = _misfits(np.zeros(7), rows, corner_px).ravel()
    slopes = [_misfits(each, rows, corner_px).ravel() - zero for each in np.eye(7)]
    design = np.stack(slopes[:free], axis=1)  # misfits are linear in the numbers
    first = np.linalg.lstsq(design, -zero, rcond=None)[0]
    usual = 1.4826 * float(np.median(np.abs(zero + design @ first)))

    def misfits(some: FloatArray) -> FloatArray:
        return np.asarray(zero + design @ some)

    def slopes_of(_: FloatArray) -> FloatArray:
        return design

    scale = _ROBUST * max(usual, _LEAST_PX)
    best = least_squares(misfits, first, jac=slopes_of, loss="soft_l1", f_scale=scale)
    found = np.concatenate([best.x, np.zeros(7 - free)])
    found[:4] /= span
    found[4:6] -= found[:4].reshape(2, 2) @ middle
    return found


def _bends(stops: Sequence[StageStop], corner_px: float) -> bool:
    """Return whether stops left out are foretold clearly better with a distortion."""
    rows, errors = _rows(stops), np.zeros(2)
    for left in range(len(stops)):
        kept = [*stops[:left], *stops[left + 1 :]]
        for k, bent in enumerate((False, True)):
            numbers = _solved(kept, corner_px, bent=bent)
            off = _misfits(numbers, rows[left : left + 1], corner_px)
            errors[k] += float(np.sum(off**2))
    return bool(errors[1] < _BETTER * errors[0])


def _scatter(off: FloatArray, taken: float, shake_px: float) -> BlockEstimate:
    """Return the standard deviation of one stop's place, px.

    Of residuals (N,) of a fit that takes so many numbers of an axis; what vibration
    moves a stop's mean by is taken off. Its own deviation is that of a normal one.
    """
    free = max(len(off) - taken, 1.0)
    square = float(np.sum(off**2)) / free
    value = math.sqrt(max(square - shake_px**2, 0.0))
    known = len(off) >= FEWEST_BLOCKS and value > 0
    return BlockEstimate(
        value=value,
        sigma=square / value / math.sqrt(2 * free) if known else None,
        method="scatter of places about the fit, vibration taken off",
        blocks=len(off),
    )


def _far(off: FloatArray) -> BoolArray:
    """Return whether each place is far off all others, (N,)."""
    size = np.hypot(off[:, 0], off[:, 1])
    return np.asarray(size > _ODD * max(float(np.median(size)), _LEAST_PX))
