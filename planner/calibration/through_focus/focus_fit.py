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
from microplan.planner.calibration.through_focus.focus_step import (
    FocusStep,
    in_light_of,
    sharpest_um,
)

FEWEST_STEPS, FEWEST_ASIDE = 5, 2  # in all, and on either side of the sharpest
_METHOD = "edge profiles through focus against the compiler's images, steps left out"
# rms of an edge's step: images of the compiler and of twins differ by twice of it in
# mean profiles, half of which looks like another aperture
_TRUE = 1e-4
_CHANGES = (1e-4, 1e-3, 1e-4)  # of aperture, um, scale: small against their errors
_VAGUE = 0.2  # of the aperture: it is not told from the focus
_CERTAIN = 1e-6  # of the aperture: profiles do not change with it
_LEAST_APERTURE, _STEPS = 1e-3, (0.05, 20.0)  # beyond they are in another unit
_AT_END = 1e-3  # of an end
_TAKE = (
    "the part at nine focus readings or more, even ones on both sides of the sharpest, "
    "to some two depths of field on either"
)
_STATE = "; is the workcell's numerical_aperture about right?"

# profile (L,) of a defocus, um, and an aperture
Profiles = Callable[[float, float], FloatArray]


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


def unsettled(aperture: float) -> Refused:
    """Return the refusal of steps that suit another aperture than images are about."""
    why = f"none is settled on; the last that suited is {aperture:.3g}"
    return Refused(what="aperture and focus", why=why, take=_TAKE + _STATE)


def suited(
    steps: Sequence[FocusStep],
    profiles: Profiles,
    aperture: float,
    within: tuple[float, float] = (_LEAST_APERTURE, math.inf),
) -> FloatArray:
    """Return aperture, zero um and scale, (3,), that suit steps best."""
    start = np.array([aperture, sharpest_um(steps), 1.0])
    return _solved(steps, profiles, start, free=3, within=within)


def most_defocus_um(steps: Sequence[FocusStep], numbers: FloatArray) -> float:
    """Return the largest defocus that numbers (3,), um and [1], give steps."""
    return float(max(abs(numbers[2] * (step.z_um - numbers[1])) for step in steps))


def fit_focus(
    steps: Sequence[FocusStep],
    profiles: Profiles,
    aperture: float,
    within: tuple[float, float] = (_LEAST_APERTURE, math.inf),
) -> FocusFit | Refused:
    """Return aperture, zero and step of the focus.

    Parameters
    ----------
    steps : sequence of FocusStep
        One of each reading.
    profiles : callable
        The images' profiles; even in the defocus.
    aperture : float
        To begin with.
    within : (least, most)
        Apertures that there are profiles of; a result at an end is refused.
    """
    refused = unfit_steps(steps)
    if refused is not None:
        return refused
    best = suited(steps, profiles, aperture, within)
    found = jackknife_vector(
        lambda some: _solved(some, profiles, best, free=3, within=within),
        steps,
        method=_METHOD,
    )
    found = _with_trueness(found, steps, profiles)
    why = _untold(found, within)
    if why:
        return Refused(what="aperture and focus", why=why, take=_TAKE + _STATE)
    off = _misfits(found.values, steps, profiles)
    return FocusFit(
        numbers=found,
        rms=float(np.sqrt(np.mean(off**2))),
        held_out=(
            _held_out(steps, profiles, best, free=2, within=within),
            _held_out(steps, profiles, best, free=3, within=within),
        ),
    )


def _untold(found: VectorEstimate, within: tuple[float, float]) -> str:
    """Return why numbers are none, "" if they are."""
    aperture, _, scale = found.values.tolist()
    sigma = found.one(0).sigma
    for value, ends, name in (
        (aperture, within, "the aperture"), (scale, _STEPS, "the step"),
    ):  # fmt: skip
        if not ends[0] * (1 + _AT_END) < value < ends[1] * (1 - _AT_END):
            return f"{name} that suits best, {value:.3g}, is the end of what is tried"
    if sigma is not None and not _CERTAIN * aperture < sigma < _VAGUE * aperture:
        return f"the aperture is {aperture:.2g} +- {sigma:.2g}"
    return ""


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
    steps: Sequence[FocusStep],
    profiles: Profiles,
    start: FloatArray,
    *,
    free: int,
    within: tuple[float, float],
) -> FloatArray:
    """Return the numbers (3,) that suit steps best; with `free` 2 the step is 1."""
    rest = np.ones(3 - free)
    low = np.array([within[0], -math.inf, _STEPS[0]])
    high = np.array([within[1], math.inf, _STEPS[1]])

    def misfits(some: FloatArray) -> FloatArray:
        return _misfits(np.concatenate([some, rest]), steps, profiles)

    sizes = np.array([0.1 * start[0], 1.0, 0.1])[:free]
    best = least_squares(
        misfits,
        np.clip(start, low, high)[:free],
        bounds=(low[:free], high[:free]),
        x_scale=sizes,
    )
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
    """Return a profile less an image's in its light, (L,), over its step."""
    line, contrast = in_light_of(step, meant)
    size = abs(contrast * float(np.ptp(meant)))
    return np.asarray((step.profile - line) / max(size, 1e-9))


def _held_out(
    steps: Sequence[FocusStep],
    profiles: Profiles,
    start: FloatArray,
    *,
    free: int,
    within: tuple[float, float],
) -> float:
    """Return the rms misfit of steps by the numbers of all others."""
    squares = []
    for left in range(len(steps)):
        kept = [*steps[:left], *steps[left + 1 :]]
        numbers = _solved(kept, profiles, start, free=free, within=within)
        squares.append(float(np.mean(_misfits(numbers, [steps[left]], profiles) ** 2)))
    return math.sqrt(sum(squares) / len(squares))
