"""Verdicts of a step: fit, budget, grasp, release, method.

Added after format 2.0: a plan without them is read as one whose verdicts are unknown.
Lengths are um, angles rad, forces uN. A pair of numbers is an interval.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

FitClass = Literal["clearance", "transition", "interference"]


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlineFitVerdict:
    """How outlines that are not both circles go together; triples as `FitVerdict`."""

    angle_rad: float  # of the shaft's part in the frame of the hole's, as planned
    turns_freely: bool  # one of them is a whole circle: any angle will do
    # from and to, about the planned angle, where the planned place stays free
    theta_rad: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    overlap_um: float  # how deep the shaft as drawn is in material; 0: it goes in


@dataclass(frozen=True, slots=True, kw_only=True)
class FitVerdict:
    """How a hole and a shaft go together over their tolerances.

    Triples are least, drawn, greatest; the least counts taper against the fit.
    """

    hole_um: float  # largest width as drawn, of a circle its diameter
    shaft_um: float  # largest width as drawn
    fit: FitClass  # all, some or none of the parts as made go together
    clearance_um: tuple[float, float, float]  # by which the shaft could be wider
    capture_um: tuple[float, float, float]  # sideways error that still goes in
    taper_um: float  # what leaning walls may take of the clearance
    engaged_um: float  # overlap in height once inserted
    tilt_limit_rad: float | None  # least clearance over that; None: nothing engaged
    tilt_rad: float  # of the axes, 3 sigma; how the part sits in the jaws is unknown
    tilt_takes_um: float  # of the clearance, over the engaged length
    wedging_rad: float | None  # below this tilt it cannot wedge; None: no friction
    wedging_depth_um: float  # from here on geometry keeps the tilt below that
    may_wedge: bool  # whether it can jam at some tilt
    outline: OutlineFitVerdict | None = None  # None: both are whole circles


@dataclass(frozen=True, slots=True, kw_only=True)
class Offender:
    """What one term of a budget costs; the worst comes first."""

    term: str  # as in the budget's rows
    size_um: float  # as in the budget's rows
    slope_per_um: float  # dP/dsize; above 0 where spread helps what mostly fails
    halved_probability: float  # P if the term were half as large
    largest_um: float | None  # that still gives the goal; None: not even 0 does


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One change that would give the step's share of the goal; the cheapest first."""

    what: str  # what to change
    halvings: float  # of a term, or doublings of the clearance; 0: another method
    success_probability: float  # with it


@dataclass(frozen=True, slots=True, kw_only=True)
class Allowed:
    """The largest errors of one setting of a look that still give the goal."""

    error: str  # focus, zoom, light, gradient or pose
    look: str  # target of the look
    least: float  # zoom and light: ratio to what was planned
    most: float  # largest error
    unit: str  # of least and most
    source: str  # how it was found


@dataclass(frozen=True, slots=True, kw_only=True)
class YieldPoint:
    """P(success) where one size or tolerance is another."""

    value_um: float  # of the size or tolerance
    success_probability: float  # there


@dataclass(frozen=True, slots=True, kw_only=True)
class YieldCurve:
    """P(success) over one size or tolerance, all else as it is."""

    over: str  # which size or tolerance
    points: tuple[YieldPoint, ...]  # by rising value


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetAnalysis:
    """What a budget's probability hangs on."""

    required_probability: float  # the step's share of the goal
    offenders: tuple[Offender, ...]  # worst first
    changes: tuple[Change, ...]  # () if the share is met
    allowed: tuple[Allowed, ...]  # largest errors of looks' settings
    yields: tuple[YieldCurve, ...]  # P(success) over sizes and tolerances
    # Added after 2.1; None: unknown.
    miss_probability: float | None = None  # digits of what is too rare for 1 - P
    # xx, xy, yy of what the servo cannot see, about the offset; sizes not among it
    covariance_um2: tuple[float, float, float] | None = None


MethodName = Literal["servo", "look_then_move"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodOption:
    """What one way to run an alignment would give."""

    method: MethodName  # which way
    success_probability: float | None  # of the insertion; None: none follows
    looks: float  # expected
    expected_s: float  # looks and settling


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodChoice:
    """Which way was taken, and why."""

    asked: Literal["auto", "servo", "look_then_move"]  # what the task asks for
    method: MethodName  # what is used
    reason: str  # why
    options: tuple[MethodOption, ...]  # what was compared


@dataclass(frozen=True, slots=True, kw_only=True)
class Force:
    """One force as an interval: its size is known to a factor of ten at best."""

    name: str  # what pulls
    least_un: float  # lower end
    most_un: float  # upper end
    validity: str  # where the formula holds, and what was assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class Rung:
    """One action of a release, tried if those before it did not do."""

    action: str  # what is done
    why: str  # when it helps


@dataclass(frozen=True, slots=True, kw_only=True)
class ReleaseVerdict:
    """Whether a released part stays: what pulls it along, and what holds it."""

    verdict: Literal["stays", "may stick", "will stick"]  # whether it stays
    reason: str  # why
    contact_um2: float  # of one finger
    finger: tuple[Force, ...]  # between the part and one finger
    holding: tuple[Force, ...]  # between the part and what it lies on
    weight_un: tuple[float, float]  # of the part
    pull_un: tuple[float, float]  # of one finger, all forces together
    hold_un: tuple[float, float]  # of what it lies on, all forces together
    ladder: tuple[Rung, ...]  # planned; the executor opens and looks, no more
    verified_by: str | None  # step that looks whether it worked; None: none does


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspVerdict:
    """How a part stands between the jaws, and how firmly it is held."""

    opening_um: float  # before they close
    width_um: float  # of the part's hull at the angle in which it settles
    width_range_um: tuple[float, float]  # over all angles
    room_um: float  # on the narrower side
    needed_um: float  # 3 sigma of the places of part and jaws
    settles: int  # angles in half a turn at which it may lie flat; 0: it turns freely
    theta_within_rad: float | None  # half the widest gap between them; None: any angle
    theta_sigma_rad: float  # of the angle once held
    squeeze_um: float  # by which each finger bends
    force_un: tuple[float, float] | None  # None: the workcell tells no stiffness
    lift_un: tuple[float, float]  # weight, and what it lies on holding it
    verdict: Literal["holds", "may slip", "will slip", "unknown"]  # whether it holds
    reason: str  # why
    # of another angle than planned, in P(success); None: not needed. Added after 2.5
    theta_miss_probability: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnRow:
    """One error term of an angle."""

    term: str  # what errs
    sigma_rad: float  # one sigma
    source: str  # where the number comes from


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacingVerdict:
    """Where a part comes to lie that is let go and that no shaft holds."""

    target: str  # its place ...
    on: str  # ... is to be here,
    verified_by: str  # which this step checks
    within_um: float  # distance that is asked for
    half_um: float  # half of all parts lie nearer, if none sticks
    most_um: float  # and 95 % nearer than this
    place_probability: float  # that it lies within that
    within_rad: float | None  # of its angle against what `on` belongs to; None: any
    turn_rows: tuple[TurnRow, ...]  # what turns it
    turn_sigma_rad: float  # of the angle
    turn_probability: float  # that the angle is within within_rad
    far_um: float  # of its farthest point from the target
    far_sigma_um: float  # by which the angle moves that point
    stick_probability: float  # of the workcell
