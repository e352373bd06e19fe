"""Success probability of one insertion from all its error terms."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.assembly.fits.peg_in_hole import slices_of
from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.budget.probability.ellipse_probability import (
    PlaneNormal,
    beyond_radii,
)
from microplan.planner.budget.probability.fit_probability import (
    Residual,
    RoundFit,
    miss_probability,
)
from microplan.planner.budget.probability.outline_fit import OutlineFit, PoseError
from microplan.planner.budget.probability.outline_probability import Seating, seating
from microplan.planner.budget.probability.polygon_mass import PlaneError
from microplan.planner.budget.probability.quadrature import cuts_between, nodes_between
from microplan.planner.budget.probability.servo_landing import BODY_SIGMAS, STEP_SIGMAS
from microplan.schemas.plan import BudgetRow

SERVO, OFFSET, SIZE, ANGLE, ALL = "servo", "offset", "size", "angle", "all"
# Axes of a covariance closer than this are one: it moves probabilities by less than
# 1e-9.
ROUND = 1e-9
LEAST_NODES, MOST_NODES = 8, 128
# Below this share of the wide axis the probability bends too sharply for Hermite nodes.
SMOOTH = 0.5
PIECE_NODES = 6
# How closely the mean over the wide axis is found; probabilities are quoted to 4
# digits.
CLOSE = 1e-5
NO_ANGLE = AngleError(left_rad=0.0, cut_rad=math.inf, rows=())


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleLeft:
    """Angle that an alignment leaves."""

    sigma_rad: float  # before it is cut off
    within_rad: float  # where that is, inf: nowhere


@dataclass(frozen=True, slots=True, kw_only=True)
class LateralResidual:
    """Lateral residual before an insertion, with its name in the budget."""

    residual: Residual
    term: str
    source: str
    early: tuple[float, Residual] | None = None  # as `Insertion` has them
    turned: tuple[float, Residual] | None = None
    angle: AngleLeft | None = None  # None: the alignment turns nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class Insertion:
    """A fit with all lateral errors of the two parts."""

    fit: RoundFit | OutlineFit
    residual: Residual  # what the servo leaves
    blind: tuple[BudgetRow, ...]  # what it cannot see
    offset_um: float = 0.0  # that is not corrected
    offset_rad: float = 0.0  # its direction in the world, as `along_rad` of the rows
    # share of alignments that end at their first look, and what those leave
    early: tuple[float, Residual] | None = None
    # share of those whose correction turns, and what those leave
    turned: tuple[float, Residual] | None = None
    # of other outlines than circles: the error of the shaft's angle, that of the hole
    # in the world, and what an error of the angle moves the shaft by, um per rad
    angle: AngleError | None = None
    hole_rad: float = 0.0
    lever_um: tuple[float, float] = (0.0, 0.0)

    @property
    def left_um(self) -> float:
        """Return the residual of the servo, um, root mean square per axis."""
        square = 0.0
        for share, residual in self.shares:
            radii, weights = residual.radii()
            square += share * float(weights @ radii**2) / 2
        return math.sqrt(square)

    @property
    def shares(self) -> tuple[tuple[float, Residual], ...]:
        """Return the shares of alignments, and what those leave; they add up to 1."""
        others = [each for each in (self.early, self.turned) if each is not None]
        rest = max(1 - sum(share for share, _ in others), 0.0)
        return tuple(each for each in ((rest, self.residual), *others) if each[0] > 0)

    @property
    def round_fit(self) -> RoundFit:
        """Return the fit of two circles; another one is the caller's mistake."""
        if isinstance(self.fit, OutlineFit):
            raise TypeError("the outlines of this fit are not both circles")
        return self.fit

    @property
    def rest(self) -> PlaneNormal:
        """Return the distribution of all that the servo cannot see, with the offset."""
        off, way = self.offset_um, self.offset_rad
        middle_um = (off * math.cos(way), off * math.sin(way))
        law = PlaneNormal(middle_um=middle_um, xx_um2=0.0, yy_um2=0.0)
        for row in self.blind:
            law = law.plus(PlaneNormal.along(row.sigma_um or 0.0, row.along_rad))
        return law

    @property
    def miss(self) -> float:
        """Return the probability of a miss; tails keep their digits.

        What acts along one direction only widens the rest there: the wide axis is
        averaged over, the narrow one is common to all directions.
        """
        if self.early is not None or self.turned is not None:
            return sum(w * self.after(left).miss for w, left in self.shares)
        if isinstance(self.fit, OutlineFit):
            return self.seating.miss
        rest, fit = self.rest, self.round_fit
        room = fit.room
        narrow, wide, angle = rest.principal
        if not self._leans:
            return miss_probability(fit, self.residual, wide, abs(self.offset_um))
        if math.isinf(self.residual.within_um) or self.residual.sigma_um <= 0:
            left = PlaneNormal.along(self.residual.sigma_um, None)
            return beyond_radii(
                room.radius_um, room.flat_um, room.reach_um, rest.plus(left)
            )
        extra = math.sqrt((wide - narrow) * (wide + narrow))
        return self._averaged(narrow, extra, angle - self.offset_rad)

    @property
    def angle_um(self) -> float:
        """Return what one sigma of the angle moves the shaft's farthest point by."""
        return 0.0 if self.angle is None else self.angle.sigma_rad * self.reach_um

    @property
    def reach_um(self) -> float:
        """Return how far the shaft's farthest point is, 0 where no angle matters."""
        if self.angle is None or not isinstance(self.fit, OutlineFit):
            return 0.0
        return slices_of(self.fit.shape).reach_um

    @property
    def seating(self) -> Seating:
        """Return what comes of an insertion of other outlines than circles."""
        if not isinstance(self.fit, OutlineFit):
            raise TypeError("a round fit has no outlines")
        found = [
            (w, seating(self.fit, self.after(left).pose_error))
            for w, left in self.shares
        ]
        return Seating(
            seated=sum(w * each.seated for w, each in found),
            elsewhere=sum(w * each.elsewhere for w, each in found),
            miss=sum(w * (each.miss + each.elsewhere) for w, each in found),
        )

    def after(self, left: Residual) -> Insertion:
        """Return the same insertion after alignments that all leave one of `shares`."""
        return replace(self, residual=left, early=None, turned=None)

    @property
    def pose_error(self) -> PoseError:
        """Return the error of the shaft's pose in the frame of the hole as planned.

        The rows are of the hole's place about the shaft's: the other way round.
        """
        c, s = -math.cos(self.hole_rad), math.sin(self.hole_rad)
        rest, lever = self.rest, self.lever_um
        to_hole = np.array([[c, -s], [s, c]])
        cov = np.array([[rest.xx_um2, rest.xy_um2], [rest.xy_um2, rest.yy_um2]])
        (xx, xy), (_, yy) = (to_hole @ cov @ to_hole.T).tolist()
        middle = (to_hole @ np.array(rest.middle_um)).tolist()
        arm = (to_hole @ np.array(lever)).tolist()
        plane = PlaneNormal(
            middle_um=(middle[0], middle[1]),
            xx_um2=max(xx, 0.0), xy_um2=xy, yy_um2=max(yy, 0.0),
        )  # fmt: skip
        return PoseError(
            plane=PlaneError(residual=self.residual, rest=plane),
            angle=self.angle or NO_ANGLE,
            lever_um=(arm[0], arm[1]),
        )

    @property
    def sizes_um(self) -> dict[str, float]:
        """Return sigma of each term that the servo cannot see, um."""
        return {row.term: row.sigma_um or 0.0 for row in self.blind}

    def missed_with(self, offset_um: float) -> float:
        """Return the probability of a miss with one more offset in the worst direction.

        To an offset that is there already it adds up. Without one the rest is widest
        along one direction and narrowest across it: the worse of both. Outlines have
        less room by it all round, which is as bad as the worst direction or worse.
        """
        if isinstance(self.fit, OutlineFit):
            return self.widened(-2 * offset_um).miss
        if offset_um == 0 or self.offset_um != 0:
            return replace(self, offset_um=abs(self.offset_um) + offset_um).miss
        _, _, angle = self.rest.principal
        turns = {angle, angle + math.pi / 2} if self._leans else {0.0}
        return max(
            replace(self, offset_um=offset_um, offset_rad=turn).miss for turn in turns
        )

    @property
    def _leans(self) -> bool:
        """Return whether the rest depends on the direction."""
        narrow, wide, _ = self.rest.principal
        return wide - narrow > ROUND * wide

    def _averaged(self, narrow_um: float, extra_um: float, angle_rad: float) -> float:
        """Return the mean probability over a shift along the wide axis.

        `angle_rad` is that axis' own, from the offset's direction on.
        """
        if narrow_um < SMOOTH * extra_um:
            shifts, weights = self._pieces(extra_um, angle_rad)
            return min(1.0, self._mean(shifts, weights, narrow_um, angle_rad))
        before, count = math.inf, LEAST_NODES
        while True:
            nodes, weights = np.polynomial.hermite_e.hermegauss(count)
            weights = weights / weights.sum()
            found = self._mean(extra_um * nodes, weights, narrow_um, angle_rad)
            if abs(found - before) <= CLOSE * found or 2 * count > MOST_NODES:
                return min(1.0, found)
            before, count = found, 2 * count

    def _mean(
        self,
        shifts_um: FloatArray,
        weights: FloatArray,
        narrow_um: float,
        angle_rad: float,
    ) -> float:
        """Return the weighted probability over shifts, (N,) each."""
        x = self.offset_um + shifts_um * math.cos(angle_rad)
        fit = self.round_fit
        off_um = np.hypot(x, shifts_um * math.sin(angle_rad))
        chances: dict[float, float] = {}  # most come twice, on either side
        for off in off_um.tolist():
            if off not in chances:
                chances[off] = miss_probability(fit, self.residual, narrow_um, off)
        return float(weights @ np.array([chances[off] for off in off_um.tolist()]))

    def _pieces(
        self, extra_um: float, angle_rad: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return shifts and weights, (N,) um each, between bends of the probability.

        It does where the disc that the servo leaves begins or ends to touch a circle.
        """
        room, within = self.round_fit.room, self.residual.within_um
        sizes = room.radius_um + np.array([-1.0, 0.0, 1.0]) * room.reach_um
        touch = np.abs(np.concatenate([sizes - within, sizes, sizes + within]))
        middle = -self.offset_um * math.cos(angle_rad)
        side = np.sqrt(
            np.maximum(touch**2 - (self.offset_um * math.sin(angle_rad)) ** 2, 0.0)
        )
        body = np.arange(-BODY_SIGMAS, BODY_SIGMAS + 1, STEP_SIGMAS) * extra_um
        reach = BODY_SIGMAS * extra_um
        bends = np.concatenate([body, middle - side, middle + side])
        shifts, weights = nodes_between(cuts_between(-reach, bends, reach), PIECE_NODES)
        law = weights * np.exp(-((shifts / extra_um) ** 2) / 2)
        return shifts, law / law.sum()

    def scaled(self, term: str, factor: float) -> Insertion:
        """Return the same insertion with one term scaled.

        `term` is that of a row in `blind`, or SERVO, OFFSET, SIZE, or ALL of them. A
        finer stage is also asked to stop closer, in its own sigmas.
        """
        if term == ALL:
            rows = dict.fromkeys(row.term for row in self.blind)
            found = self
            keys = (SERVO, OFFSET, SIZE, *rows)
            if self.angle is not None:
                keys = (*keys, ANGLE)
            for key in keys:
                found = found.scaled(key, factor)
            return found
        if term == SERVO:
            early, turned = (
                None if each is None else (each[0], _scaled(each[1], factor))
                for each in (self.early, self.turned)
            )
            left = _scaled(self.residual, factor)
            return replace(self, residual=left, early=early, turned=turned)
        if term == OFFSET:
            return replace(self, offset_um=self.offset_um * factor)
        if term == SIZE:
            return replace(self, fit=_resized(self.fit, factor))
        if term == ANGLE and self.angle is not None:
            return replace(self, angle=_finer(self.angle, factor))
        known = {row.term: row.sigma_um for row in self.blind}[term]
        return self if known is None else self.resized(term, factor * known)

    def resized(self, term: str, sigma_um: float) -> Insertion:
        """Return the same insertion with another size of a term of `blind`."""
        rows = tuple(
            replace(row, sigma_um=sigma_um) if row.term == term else row
            for row in self.blind
        )
        return replace(self, blind=rows)

    def widened(self, wider_um: float) -> Insertion:
        """Return the same insertion with more clearance on the diameter."""
        if isinstance(self.fit, OutlineFit):
            return replace(self, fit=self.fit.widened(wider_um / 2))
        fit = replace(self.fit, hole_um=self.fit.hole_um + wider_um / 2)
        return replace(self, fit=fit)


def _scaled(residual: Residual, factor: float) -> Residual:
    """Return what a finer or coarser servo leaves."""
    within_um = residual.within_um
    if not math.isinf(within_um):  # not cut off: it stays so, also at a factor of 0
        within_um *= factor
    return Residual(sigma_um=residual.sigma_um * factor, within_um=within_um)


def _finer(angle: AngleError, factor: float) -> AngleError:
    """Return an angle's error, all of it scaled."""
    rows = tuple(replace(r, sigma_rad=r.sigma_rad * factor) for r in angle.rows)
    cut = angle.cut_rad if math.isinf(angle.cut_rad) else angle.cut_rad * factor
    return AngleError(left_rad=angle.left_rad * factor, cut_rad=cut, rows=rows)


def _resized(fit: RoundFit | OutlineFit, factor: float) -> RoundFit | OutlineFit:
    """Return a fit with other tolerances."""
    if isinstance(fit, OutlineFit):
        return fit.scaled(factor)
    return replace(
        fit,
        hole_tolerance_um=fit.hole_tolerance_um * factor,
        shaft_tolerance_um=fit.shaft_tolerance_um * factor,
    )
