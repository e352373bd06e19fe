"""Sensitivity of an insertion's probability: offenders, changes, yield curves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from scipy import optimize

from microplan.optics.outline.tolerant_order import ordered
from microplan.planner.budget.insertion import (
    ALL,
    ANGLE,
    OFFSET,
    SERVO,
    SIZE,
    Insertion,
)
from microplan.planner.budget.probability.outline_fit import OutlineFit
from microplan.schemas.plan.verdicts import Change, Offender, YieldCurve, YieldPoint

# Slopes are central differences over this share of a term: probabilities are right to
# 1e-12, so that both the curvature (1e-6) and their rounding (1e-9) are out of sight.
STEP = 1e-3
# Terms are searched up to this many capture radii, where no insertion succeeds by
# design, and to this share of what is found.
MOST_RADII = 10.0
SHARP = 1e-3
# Halvings beyond this are no change that anybody makes.
MOST_HALVINGS = 10.0
YIELD_POINTS = 9
# Odds longer than this are certain.
LEAST_CHANCE = 1e-300
# Curves run from these shares of the drawn value to those.
SHAFT_SHARES = (0.0, 1.5)  # of the clearance, taken off the hole's diameter
TOLERANCE_SHARES = (0.0, 3.0)  # of the tolerance stated

ANGLE_TERM = "angle between hole and shaft"
WIDEN_HOLE = "widen the hole by {wider:.3g} um"
Sizes = Sequence[tuple[str, str, float]]  # name in the budget, key of `scaled`, um


def offenders(job: Insertion, sizes: Sizes, goal: float) -> tuple[Offender, ...]:
    """Return the offenders: every term that is not zero, by the gain of halving it.

    Parameters
    ----------
    job : Insertion
        As it is.
    sizes : sequence of (name, key, size)
        The terms, each with the key that `Insertion.scaled` knows and its size, um.
    goal : float
        Chance that the step must reach.

    Returns
    -------
    tuple of Offender
        Of equal gain, by name.
    """
    found = [
        Offender(
            term=name,
            size_um=size,
            slope_per_um=_slope(job, key, size),
            halved_probability=1 - job.scaled(key, 0.5).miss,
            largest_um=largest_um(job, key, size, goal),
        )
        for name, key, size in sizes
        if size > 0
    ]
    found.sort(key=lambda offender: offender.term)
    return tuple(ordered(found, lambda o: -o.halved_probability))


def changes(
    job: Insertion,
    found: Sequence[Offender],
    goal: float,
    methods: Sequence[tuple[str, float]] = (),
    *,
    widen: str = WIDEN_HOLE,
) -> tuple[Change, ...]:
    """Return the changes that reach the goal, the cheapest first; () if it is met.

    A change costs as many halvings of a term, or doublings of the clearance, as it
    takes; another method costs none. `methods` are others with their probabilities;
    `widen` says what a larger radius means, by `half` and by `wider` on the diameter.
    """
    if 1 - job.miss >= goal:
        return ()
    fits = [
        Change(what=f"use {name}", halvings=0.0, success_probability=chance)
        for name, chance in methods
        if chance >= goal
    ]
    for term in found:
        if term.largest_um is None or term.largest_um <= 0:
            continue
        halvings = _halvings(term.size_um / term.largest_um)
        if 0 < halvings <= MOST_HALVINGS:
            what = (
                f"bring {term.term!r} from {term.size_um:.3g} to "
                f"{term.largest_um:.3g} um"
            )
            fits.append(Change(what=what, halvings=halvings, success_probability=goal))
    fits += _wider(job, goal, widen) + _all_finer(job, goal)
    # of what costs the same the fewest things come first
    return tuple(ordered(fits, lambda change: change.halvings, scale=1.0))


def yield_over_shaft(job: Insertion) -> YieldCurve:
    """Return the yield curve over the shaft's diameter, um."""
    if isinstance(job.fit, OutlineFit):
        return _yield_over_room(job)
    fit, hole = job.fit, 2 * job.fit.hole_um
    clearance = hole - 2 * fit.shaft_um
    shafts = [hole - clearance * share for share in _shares(SHAFT_SHARES)][::-1]
    jobs = [replace(job, fit=replace(fit, shaft_um=d / 2)) for d in shafts]
    return yield_curve("diameter of the shaft", shafts, jobs)


def _yield_over_room(job: Insertion) -> YieldCurve:
    """Return the yield curve over an offset of the shaft's edge, um.

    Of a round shaft over its diameter.
    """
    fit = job.fit
    if not isinstance(fit, OutlineFit):
        raise TypeError("a round fit has diameters")
    room = fit.capture_um + fit.taper_um
    taken = [room * (1 - share) for share in _shares(SHAFT_SHARES)][::-1]
    jobs = [job.widened(-2 * more) for more in taken]
    radius = fit.shape.peg_radius_um
    if radius is None:
        return yield_curve("edge of the shaft, beyond the drawing", taken, jobs)
    shafts = [2 * (radius + more) for more in taken]
    return yield_curve("diameter of the shaft", shafts, jobs)


def yield_over_tolerance(job: Insertion) -> YieldCurve:
    """Return the yield curve over the larger profile tolerance, um."""
    largest = max(job.fit.hole_tolerance_um, job.fit.shaft_tolerance_um)
    shares = _shares(TOLERANCE_SHARES) if largest > 0 else TOLERANCE_SHARES[:1]
    values = [largest * share for share in shares]
    return yield_curve(
        "profile tolerance", values, [job.scaled(SIZE, share) for share in shares]
    )


def _shares(ends: tuple[float, float]) -> Sequence[float]:
    """Return the shares between two ends at which a curve is evaluated."""
    return [float(share) for share in np.linspace(*ends, YIELD_POINTS)]


def yield_curve(
    over: str, values_um: Sequence[float], jobs: Iterable[Insertion]
) -> YieldCurve:
    """Return the success probabilities of insertions over a value, um."""
    points = (
        YieldPoint(value_um=value, success_probability=1 - job.miss)
        for value, job in zip(values_um, jobs, strict=True)
    )
    return YieldCurve(over=over, points=tuple(points))


def sizes_of(job: Insertion, servo: str, offset: str, size: str) -> Sizes:
    """Return all terms of an insertion under their names in the budget."""
    tolerance = math.hypot(job.fit.hole_tolerance_um, job.fit.shaft_tolerance_um)
    angle = [(ANGLE_TERM, ANGLE, job.angle_um)] if job.angle is not None else []
    return [
        *angle,
        (servo, SERVO, job.left_um),
        *((row.term, row.term, row.sigma_um or 0.0) for row in job.blind),
        (offset, OFFSET, abs(job.offset_um)),
        (size, SIZE, tolerance / math.sqrt(3)),
    ]


def _slope(job: Insertion, key: str, size_um: float) -> float:
    """Return dP/dsize, per um."""
    more, less = (job.scaled(key, 1 + side * STEP).miss for side in (1, -1))
    return (less - more) / (2 * STEP * size_um)


def largest_um(job: Insertion, key: str, size_um: float, goal: float) -> float | None:
    """Return the largest size of a term that gives the goal, None if 0 does not."""
    job = _roughly(job)

    @cache
    def spare(size: float) -> float:
        return _spare(job.scaled(key, size / size_um), goal)

    if spare(0.0) < 0:
        return None
    most = MOST_RADII * max(job.fit.capture_um, size_um)
    low, high = _around(job, spare, size_um, most)
    return high if spare(high) >= 0 else edge(spare, low, high)


def _roughly(job: Insertion) -> Insertion:
    """Return an insertion whose probability is as close as a root asks for."""
    if not isinstance(job.fit, OutlineFit):
        return job
    return replace(job, fit=replace(job.fit, close=SHARP))


def _around(
    job: Insertion, spare: Callable[[float], float], start: float, most: float
) -> tuple[float, float]:
    """Return ends, of 0..most, between which `spare` falls below 0, if it does.

    Outlines are tried from `start` on, by doubling: what is far off takes them longest.
    """
    if not isinstance(job.fit, OutlineFit):
        return 0.0, most
    low, high = 0.0, min(max(start, SHARP * most), most)
    while high < most and spare(high) >= 0:
        low, high = high, min(2 * high, most)
    return low, high


def _wider(job: Insertion, goal: float, widen: str) -> list[Change]:
    """Return the least widening of the hole that gives the goal, if any does."""
    clearance, rough = 2 * job.fit.capture_um, _roughly(job)

    @cache
    def short(wider: float) -> float:
        return -_spare(rough.widened(wider), goal)

    most = MOST_RADII * (abs(clearance) + 2 * max(job.rest.principal[1], SHARP))
    low, high = _around(job, short, clearance / 4, most)
    if short(high) > 0:
        return []
    wider = edge(short, low, high)
    wider += SHARP * wider  # the edge is found from below
    base = max(clearance, SHARP * wider)
    return [
        Change(
            what=widen.format(wider=wider, half=wider / 2),
            halvings=_halvings((base + wider) / base),
            success_probability=1 - job.widened(wider).miss,
        )
    ]


def _all_finer(job: Insertion, goal: float) -> list[Change]:
    """Return by how much all terms together must shrink, if that gives the goal."""
    rough = _roughly(job)

    @cache
    def spare(factor: float) -> float:
        return _spare(rough.scaled(ALL, factor), goal)

    if spare(0.0) < 0:
        return []
    factor = edge(spare, *_around(job, spare, 0.5, 1.0))
    if factor <= 0:
        return []
    return [
        Change(
            what=f"bring every error and tolerance to {100 * factor:.3g} % of itself",
            halvings=_halvings(1 / factor),
            success_probability=1 - job.scaled(ALL, factor).miss,
        )
    ]


def _halvings(ratio: float) -> float:
    """Return how many halvings a ratio is; sizes are found to SHARP only."""
    return round(math.log2(ratio), 2)


def _spare(job: Insertion, goal: float) -> float:
    """Return by how much the log odds of success are above those of the goal."""
    miss = job.miss
    return _log_odds(1 - miss, miss) - _log_odds(goal, 1 - goal)


def _log_odds(hit: float, miss: float) -> float:
    return math.log(max(hit, LEAST_CHANCE)) - math.log(max(miss, LEAST_CHANCE))


def edge(spare: Callable[[float], float], low: float, high: float) -> float:
    """Return the root of `spare`, from below, to a share of SHARP.

    It is not negative at `low`, and negative at `high` or beyond.
    """
    if spare(high) >= 0:
        return high
    nothing = SHARP**3 * (high - low)  # an edge closer to `low` is there
    found = float(optimize.brentq(spare, low, high, xtol=nothing, rtol=SHARP / 4))
    while found > low + nothing and spare(found) < 0:
        found *= 1 - SHARP / 2
    return found if found > low + nothing else low
