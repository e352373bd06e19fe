"""Error budget of a placement that only friction holds."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.planner.budget.insert_budget import (
    OFFSET_TERM,
    analysed_budget,
    common_rows,
)
from microplan.planner.budget.insertion import SIZE, Insertion, LateralResidual
from microplan.planner.budget.offenders import YIELD_POINTS, sizes_of, yield_curve
from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.budget.probability.fit_probability import RoundFit
from microplan.schemas.page.figures import chance
from microplan.schemas.plan import Budget, BudgetRow
from microplan.schemas.plan.verdicts import PlacingVerdict, YieldCurve

NOT_MODELLED = (
    ("sideways shift as the jaws open", "not modelled: no force has a known size"),
    ("fall onto what it lands on", "not modelled: the step lets go above it"),
)
YIELD_SHARES = (0.25, 2.0)  # of the tolerance stated
WIDEN = "allow {half:.3g} um more"
QUANTILES = (0.5, 0.95)
SHARP = 1e-3  # of a quantile


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """Placement of a part by a release, with the tolerances of a later step."""

    target: str
    on: str
    verified_by: str
    within_um: float
    within_rad: float | None
    far_um: float  # of the part's farthest point from the target
    stick_probability: float


def within(radius_um: float) -> RoundFit:
    """Return a tolerance as a fit: a hole over a shaft of no width."""
    return RoundFit(
        hole_um=radius_um, shaft_um=0.0, hole_tolerance_um=0.0, shaft_tolerance_um=0.0
    )


def other_success(placed: Placement, angle: AngleError) -> float:
    """Return the probability that the angle is within its limit, nothing sticking."""
    limit = placed.within_rad
    turned = 0.0 if limit is None else angle.beyond(limit)
    return (1 - turned) * (1 - placed.stick_probability)


def placing_budget(
    placed: Placement,
    job: Insertion,
    left: LateralResidual,
    angle: AngleError,
    *,
    goal: float = 0.0,
) -> tuple[Budget, PlacingVerdict]:
    """Return the budget of a release, and the verdict with its numbers.

    Parameters
    ----------
    placed : Placement
        What is put where.
    job : Insertion
        The position's errors, in a fit that `within` makes of the tolerance.
    left : LateralResidual
        What the alignment leaves sideways, with its name.
    angle : AngleError
        The angle's error.
    goal : float
        The step's share of the task's.

    Notes
    -----
    Position, angle and sticking count as independent. An error of the angle also moves
    the position: what they share makes both fail together rather than separately, so
    that the product errs on the safe side. The allowable errors of the
    looks' settings are left open.
    """
    stick = (
        f"counts in P: stick_probability {placed.stick_probability:g} of the workcell "
        "(0 unless stated)"
    )
    left_out = (*NOT_MODELLED, ("adhesion to the fingers", stick))
    rows = (BudgetRow(term=t, sigma_um=None, source=s) for t, s in left_out)
    sizes = sizes_of(job, left.term, OFFSET_TERM, "")
    budget = analysed_budget(
        job,
        (*common_rows(job, left), *rows),
        [size for size in sizes if size[1] != SIZE],
        goal,
        limit_um=placed.within_um,
        yields=(_yield_over(job),),
        others=other_success(placed, angle),
        widen=WIDEN,
    )
    return budget, _verdict(placed, job, angle)


def _verdict(placed: Placement, job: Insertion, angle: AngleError) -> PlacingVerdict:
    """Return the numbers of a placement."""
    half_um, most_um = (_quantile_um(job, share) for share in QUANTILES)
    limit = placed.within_rad
    return PlacingVerdict(
        target=placed.target,
        on=placed.on,
        verified_by=placed.verified_by,
        within_um=placed.within_um,
        half_um=half_um,
        most_um=most_um,
        place_probability=1 - job.miss,
        within_rad=placed.within_rad,
        turn_rows=angle.rows,
        turn_sigma_rad=angle.sigma_rad,
        turn_probability=1.0 if limit is None else 1 - angle.beyond(limit),
        far_um=placed.far_um,
        far_sigma_um=placed.far_um * math.sin(min(angle.sigma_rad, math.pi / 2)),
        stick_probability=placed.stick_probability,
    )


def placing_words(step: str, found: PlacingVerdict) -> str:
    """Return the description of a placement, every number with its unit."""
    words = (
        f"step {step!r}: {found.target} lies within {found.within_um:g} um of "
        f"{found.on} with P {chance(found.place_probability)}; half of all within "
        f"{found.half_um:.3g} um, 95 % within {found.most_um:.3g} um"
    )
    turn = math.degrees(found.turn_sigma_rad)
    words += f"; turned by {turn:.2g} deg (one sigma), its farthest point, "
    words += f"{found.far_um:.3g} um off, by {found.far_sigma_um:.2g} um"
    if found.within_rad is not None:
        limit = math.degrees(found.within_rad)
        words += f", within {limit:g} deg with P {chance(found.turn_probability)}"
    words += f"; it sticks to a finger with {found.stick_probability:g}"
    return f"{words}; {found.verified_by!r} looks"


def _yield_over(job: Insertion) -> YieldCurve:
    """Return the yield curve over the tolerance."""
    shares = np.linspace(*YIELD_SHARES, YIELD_POINTS)
    radii = [job.round_fit.hole_um * float(share) for share in shares]
    return yield_curve("within_um", radii, (replace(job, fit=within(r)) for r in radii))


def _quantile_um(job: Insertion, share: float) -> float:
    """Return the radius within which `share` of the errors end."""

    def inside(radius_um: float) -> float:
        return 1 - replace(job, fit=within(radius_um)).miss

    low, high = 0.0, job.round_fit.hole_um
    while inside(high) < share:
        low, high = high, 2 * high
    while high - low > SHARP * high and high > SHARP**2 * job.round_fit.hole_um:
        middle = (low + high) / 2
        low, high = (middle, high) if inside(middle) < share else (low, middle)
    return high
