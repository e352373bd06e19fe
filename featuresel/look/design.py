"""The trials of a look, random ones and corners, each made when it is asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import overload

import numpy as np
from scipy.stats import truncnorm

from microplan.arrays import FloatArray
from microplan.featuresel.features.factorial_design import (
    corner,
    generator,
    interior,
    words,
)
from microplan.featuresel.look.lens_draws import true_lens
from microplan.featuresel.look.scenario import LookCase, TrialSpread
from microplan.featuresel.look.unknown_surfaces import random_shares
from microplan.optics.lens.lens import LensErrors

# A quarter of all trials are corners: of each cycle every fourth of the first, and all
# that follow until half of the two-level design's runs are made.
_CYCLE, _MIXED, HALF_DESIGN = 64, 32, 40
_EVERY = 4
DRAWN_SIGMAS = 4.0  # where normal draws end: .1 % of the variance is left out
_CORNER = 2.0  # sigmas at the extremes, all at once: already far out together
_BLOCK = 1024  # points drawn at a time, a power of two
MOST_TRIALS = 2**20  # more than any look gets
# The estimator's defocus model must not always be the truth.
_OTHER_MODEL = {"hopkins": "stokseth", "exact": "stokseth"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One perturbed image of a look."""

    index: int
    dx_um: float  # of the target from nominal, world
    dy_um: float
    dtheta_rad: float
    dz_um: float = 0.0  # of the focus from nominal
    magnification: float = 1.0  # ratio to nominal
    gain: float = 1.0  # times the nominal light
    gradient_x: float = 0.0  # added to the nominal light's
    gradient_y: float = 0.0
    model: str
    seed: tuple[int, ...]  # of the noise
    occluder_um: tuple[float, float] = (0.0, 0.0)  # of what is not the target's owner
    together_um: tuple[float, float] = (0.0, 0.0)  # of both, the target's start as well
    lens: LensErrors | None = None  # what it truly does; None: what is known of it
    noise: float = 1.0  # times the sensor's
    turns_rad: tuple[float, ...] = ()  # of each of the spread's `turning`
    line: float = 0.5  # where lines of edges lie within their rounding, 0..1
    # of each of the look's unknown bodies, shares of wall and finish; () leaves them
    surfaces: tuple[tuple[float, float], ...] = ()
    corner: bool = False  # of what is tried: it decides no sigma and no bias


@dataclass(frozen=True, slots=True)
class _Rest:
    """The axes that most looks leave at rest, in units of their spreads."""

    occluder: Sequence[float]  # sigmas, 2
    lens: Sequence[float]  # sigmas, 6
    noise: float  # 0..1 of its interval


@dataclass(frozen=True, slots=True)
class _Points:
    """Some points of the unit cube, by groups of axes."""

    design: FloatArray  # (N, 8)
    normal: FloatArray  # (N, 5), the first five of these in sigmas
    occluder: FloatArray  # (N, 2) sigmas
    lens: FloatArray  # (N, 6) sigmas
    noise: FloatArray  # (N, 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Design(Sequence[Trial]):
    """Trials of a look: evenly spaced numbers of its design, each made when asked for.

    However many they are, no more than a few blocks of `_BLOCK` points are held.
    """

    case: LookCase
    root_seed: int
    first: int
    step: int
    length: int
    has_corners: bool = True  # a quarter; else all are random

    def __len__(self) -> int:
        """Return how many trials there are."""
        return self.length

    @overload
    def __getitem__(self, at: int) -> Trial: ...

    @overload
    def __getitem__(self, at: slice) -> Design: ...

    def __getitem__(self, at: int | slice) -> Trial | Design:
        """Return a trial, or the design of some of them."""
        numbers = range(self.first, self.first + self.step * self.length, self.step)
        picked = numbers[at]
        if isinstance(picked, int):
            return self._trial(picked, self._block(max(numbers[0], numbers[-1])))
        first = picked.start
        return replace(self, first=first, step=picked.step, length=len(picked))

    def _block(self, last: int) -> int:
        """Return how many points are drawn at a time: few for few trials."""
        return min(_BLOCK, 1 << max(1, last.bit_length()))

    def _trial(self, index: int, block: int) -> Trial:
        turn = _corners(index) if self.has_corners else 0
        if self.has_corners and _corners(index + 1) > turn:
            return _extreme(self.case, index, turn, self.root_seed)
        start, row = divmod(index - turn, block)
        points = _points(self.case.key, self.root_seed, start * block, block)
        rest = _Rest(
            tuple(points.occluder[row]), tuple(points.lens[row]),
            float(points.noise[row, 0]),
        )  # fmt: skip
        at = points.normal[row], points.design[row], rest
        spread = self.case.drawn if self.has_corners else self.case.promised
        return _interior(self.case, spread, index, *at, self.root_seed)


def design(case: LookCase, count: int, root_seed: int) -> Design:
    """Return the first `count` trials of a look.

    Trial k depends on the case, `root_seed` and k alone: other routines, cases or
    counts change none. Three of four are random: scrambled Sobol points mapped to the
    workcell's own spreads, `LookCase.drawn`. The others are corners of what is tried,
    `LookCase.spread`, by a folded two-level design of 32 runs (2 sigma in focus, zoom
    and angle, the ends of the light's and the noise's intervals, nine tenths to all of
    `search_um`). The first 16 are among the first `HALF_DESIGN` trials, their mirror
    images, with less noise, among the next as many. A standard deviation of zero leaves
    its axis at rest and the others where they were.

    Parameters
    ----------
    case : LookCase
        The look.
    count : int
        How many, 1 to `MOST_TRIALS`.
    root_seed : int
        Root of all seeds, >= 0.

    Raises
    ------
    ValueError
        If `count` or `root_seed` is out of range.
    """
    if not 1 <= count <= MOST_TRIALS:
        raise ValueError(f"count must be in 1..{MOST_TRIALS}, got {count}")
    if root_seed < 0:
        raise ValueError(f"root_seed must not be negative, got {root_seed}")
    return Design(case=case, root_seed=root_seed, first=0, step=1, length=count)


def random_design(case: LookCase, count: int, root_seed: int) -> Design:
    """Return random trials alone, none of which a choice among chains has seen.

    They are drawn with `LookCase.promised`, by another scramble than those of `design`;
    arguments and errors are its own.
    """
    fresh = replace(case, key=f"{case.key}/random")
    return replace(design(fresh, count, root_seed), has_corners=False)


def rebuild(case: LookCase, root_seed: int, index: int) -> Trial:
    """Return one trial of `design` by its number, such as a score's worst."""
    return design(case, index + 1, root_seed)[index]


def _corners(count: int) -> int:
    """Return how many of the first `count` trials are corners."""
    cycles, left = divmod(count, _CYCLE)
    mixed, alone = min(left, _MIXED), min(max(left - _MIXED, 0), HALF_DESIGN - _MIXED)
    return cycles * (_CYCLE // _EVERY) + mixed // _EVERY + alone


@lru_cache(maxsize=4)
def _points(key: str, root: int, first: int, count: int) -> _Points:
    """Return points of a look's design from the one numbered `first`."""
    points, occluder, lens, noise = (
        interior(group, key, root, count, first=first)
        for group in ("design", "occluder", "lens", "noise")
    )
    return _Points(
        points, _normal(points[:, :5]), _normal(occluder), _normal(lens), noise
    )


def _normal(points: FloatArray) -> FloatArray:
    """Return points of the unit cube in units of sigmas."""
    found: FloatArray = truncnorm.ppf(points, -DRAWN_SIGMAS, DRAWN_SIGMAS)
    return found


def _interior(
    case: LookCase,
    spread: TrialSpread,
    index: int,
    normal: FloatArray,
    point: FloatArray,
    rest: _Rest,
    root: int,
) -> Trial:
    """Return a point of the unit cube, five of it in sigmas, mapped to the spreads."""
    theta = normal[2] * spread.pose_sigma_theta_rad
    if case.theta_any:
        theta = (2 * point[2] - 1) * math.pi
    low, high = spread.light_gain
    weak, strong = spread.light_gradient
    return _trial(
        case,
        spread,
        index,
        root,
        place_um=tuple(normal[:2] * spread.pose_sigma_xy_um),
        theta_rad=theta,
        dz_um=normal[3] * spread.focus_sigma_um,
        magnification=1 + normal[4] * spread.magnification_sigma,
        gain=low + point[5] * (high - low),
        gradient=weak + point[6] * (strong - weak),
        direction_rad=2 * math.pi * point[7],
        rest=rest,
    )


def _extreme(case: LookCase, index: int, turn: int, root: int) -> Trial:
    """Return a corner of the spreads; directions are drawn, never on a pixel grid."""
    spread = case.spread
    sign = corner(turn)
    rng = generator(root, f"{case.key}/extreme {index}")
    radius = spread.search_um * rng.uniform(0.9, 1.0)
    toward = math.atan2(sign[1], sign[0]) + rng.uniform(-0.5, 0.5)
    theta = _CORNER * sign[2] * spread.pose_sigma_theta_rad
    if case.theta_any:
        theta = rng.uniform(-math.pi, math.pi)
    direction = rng.uniform(0, 2 * math.pi)
    far = _CORNER * rng.uniform(0.9, 1.0, 2)
    found = _trial(
        case,
        spread,
        index,
        root,
        place_um=(radius * math.cos(toward), radius * math.sin(toward)),
        theta_rad=theta,
        dz_um=_CORNER * sign[3] * spread.focus_sigma_um,
        magnification=1 + _CORNER * sign[4] * spread.magnification_sigma,
        gain=spread.light_gain[int(sign[5] > 0)],
        gradient=spread.light_gradient[int(sign[6] > 0)],
        direction_rad=direction,
        rest=_Rest(
            (far[0] * sign[7], far[1] * sign[8]),
            [_CORNER * s for s in sign[9:15]],
            float(sign[15] > 0),
        ),
    )
    ends = tuple((round(wall), round(finish)) for wall, finish in found.surfaces)
    return replace(found, corner=True, surfaces=ends)


def _trial(
    case: LookCase,
    spread: TrialSpread,
    index: int,
    root: int,
    *,
    place_um: tuple[float, ...],
    theta_rad: float,
    dz_um: float,
    magnification: float,
    gain: float,
    gradient: float,
    direction_rad: float,
    rest: _Rest,
) -> Trial:
    """Return the trial with its defocus model and noise seed."""
    sigma, (low, high) = spread.occluder_sigma_um, spread.noise
    rng = generator(root, f"{case.key}/together {index}")
    all_um = spread.together_um * rng.uniform(-1.0, 1.0, 2)
    x_um, y_um = all_um + place_um
    other_x_um, other_y_um = all_um + sigma * np.asarray(rest.occluder)
    # interior and extremes both meet both laws: the parity shifts by one every round
    other = (index + index // _EVERY) % 2 == 1
    return Trial(
        index=index,
        dx_um=float(x_um),
        dy_um=float(y_um),
        dtheta_rad=float(theta_rad),
        dz_um=float(dz_um),
        magnification=float(magnification),
        gain=float(gain),
        gradient_x=float(gradient * math.cos(direction_rad)),
        gradient_y=float(gradient * math.sin(direction_rad)),
        model=_OTHER_MODEL.get(case.model, "exact") if other else case.model,
        seed=(root, *words(f"{case.key}/trial {index}")),
        occluder_um=(float(other_x_um), float(other_y_um)),
        together_um=(float(all_um[0]), float(all_um[1])),
        lens=true_lens(case.lens, spread.lens, rest.lens),
        noise=low + rest.noise * (high - low),
        turns_rad=_turns(case, spread, index, root),
        line=case.line_at(generator(root, f"{case.key}/line {index}").random()),
        surfaces=random_shares(
            case.surfaces, generator(root, f"{case.key}/surfaces {index}")
        ),
    )


def _turns(
    case: LookCase, spread: TrialSpread, index: int, root: int
) -> tuple[float, ...]:
    """Return by how much what lies at unknown angles is turned, rad."""
    if not spread.turning:
        return ()
    rng = generator(root, f"{case.key}/turning {index}")
    points = rng.random(len(spread.turning))
    return tuple(
        (2 * float(at) - 1) * math.pi
        if what.is_any
        else what.sigma_theta_rad
        * float(truncnorm.ppf(at, -DRAWN_SIGMAS, DRAWN_SIGMAS))
        for what, at in zip(spread.turning, points, strict=True)
    )
