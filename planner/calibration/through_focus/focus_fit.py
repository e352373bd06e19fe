"""Aperture, focus zero and focus step that suit profiles of edges through focus."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from microplan.arrays import FloatArray
from microplan.planner.calibration.estimates import (
    BlockEstimate,
    Refused,
    VectorEstimate,
    jackknife_vector,
)

FEWEST_STEPS, FEWEST_ASIDE = 5, 2  # in all, and on either side of the sharpest
_METHOD = "edge profiles through focus against the compiler's images, steps left out"
# rms of an edge's step: images of the compiler and of twins differ by twice of it in
# mean profiles, half of which looks like another aperture
_TRUE = 1e-4
_CHANGES = (1e-4, 1e-3, 1e-4)  # of aperture, um, scale: small against their errors
_VAGUE = 0.2  # of the aperture: it is not told from the focus
_TAKE = (
    "the part at nine focus readings or more, even ones on both sides of the sharpest, "
    "to some two depths of field on either"
)

# profile (L,) of a defocus, um, and an aperture
Profiles = Callable[[float, float], FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class FocusStep:
    """Mean profile across a part's edges at one focus reading."""

    z_um: float  # reading
    profile: FloatArray  # (L,) light


@dataclass(frozen=True, slots=True, kw_only=True)
class FocusFit:
    """What profiles through focus tell."""

    numbers: VectorEstimate  # aperture, focus zero um, um of focus a um of reading
    rms: float  # of profiles about the images', of the edge's step
    held_out: tuple[
        float, float
    ]  # that of steps left out: with a step of 1, a free one

    @property
    def aperture(self) -> BlockEstimate:
        """Return the numerical aperture."""
        return self.numbers.one(0)

    @property
    def zero_um(self) -> BlockEstimate:
        """Return the reading at which the part is in focus."""
        return self.numbers.one(1)

    @property
    def scale(self) -> BlockEstimate:
        """Return the travel of the focus over that of the readings."""
        return self.numbers.one(2)


def sharpest_um(steps: Sequence[FocusStep]) -> float:
    """Return the reading of the profile that is steepest for its contrast."""
    steep = [
        float(np.abs(np.diff(s.profile)).max() / max(np.ptp(s.profile), 1e-9))
        for s in steps
    ]
    return steps[int(np.argmax(steep))].z_um


def unfit_steps(steps: Sequence[FocusStep]) -> Refused | None:
    """Return why focus steps tell no aperture, None if they may."""
    what, readings = "aperture and focus", {step.z_um for step in steps}
    if len(readings) < FEWEST_STEPS:
        why = f"{len(readings)} focus readings, {FEWEST_STEPS} are needed"
        return Refused(what=what, why=why, take=_TAKE)
    best = sharpest_um(steps)
    sides = sum(z < best for z in readings), sum(z > best for z in readings)
    if min(sides) < FEWEST_ASIDE:
        why = f"{sides[0]} readings below the sharpest, {sides[1]} above it"
        return Refused(what=what, why=why, take=_TAKE)
    return None


def fit_focus(
    steps: Sequence[FocusStep], profiles: Profiles, aperture: float
) -> FocusFit | Refused:
    """Return aperture, zero and step of the focus.

    Parameters
    ----------
    steps : sequence of FocusStep
        One of each reading.
    profiles : callable
        The images' profiles; even in the defocus.
    aperture : float
        As stated, to begin with.
    """
    refused = unfit_steps(steps)
    if refused is not None:
        return refused
    start = np.array([aperture, sharpest_um(steps), 1.0])
    best = _solved(steps, profiles, start, free=3)
    found = jackknife_vector(
        lambda some: _solved(some, profiles, best, free=3), steps, method=_METHOD
    )
    found = _with_trueness(found, steps, profiles)
    sigma = found.one(0).sigma
    if sigma is not None and not sigma < _VAGUE * found.values[0]:
        why = f"the aperture is {found.values[0]:.2g} +- {sigma:.2g}"
        return Refused(what="aperture and focus", why=why, take=_TAKE)
    off = _misfits(found.values, steps, profiles)
    return FocusFit(
        numbers=found,
        rms=float(np.sqrt(np.mean(off**2))),
        held_out=(
            _held_out(steps, profiles, best, free=2),
            _held_out(steps, profiles, best, free=3),
        ),
    )


def _with_trueness(
    found: VectorEstimate, steps: Sequence[FocusStep], profiles: Profiles
) -> VectorEstimate:
    """Return numbers with what images of two makers differ by, as they look like it."""
    if found.covariance is None:
        return found
    here, slopes = _misfits(found.values, steps, profiles), []
    for k, change in enumerate(_CHANGES):
        other = found.values.copy()
        other[k] += change
        slopes.append((_misfits(other, steps, profiles) - here) / change)
    design = np.stack(slopes, axis=1)
    common = _TRUE**2 * len(here) * np.linalg.pinv(design.T @ design)
    return replace(found, covariance=found.covariance + common)


def _solved(
    steps: Sequence[FocusStep], profiles: Profiles, start: FloatArray, *, free: int
) -> FloatArray:
    """Return the numbers (3,) that suit steps best; with `free` 2 the step is 1."""
    rest = np.ones(3 - free)

    def misfits(some: FloatArray) -> FloatArray:
        return _misfits(np.concatenate([some, rest]), steps, profiles)

    sizes = np.array([0.1 * start[0], 1.0, 0.1])[:free]
    best = least_squares(misfits, start[:free], x_scale=sizes)
    return np.concatenate([best.x, rest])


def _misfits(
    numbers: FloatArray, steps: Sequence[FocusStep], profiles: Profiles
) -> FloatArray:
    """Return by how much profiles are off those of images, (N L,), of their step."""
    aperture, zero_um, scale = numbers.tolist()
    return np.concatenate(
        [_off(s, profiles(scale * (s.z_um - zero_um), aperture)) for s in steps]
    )


def _off(step: FocusStep, meant: FloatArray) -> FloatArray:
    """Return a profile less an image's, (L,), over its step.

    Light, contrast and place are those that suit best: they are not the blur.
    """
    design = np.column_stack([np.ones(len(meant)), meant, np.gradient(meant)])
    numbers = np.linalg.lstsq(design, step.profile, rcond=None)[0]
    size = abs(float(numbers[1]) * float(np.ptp(meant)))
    return np.asarray((step.profile - design @ numbers) / max(size, 1e-9))


def _held_out(
    steps: Sequence[FocusStep], profiles: Profiles, start: FloatArray, *, free: int
) -> float:
    """Return the rms misfit of steps by the numbers of all others."""
    squares = []
    for left in range(len(steps)):
        kept = [*steps[:left], *steps[left + 1 :]]
        numbers = _solved(kept, profiles, start, free=free)
        squares.append(float(np.mean(_misfits(numbers, [steps[left]], profiles) ** 2)))
    return math.sqrt(sum(squares) / len(squares))
