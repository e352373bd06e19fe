"""Gradient of the light over the field, by one part's brightness at several places."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    PictureSource,
    single,
)
from microplan.planner.calibration.estimates import (
    FEWEST_BLOCKS,
    BlockEstimate,
    Refused,
    VectorEstimate,
    jackknife_vector,
)

_VAGUE = 0.1  # of the light, from border to border: a standard deviation tells nothing
_FLAT = 0.02  # of the longer side of the places' cloud: it is a line
_ROUNDS = 2  # of faces' contrasts, whose first fit knows no change of light
_METHOD = "brightness of the part over its place in the picture, places left out"
_WHAT = "light gradient"
_TAKE = "one part at six places or more, over all of the field, in the same light"
WHERE = ("light", "gradient")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedGain:
    """How bright one part is at one place of the picture."""

    right: float  # of the middle, shares of the picture's width
    up: float  # shares of its height
    gain: float  # contrast of light over the image's
    level: float = 0.0  # light besides, of full scale: black level, another background
    faces: tuple[float, ...] = ()  # as gain, of those on it: if as bright as the part

    def light_of(self, meant: float) -> float:
        """Return light, 1 at full scale, of a face that has so much in the image."""
        return self.gain * meant + self.level

    def lights(self, around: float, part: float) -> FloatArray:
        """Return light, 1 at full scale, of part, background, faces on it, (2 + F,).

        Of a part and a background that have so much in the image.
        """
        dark = self.light_of(around)
        on_it = [dark + gain * (part - around) for gain in self.faces]
        return np.array([self.light_of(part), dark, *on_it])


def part_gain(
    shown: FloatArray, meant: FloatArray, at_px: tuple[float, float], used: BoolArray
) -> FloatArray | None:
    """Return light besides, and contrast over that of images at a part's place.

    None if the picture shows none. All faces are in the same light, which changes over
    the part.

    Parameters
    ----------
    shown : (rows, columns) float array
        Light of the picture, 1 at full scale.
    meant : (F, rows, columns) float array
        Images of the part's face and of each on it, see `face_images`.
    at_px : (column, row)
        The part's place.
    used : (rows, columns) bool array
        Pixels to use.

    Returns
    -------
    (1 + F,) float array or None
        Light besides, then contrasts.
    """
    row, column = np.indices(shown.shape, dtype=np.float64)
    x, y = np.asarray(column - at_px[0]), np.asarray(row - at_px[1])
    steady = [np.ones_like(shown), *(np.asarray(each) for each in meant)]
    found = _fitted(steady, shown, used)
    for _ in range(_ROUNDS if len(meant) > 1 else 1):
        whole = np.asarray(np.tensordot(found[1 : len(steady)], meant, axes=1))
        down, right = (np.asarray(each) for each in np.gradient(whole))
        found = _fitted([*steady, x * whole, y * whole, x, y, right, down], shown, used)
    return found[: len(steady)] if found[1] > 0 else None


def _fitted(
    columns: Sequence[FloatArray], shown: FloatArray, used: BoolArray
) -> FloatArray:
    """Return the factors (N,) of N images whose sum is the light shown, both (R, C)."""
    design = np.stack([each[used] for each in columns], axis=1)
    return np.asarray(np.linalg.lstsq(design, shown[used], rcond=None)[0], np.float64)


def light_gradient(groups: Sequence[Sequence[PlacedGain]]) -> VectorEstimate | Refused:
    """Return the relative change of light over the picture, (2,): to the right, up.

    Parameters
    ----------
    groups : sequence of sequence of PlacedGain
        Pictures at one place each: they err together.
    """
    groups = [group for group in groups if group]
    if len(groups) < FEWEST_BLOCKS:
        why = f"{len(groups)} places do not tell it from the part's own brightness"
        return Refused(what=_WHAT, why=why, take=_TAKE)
    places = np.array([[group[0].right, group[0].up] for group in groups])
    sides = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    if sides[1] <= _FLAT * sides[0]:
        return Refused(what=_WHAT, why="all places lie on a line", take=_TAKE)
    found = jackknife_vector(_gradient, groups, method=_METHOD)
    if found.covariance is None or np.trace(found.covariance) > 2 * _VAGUE**2:
        why = "places so near one another do not tell it from the part's brightness"
        return Refused(what=_WHAT, why=why, take=_TAKE)
    return found


def _gradient(groups: Sequence[Sequence[PlacedGain]]) -> FloatArray:
    """Return the gradient (2,) of the light [1], its middle 1, of places' means."""
    rows = [
        np.mean([[each.right, each.up, each.gain] for each in group], axis=0)
        for group in groups
    ]
    right, up, gain = np.array(rows).T
    design = np.column_stack([np.ones(len(gain)), right, up])
    level, x, y = np.linalg.lstsq(design, gain, rcond=None)[0]
    return np.array([x / level, y / level])


def gradient_values(
    found: VectorEstimate,
    source: PictureSource,
    stated: float | None,
    hidden: FloatArray | None = None,
) -> Iterator[CalibratedValue]:
    """Yield the gradient's size, which a workcell has, and its parts with their sign.

    What chance adds to the square of the size is taken off; `hidden`, (2,), is of the
    deviations what is no chance.
    """
    x, y = found.one(0), found.one(1)
    if found.covariance is None or x.sigma is None or y.sigma is None:
        return
    lasting = 0.0 if hidden is None else float(hidden @ hidden)
    square = float(found.values @ found.values - np.trace(found.covariance)) + lasting
    along = float(found.values @ found.covariance @ found.values)
    size = math.sqrt(max(square, 0.0))
    chance = math.hypot(x.sigma, y.sigma)
    sigma = min(math.sqrt(along) / size, chance) if size > 0 else chance
    whole = BlockEstimate(
        value=size, sigma=sigma, method=found.method, blocks=found.blocks
    )
    yield single("light_gradient", whole, source, where=WHERE, stated=stated)
    yield single("light_gradient_x", x, source)
    yield single("light_gradient_y", y, source)
