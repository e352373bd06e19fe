"""Measurement of one feature by a chain of routines.

Lengths are um and angles rad unless a name says otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from microplan.schemas.pose import Pose

# share of a variance of trials that few pairs of images can spare: half of sigma stays
MOST_SPARED = 0.75


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """The part of the frame a routine sees, px; (0, 0) is the frame's top left."""

    row: int  # of the top left pixel, in the frame
    column: int  # of the top left pixel, in the frame
    rows: int  # height of the region
    columns: int  # width of the region


@dataclass(frozen=True, slots=True, kw_only=True)
class RoutineUse:
    """One routine of a chain, with what `measure` needs."""

    id: str  # name of the routine
    version: str  # must be the executor's
    parameters: Mapping[str, float]  # numbers that it works with
    arrays: str | None  # npz in the plan folder


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Where the target should be if everything were nominal."""

    column: float  # px of the region
    row: float  # px of the region, down
    pose: Pose  # world
    z_um: float  # world height of the target's face


@dataclass(frozen=True, slots=True, kw_only=True)
class Gates:
    """What a measurement must meet to be accepted."""

    min_score: float  # score below which an answer is refused
    max_shift_um: float  # from the expected place
    max_turn_rad: float | None  # from the expected angle; None: any angle
    max_spread_um: float | None = None  # of the routine's own sigma; None: any


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasAt:
    """Mean error predicted at one focus, in the target's frame."""

    dz_um: float  # of the focus from the look's own
    bias_x_um: float  # along x of the target
    bias_y_um: float  # along y of the target


@dataclass(frozen=True, slots=True, kw_only=True)
class Depth:
    """What the usable focus range of a feature stands beside."""

    textbook_um: float  # depth of field n wavelength / A**2, from end to end
    spurious_um: float | None  # defocus that turns dark and bright about; None: none
    contrast: tuple[float, float]  # at both ends of the range, over that in focus


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeatability:
    """What random trials at the workcell's own uncertainties said of a chain.

    No corner of what is tried is among them, nor a trial that the chain was chosen by.
    """

    trials: int  # how many were drawn
    answered: int  # of these, rightly: bias and sigma are theirs
    undetected: int  # of these, wrongly, and accepted by the gates
    sigma_um: tuple[float, float]  # standard deviation about the bias, target's frame
    kurtosis: float  # of the errors, the larger of both axes; 3: normal
    half_width_um: tuple[float, float]  # of the bias, two-sided 95 %, target's frame
    kurtosis_theta: float | None = None  # of the angle; None: it is not measured
    bias_theta_rad: float | None = None  # mean error of the angle; nobody takes it off
    half_width_theta_rad: float | None = None  # of the angle's bias, two-sided 95 %
    # root mean square of what discrepancies of pictures move answers by, target's
    # frame: that part of `sigma_um` no average of frames makes smaller, by half of the
    # trials; None: it is not known. Added after 2.6
    trueness_um: tuple[float, float] | None = None
    trueness_rad: float | None = None  # of the angle, as `trueness_um`

    @property
    def true_um(self) -> float:
        """Return the trueness of the worse axis, um, 0 if it is not known."""
        return 0.0 if self.trueness_um is None else max(self.trueness_um)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelCost:
    """What images that are not quite right cost a chain, by pairs with better ones.

    Sums over the effects that are above their limits, in the target's frame, but for
    `sigma_um`: theirs (`EffectCost`) are of the differences alone.
    """

    pairs: int  # of images that the chain answered both of, of the effect with fewest
    freedom: int  # degrees of freedom of the half-widths
    bias_um: tuple[float, float]  # mean error that they add; in a measure's `bias_um`
    half_width_um: tuple[float, float]  # of that, two-sided 95 %, with `interval_um`
    interval_um: tuple[float, float]  # of what is only known between two ends
    # by which they make the answers' standard deviation larger, in squares; in a
    # measure's `sigma_xy_um`
    sigma_um: tuple[float, float]
    bias_theta_rad: float | None = None  # None: no angle is measured
    half_width_theta_rad: float | None = None  # of that, as `half_width_um`
    interval_theta_rad: float | None = None  # as `interval_um`
    sigma_theta_rad: float | None = None  # as `sigma_um`
    # as `half_width_um`, of walls and faces that trials draw: they are in what trials
    # say, and the lower bound of P(success) alone has them besides, at their worst
    drawn_um: tuple[float, float] = (0.0, 0.0)
    drawn_theta_rad: float | None = None  # as `drawn_um`; None: no angle is measured
    # standard deviation of the differences over the poses, all of which the upper bound
    # of `sigma_um` counts; None in plans of before: it is `sigma_um`
    spread_um: tuple[float, float] | None = None
    spread_theta_rad: float | None = None  # as `spread_um`; None: as above
    # by which they make that of the trials smaller instead, in squares, beyond its
    # standard error; off a measure's `sigma_xy_um`. Added after 2.6
    spared_um: tuple[float, float] = (0.0, 0.0)

    def charged_um(self, sigma_um: float, true_um: float = 0.0) -> float:
        """Return sigma of answers per axis, um, from that of trials `sigma_um`.

        Of both axes the larger cost counts, and at most the smaller is spared: nothing
        of the trueness `true_um`, which images have no part in.
        """
        own_um2 = max(sigma_um**2 - true_um**2, 0.0)
        spared_um2 = min(min(self.spared_um) ** 2, MOST_SPARED * own_um2)
        return math.sqrt(sigma_um**2 - spared_um2 + max(self.sigma_um) ** 2)

    def trials_um(self, charged_um: float, true_um: float = 0.0) -> float:
        """Return the sigma of trials, um, that is `charged_um` with this cost."""
        rest_um2 = charged_um**2 - max(self.sigma_um) ** 2 - true_um**2
        left_um2 = max(rest_um2, 0.0)
        spared_um2 = min(self.spared_um) ** 2
        own_um2 = min(left_um2 + spared_um2, left_um2 / (1 - MOST_SPARED))
        return math.sqrt(own_um2 + true_um**2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """How a look measures one feature: its target, or another of the same part."""

    chain: tuple[RoutineUse, ...]  # coarse to fine
    fallback: tuple[RoutineUse, ...]  # where the chain reports a failure; may be empty
    region: Region  # what the routine sees of the frame
    reference: Reference  # where the target should be
    bias_um: tuple[float, float]  # mean error, in the target's frame; subtract it
    # rows column, row (down); columns x, y per um, theta per rad, relative zoom
    jacobian_px_per_um: tuple[tuple[float, ...], ...]
    sigma_xy_um: float  # per axis, from the trials
    sigma_theta_rad: float | None  # None: the angle is not measured
    limit_xy_um: float | None  # Cramer-Rao bound per axis; None: not computed
    gates: Gates  # what an answer must meet
    capture_um: float  # how far the target may be from the nominal place
    symmetry: int  # order of the rotational one; 1: none; 0: any turn
    symmetry_broken_by: str  # "" if nothing does, or nothing needs to
    usable_focus_um: tuple[float, float]  # focus error that still meets the tolerance
    usable_magnification: tuple[float, float]  # ratio to nominal that still does
    fallback_bias_um: tuple[float, float] = (0.0, 0.0)  # as bias_um, of the fallback
    fallback_sigma_xy_um: float | None = None  # as sigma_xy_um, of the fallback
    fallback_sigma_theta_rad: float | None = None  # as sigma_theta_rad, of the fallback
    fallback_min_score: float = 0.0  # as gates.min_score, of the fallback
    feature: str = ""  # what is measured; "": the look's target
    offset_um: tuple[float, float] = (0.0, 0.0)  # from the target, in the part's frame
    turn_rad: float = 0.0  # of the feature's frame in the part's
    # by rising dz_um; plans before 2.5 predict it, nothing reads it
    bias_through_focus: tuple[BiasAt, ...] = ()
    depth: Depth | None = None  # None: not computed
    # Added after 2.3; None: unknown. What sigma and bias are known by.
    repeatability: Repeatability | None = None
    usable_draws: int | None = None  # images at each stop of the usable ranges
    # Added after 2.4; None: unknown. What its images' errors cost, of the chain.
    model_cost: ModelCost | None = None
    fallback_model_cost: ModelCost | None = None  # as model_cost, of the fallback
