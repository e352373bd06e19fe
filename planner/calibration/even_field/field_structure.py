"""What of a field's light no lamp makes, and how far that may move its gradient.

A tilt times light that falls off evenly from the middle is the tilt again once the odd
part of light about the middle is divided by the even one: R = (L(p) - L(-p)) / (L(p) +
L(-p)) is g p. What else is in R is an edge or a blob far out of focus, or noise.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.special import ndtr

from microplan.arrays import BoolArray, FloatArray

# structures that are tried; lengths in halves of the shorter side
_STEP, _BLOB = 0.0, 1.0
_TO_SIGMA = 2.5631  # width from 10 to 90 % over the standard deviation of the blur
_STEPS = np.array([0.1, 0.3, 0.7, 1.3, 2.0]) / _TO_SIGMA
_BLOBS = np.array([0.2, 0.4])  # standard deviations; broader ones are lamps
_PLACES = np.arange(0.0, 1.3, 0.2)  # from the middle
_ANGLES = np.deg2rad(np.arange(0.0, 180.0, 20.0))
_NEARER = np.array([[0.5, 0.5, 1.4], [0.25, 0.25, 1.2], [0.12, 0.12, 1.1]])  # rounds
# what of R lamps make beside g p: p r^2k, as they fall off about another middle, of any
# size; and, by deviations, (g p)^3, -1/3 of a spot exp(-(p - c)^2); g p (1 / E - 1) of
# the even light E, -1 to 1 where tilt and curve add up; p (E - 1) and p (g p)^2 of a
# curve, or a tilt, about another middle
_ANY, _ORDERS = 1e3, 4
_CUBE, _SUM, _ASIDE = 1 / 3, 1.0, 0.05
_EXACT = 1e-7  # of the light: rounding of arithmetic
SURE = 5.5  # deviations; noise alone reaches 4 in a hundredth of fields
MOVES = 0.01  # of the light from border to border: more is refused, less is charged
_ALIKE = 0.9  # of the square: structures differ by so much from those that are tried


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldStructure:
    """A step or a blob in a field's light, and what any may do to its gradient."""

    sure: float  # standard deviations by which the one that suits best is not 0
    height: float  # of it, of the light [1]
    width: float  # of the shorter side [1]
    shift: float  # of the gradient by any that suits about as well, at most [1]
    hidden: FloatArray  # (2,) deviation of the gradient, right and up, by any [1]

    @property
    def words(self) -> str:
        """Return why a field tells no gradient, "" if it may."""
        if self.sure < SURE or self.shift < MOVES:
            return ""
        return (
            f"it shows something smooth, a blurred edge or spot of some "
            f"{abs(self.height):.1%} of the light over {self.width:.0%} of the shorter "
            f"side, {self.sure:.0f} standard deviations from none: it may move the "
            f"gradient by {self.shift:.1%}"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pairs:
    """Pairs of cells opposite each other."""

    x: FloatArray  # (N,) halves of the shorter side, right of the middle
    y: FloatArray  # (N,) up
    use: BoolArray  # (N,)
    ratio: FloatArray  # (M,) R of those to use
    basis: FloatArray  # (M, K) what of R lamps make
    share: FloatArray  # (K,) that is taken off along each
    noise: float  # standard deviation of R

    @classmethod
    def of(
        cls,
        cells: FloatArray,
        places: tuple[FloatArray, FloatArray],
        clean: BoolArray,
        sigma: float,
    ) -> Self:
        """Return pairs of cells, as `field_structure` has them."""
        half = cells.size // 2
        use = (clean & clean[::-1, ::-1]).ravel()[:half]
        one, other = cells.ravel()[:half][use], cells.ravel()[::-1][:half][use]
        x, y = (each.ravel()[:half] for each in places)
        ratio, noise = (one - other) / (one + other), max(sigma / math.sqrt(2), _EXACT)
        made = _lamp(x[use], y[use], ratio, (one + other) / 2)
        basis, size, _ = np.linalg.svd(made / noise, full_matrices=False)
        return cls(
            x=x, y=y, use=use, ratio=ratio, basis=basis,
            share=1 - 1 / np.hypot(1, size), noise=noise,
        )  # fmt: skip

    def white(self, values: FloatArray) -> FloatArray:
        """Return values (M, ...) in deviations, those of lamps as those of noise."""
        known = (self.basis.T @ values).T * self.share
        found: FloatArray = (values - self.basis @ known.T) / self.noise
        return found

    def judged(self, numbers: FloatArray) -> FloatArray:
        """Return what is found of structures (T, 4), as `_odd` has them, (T, 4).

        Deviations from none, error of the height, and what a height of 1 moves the
        gradient by, right and up.
        """
        odd = _odd(numbers, self.x, self.y)
        shapes = self.white(odd[:, self.use].T)
        size = np.maximum(np.linalg.norm(shapes, axis=0), _EXACT)
        told = shapes.T @ self.white(self.ratio) / size
        moved = [_slope(along, odd) for along in (self.x, self.y)]
        return np.column_stack([told, 1 / size, *moved])


def field_structure(
    cells: FloatArray,
    places: tuple[FloatArray, FloatArray],
    clean: BoolArray,
    sigma: float,
) -> FieldStructure:
    """Return what of a field's light no lamp makes.

    Parameters
    ----------
    cells : (rows, columns) float array
        Light over its level.
    places : (x, y), each a (rows, columns) float array
        Of cells from the middle, right and up, in halves of the shorter side.
    clean : (rows, columns) bool array
        Cells to use, with those opposite.
    sigma : float
        Standard deviation of a cell.
    """
    pairs, numbers = _Pairs.of(cells, places, clean, sigma), _tried()
    found = pairs.judged(numbers)
    for nearer in _NEARER:
        more = _near(numbers[np.argmax(np.abs(found[:, 0]))], nearer)
        numbers = np.concatenate([numbers, more])
        found = np.concatenate([found, pairs.judged(more)])
    told, error, *moved = found.T
    best = int(np.argmax(np.abs(told)))
    suits = told**2 >= _ALIKE * told[best] ** 2 - SURE**2
    height, each = told * error, np.abs(moved)
    return FieldStructure(
        sure=float(abs(told[best])),
        height=float(height[best]),
        width=float(_TO_SIGMA * numbers[best, 3] / 2),
        shift=float((np.hypot(*moved) * np.abs(height))[suits].max()),
        hidden=(each * np.hypot(height, error))[:, suits].max(axis=1),
    )


def _lamp(
    x: FloatArray, y: FloatArray, ratio: FloatArray, even: FloatArray
) -> FloatArray:
    """Return what of R (N,) lamps make, each as large as it may be, (N, K)."""
    design = np.stack([x, y], axis=1)
    tilt = design @ np.linalg.lstsq(design, ratio, rcond=None)[0]
    square = (x**2 + y**2) / np.max(x**2 + y**2)
    columns = [_ANY * a * square**k for k in range(_ORDERS) for a in (x, y)]
    columns += [_CUBE * tilt**3]
    columns += [_SUM * tilt * (1 / even - 1) * square**k for k in range(3)]
    columns += [_ASIDE * a * (even - 1) * square**k for k in (0, 1) for a in (x, y)]
    columns += [_ASIDE * a * tilt**2 for a in (x, y)]
    return np.stack(columns, axis=1)


def _tried() -> FloatArray:
    """Return structures to begin with, (T, 4)."""
    steps = itertools.product([_STEP], _ANGLES, _PLACES, _STEPS)
    blobs = itertools.product([_BLOB], _ANGLES, _PLACES[1:], _BLOBS)
    return np.array([*steps, *blobs])


def _near(best: FloatArray, nearer: FloatArray) -> FloatArray:
    """Return structures (T, 4) about one (4,), shares of a spacing from it."""
    kind, angle, place, sigma = best.tolist()
    ways = (-1.0, 0.0, 1.0)
    apart = [nearer[0] * _ANGLES[1], nearer[1] * _PLACES[1]]
    most = _STEPS[-1] if kind == _STEP else _BLOBS[-1]
    return np.array(
        [
            (kind, angle + a * apart[0], place + b * apart[1], min(s, most))
            for a, b in itertools.product(ways, ways)
            for s in sigma * nearer[2] ** np.array(ways)
            if kind == _STEP or place + b * apart[1] > apart[1]
        ]
    )


def _odd(numbers: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return odd parts (T, N), at places (N,), of structures of height 1.

    Each (T, 4): kind, its angle about the middle in rad, distance from it, deviation
    of the blur. One on the other side of the middle has the same odd part or minus it.
    """
    kind, angle, place, sigma = (each[:, None] for each in numbers.T)
    along = np.cos(angle) * x + np.sin(angle) * y
    across = np.cos(angle) * y - np.sin(angle) * x
    near, far = (along - place) / sigma, (along + place) / sigma
    step = kind[:, 0] == _STEP
    found = np.empty(along.shape)
    found[step] = (ndtr(near[step]) + ndtr(far[step]) - 1) / 2
    wide = np.exp(-((across / sigma)[~step] ** 2) / 2)
    found[~step] = np.exp(-(near[~step] ** 2) / 2) - np.exp(-(far[~step] ** 2) / 2)
    found[~step] *= wide / 2
    return found


def _slope(along: FloatArray, odd: FloatArray) -> FloatArray:
    """Return what planes through odd light (T, N) change by from border to border."""
    reach = 2 * float(np.abs(along).max())
    return np.asarray(odd @ along / (along @ along) * reach)
