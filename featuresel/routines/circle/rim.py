"""Points on the rim of something round: its iso-line at a level between both sides."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines import work
from microplan.featuresel.routines.circle.circle_fit import FittedCircle, fit_circle
from microplan.featuresel.routines.contract import Failure, Guess
from microplan.featuresel.routines.sampling import cubic, median

CAPTURE_PX = 3.0  # how far off the first ring of pixels still holds the rim
FAINT = 0.02  # step below which an edge drowns in 8 bits and shot noise
FEWEST = 0.5  # of the rim must be in view, and be found
STEP_PX = 0.5  # of radial profiles
THICK = 6  # steps: what is averaged of both sides, so that the level is not noisy

_NEAR_PX = 0.5  # what the first circle may be off by
_APPROACHES = 5  # rounds; two settle in focus
_STAYS_PX = 0.02  # a round; of errors that rounds keep to .8, four times this are left
_MOVED_PX = 2 * CAPTURE_PX  # from the guess: beyond, another rim was met
_WEAKEST = 0.3  # of the predicted step: light falls to .7, focus errors take the rest
_SECTORS = 48  # of the circle, in which points are counted
_STEEP = 0.6  # least cosine of rim normal and pixel line: a little over 45 degrees
_RINGS = 4  # over the thickness of a side
_ROUNDS = 3  # of trimming the level's plane
_NEWTON_ROUNDS = 4  # on a cubic, from the chord: settles below 1e-6 px
_PIXEL_WORK, _POINT_WORK = 6e-5, 1.0  # of the crossings, in box filters


@dataclass(frozen=True, slots=True, kw_only=True)
class RimPoints:
    """Points on the rim, (N,) px each."""

    columns: FloatArray
    rows: FloatArray
    alike: float  # neighbouring points that share one error, on average
    level_px: float  # standard deviation of the centre per axis by the level's noise

    def spread_px(self, scatter_px: float) -> float:
        """Return the centre's standard deviation per axis.

        `scatter_px` is what the points' residuals make of it, taken as independent.
        """
        return math.hypot(scatter_px * math.sqrt(self.alike), self.level_px)


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossings:
    """Points where an image takes its level, and which way it does so there."""

    columns: FloatArray  # (N,) px
    rows: FloatArray  # (N,) px
    along_rows: BoolArray  # (N,) the point is between two pixels of one column
    rising: BoolArray  # (N,) the image grows with that row, or column


@dataclass(frozen=True, slots=True, kw_only=True)
class _Level:
    """What the image has on the rim: a plane, because the light may have a gradient."""

    plane: tuple[float, float, float]  # at the guess, and its slopes along x and y
    step: float  # height from side to side, > 0
    error: float  # standard deviation of the plane's tilt, at the rim


def rim_points(
    image: FloatArray, p: Mapping[str, float], guess: Guess, away_px: float
) -> RimPoints | Failure:
    """Return the rim's points where the guess is off by up to `away_px`.

    Parameters
    ----------
    image : (rows, columns) float array
        0..1 of full scale.
    p : mapping
        From `rim_numbers`.
    guess : Guess
        The rim's middle, px.
    away_px : float
        By this much more than the gap both sides are taken off the rim.
    """
    level = _level(image, p, guess, p["gap_px"] + away_px)
    if isinstance(level, Failure):
        return level
    plane = level.plane
    radius, half = p["radius_px"], p["gap_px"] + away_px
    reach = radius + half + 3
    top, left = max(0, int(guess.row - reach)), max(0, int(guess.column - reach))
    part = image[top : int(guess.row + reach) + 1, left : int(guess.column + reach) + 1]
    if min(part.shape) < 8:
        return Failure("outside", "the rim is out of view")
    smooth = cv2.GaussianBlur(part, (0, 0), p["smooth_px"])
    x = np.arange(part.shape[1], dtype=np.float64) + (left - guess.column)
    y = (np.arange(part.shape[0], dtype=np.float64) + (top - guess.row))[:, None]
    above = np.asarray(smooth - (plane[0] + plane[1] * x + plane[2] * y), np.float64)
    points = _picked(above, (x, y), p, half)
    if isinstance(points, Failure):
        return points
    u, v = points
    # noise that a Gaussian has smoothed is alike over 2 sqrt(pi) of its sigmas
    share = 2 * math.sqrt(math.pi) * p["smooth_px"] / (math.tau * radius)
    return RimPoints(
        columns=u + guess.column,
        rows=v + guess.row,
        alike=max(1.0, share * len(u)),
        level_px=level.error / (p["slope_per_px"] * level.step),
    )


def approach(
    image: FloatArray, p: Mapping[str, float], guess: Guess
) -> tuple[RimPoints, FittedCircle] | Failure:
    """Return the rim's points and circle, px, in an image, (rows, columns) 0..1.

    The centre is sought until it stays.

    The level is that of two rings about the last centre. Where blur reaches them it
    tilts with that centre's error, and each round keeps a share of it, the larger the
    wider the blur. What does not settle is refused.
    """
    at, away = guess, CAPTURE_PX
    for _ in range(_APPROACHES):
        points = rim_points(image, p, at, away)
        if isinstance(points, Failure):
            return points
        circle = fit_circle(
            points.columns, points.rows, (at.column, at.row, p["radius_px"])
        )
        moved = math.hypot(circle.column - guess.column, circle.row - guess.row)
        if not moved <= _MOVED_PX:
            return Failure("outside", f"{moved:.1f} px from the guess")
        step = math.hypot(circle.column - at.column, circle.row - at.row)
        if away < CAPTURE_PX and step <= _STAYS_PX:
            return points, circle
        at, away = Guess(column=circle.column, row=circle.row), _NEAR_PX
    return Failure("unsettled", f"the centre still moves by {step:.2f} px a round")


def approach_work(p: Mapping[str, float]) -> float:
    """Return the work of `approach`, in box filters."""
    radius, around = p["radius_px"], math.tau * p["radius_px"]
    ring, total = 2 * _RINGS * _samples(radius), 0.0
    for away in (CAPTURE_PX, _NEAR_PX):
        side = 2 * (radius + p["gap_px"] + away + 3)
        total += work.read(ring) + 4 * work.least_squares(ring / _RINGS / 2, 3)
        total += work.smooth(side**2, p["smooth_px"]) + _PIXEL_WORK * side**2
        total += work.circle(1.3 * around) + _POINT_WORK
    return total


def _picked(
    above: FloatArray,
    grid: tuple[FloatArray, FloatArray],
    p: Mapping[str, float],
    half_px: float,
) -> tuple[FloatArray, FloatArray] | Failure:
    """Return the crossings near the rim that have its polarity, if all around.

    Points and `grid` are against the guess.
    """
    x, y = grid
    near = np.abs(np.hypot(x, y) - p["radius_px"]) <= half_px
    found = crossings(above, near)
    u, v = found.columns + x[0], found.rows + y[0, 0]
    distance = np.maximum(np.hypot(u, v), 1e-9)
    out = np.where(found.along_rows, v, u) / distance
    outward = np.where(found.rising, out, -out) * math.copysign(1.0, p["step"])
    good = outward > _STEEP
    sectors = np.floor(np.arctan2(v[good], u[good]) * _SECTORS / math.tau)
    seen = len(np.unique(sectors))
    if seen < FEWEST * _SECTORS:
        return Failure(
            "few_points",
            f"the rim is seen in {seen} of {_SECTORS} sectors, at least {FEWEST:.0%}",
        )
    return u[good], v[good]


def crossings(above: FloatArray, wanted: BoolArray) -> Crossings:
    """Return where an image crosses zero between neighbouring pixels.

    Parameters
    ----------
    above : (rows, columns) float array
        The image less the level sought.
    wanted : (rows, columns) bool array
        Pixels between which, right and down of each, crossings are sought; two pixels
        of border never are, because a cubic needs four values.

    Returns
    -------
    Crossings
        By the cubic through four pixels in a line, so an edge's curvature does not pull
        its points towards pixel centres as a chord's would.
    """
    across = _between(above, wanted)
    down = _between(above.T, wanted.T)
    count = (len(across[0]), len(down[0]))
    return Crossings(
        columns=np.concatenate((across[1], down[0])),
        rows=np.concatenate((across[0], down[1])),
        along_rows=np.repeat((False, True), count),
        rising=np.concatenate((across[2], down[2])),
    )


def _between(
    above: FloatArray, wanted: BoolArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return line, position on it and whether it rises, of crossings along axis 1."""
    near, far = above[:, 1:-2], above[:, 2:-1]
    crossed = ((near < 0) != (far < 0)) & wanted[:, 1:-2]
    line, first = np.nonzero(crossed)
    values = [above[line, first + k] for k in range(4)]  # the crossing's pair: 1, 2
    return (
        line.astype(np.float64),
        first + 1 + _root(*values),
        np.asarray(values[2] > values[1]),
    )


def _root(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Return where the cubic through values at -1, 0, 1, 2 is zero in 0..1."""
    second, third = (a - 2 * b + c) / 2, (d - 3 * c + 3 * b - a) / 6
    first = (c - a) / 2 - third
    t = np.asarray(b / (b - c), dtype=np.float64)
    for _ in range(_NEWTON_ROUNDS):
        value = b + t * (first + t * (second + t * third))
        tangent = first + t * (2 * second + 3 * t * third)
        # where noise makes the cubic flat, the chord's slope is good enough
        safe = np.where(tangent * (c - b) > 0.1 * (c - b) ** 2, tangent, c - b)
        t = np.clip(t - value / safe, 0.0, 1.0)
    return t


def rings(
    image: FloatArray, centre: tuple[float, float], radii: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return values on circles, (K, N), 0..1, and whether they are in view.

    `radii` are (K,) px, `image` (rows, columns).
    """
    count = _samples(float(radii.max()))
    angles = np.linspace(0, math.tau, count, endpoint=False)
    return cubic(
        image,
        centre[0] + np.outer(radii, np.cos(angles)),
        centre[1] + np.outer(radii, np.sin(angles)),
    )


def _level(
    image: FloatArray, p: Mapping[str, float], guess: Guess, gap_px: float
) -> _Level | Failure:
    """Return the level between both sides of the rim.

    The light's gradient tilts both sides alike; what hides a piece of the rim, or a
    notch in it, is trimmed.
    """
    radius = p["radius_px"]
    thick = np.arange(_RINGS) * (THICK * STEP_PX / (_RINGS - 1))
    # far inside a small disc there is no side left to take
    radii = np.concatenate((radius - gap_px - thick, radius + gap_px + thick))
    at = (guess.column, guess.row)
    values, inside = rings(image, at, np.maximum(radii, 1.0))
    inner, outer = values.reshape(2, _RINGS, -1).mean(axis=1)
    whole = inside.all(axis=0)
    if whole.mean() < FEWEST:
        return Failure("outside", "less than half the rim is in view")
    step = median((outer - inner)[whole]) * math.copysign(1.0, p["step"])
    least = max(_WEAKEST * abs(p["step"]), FAINT / 2)
    if step < least:
        return Failure("no_edge", f"step of {step:.3f}, at least {least:.3f}")
    wanted = inner + p["level"] * (outer - inner)
    angles = np.linspace(0, math.tau, len(wanted), endpoint=False)
    design = np.column_stack((np.ones_like(angles), np.cos(angles), np.sin(angles)))
    used = whole & (np.abs(wanted - median(wanted[whole])) < step)
    for _ in range(_ROUNDS):
        if used.sum() < 0.3 * len(used):
            return Failure("no_edge", "both sides of the rim are uneven")
        plane, *_ = np.linalg.lstsq(design[used], wanted[used], rcond=None)
        off = np.abs(wanted - design @ plane)
        used = whole & (off <= max(3 * 1.4826 * median(off[whole]), 1e-6))
    rms = float(np.sqrt(np.mean((wanted - design @ plane)[used] ** 2)))
    return _Level(
        plane=(float(plane[0]), float(plane[1]) / radius, float(plane[2]) / radius),
        step=step,
        error=rms * math.sqrt(2 / used.sum()),
    )


def _samples(radius_px: float) -> int:
    """Return one sample per pixel of circumference, 48 to 180."""
    return int(np.clip(math.tau * radius_px, 48, 180))
