"""The plan's record of the measurement of one feature."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.featuresel.limits.resolution import contrast, spurious_um
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.selection.constraints import Limits
from microplan.featuresel.trials.gates import Gate, choose_gate
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.repeatability import Repeated
from microplan.featuresel.trials.score import ChainScore
from microplan.featuresel.trials.tolerance_search import UsableRange
from microplan.featuresel.trials.trials import is_wrong
from microplan.optics.lens.jacobian import point_jacobian, to_px
from microplan.planner.looks.evaluation import Evaluation, use_of
from microplan.planner.looks.model_errors.charged_chains import ChargedChains
from microplan.planner.looks.model_errors.model_cost import AcceptedRange
from microplan.planner.looks.records import repeatability_record, undetected
from microplan.planner.views.features import offset_um
from microplan.planner.views.requests import Request
from microplan.planner.views.targets import TargetShape
from microplan.schemas import plan as p
from microplan.schemas.pose import Pose

# Gates lie outside what every accepted trial showed, by these margins.
SCORE_MARGIN = 0.8
# What a score lacks of 1 grows as the square of what pictures differ from images by:
# they may differ by 2.5 times as much as in the worst trial.
SHORTFALL = 2.5**2
LACKS = 0.005  # of 1 at least: one edge of many may be lost where no trial lost any
SHIFT_MARGIN = 1.5
SPREAD_MARGIN = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredFeature:
    """A feature that a look measures, with its accuracy and usable range."""

    shape: TargetShape
    tried: Evaluation
    chosen: ChainScore
    usable: UsableRange
    depth: p.Depth | None
    sigma_um: float | None  # that its position counts with; None: that of the trials
    repeated: Repeated  # chain and fallback, on fresh random trials
    draws: int  # images at each stop of the usable range
    charges: ChargedChains  # what errors of its images cost

    @property
    def promised(self) -> ChainScore:
        """Return the chain's errors on random trials that it was not chosen by."""
        return self.repeated.of(self.chosen.chain)

    @property
    def spare(self) -> ChainScore | None:
        """Return the fallback's errors on the same trials, None without one."""
        spare = self.tried.comparison.selection.fallback
        return None if spare is None else self.repeated.of(spare.chain)


def measure_record(
    request: Request, target: TargetShape, found: MeasuredFeature
) -> p.Measure:
    """Return the measurement of a feature, with the accuracy found in trials."""
    tried, shape, chosen = found.tried, found.shape, found.promised
    case, spare, charges = tried.case, found.spare, found.charges
    gates = acceptance_gates(tried, found.chosen, charges.accepted)
    spare_chain = () if spare is None else spare.chain
    where = look_key(request, target, shape)
    return p.Measure(
        chain=tuple(use_of(where, tried, name) for name in chosen.chain),
        fallback=tuple(use_of(where, tried, name) for name in spare_chain),
        region=p.Region(
            row=case.window.row,
            column=case.window.column,
            rows=case.window.rows,
            columns=case.window.columns,
        ),
        reference=p.Reference(
            column=case.target.column,
            row=case.target.row,
            pose=Pose(x_um=case.x_um, y_um=case.y_um, theta_rad=case.theta_rad),
            z_um=case.focus_um,
        ),
        bias_um=_with_model(chosen.bias_um, found.charges.chain),
        jacobian_px_per_um=_jacobian(case),
        sigma_xy_um=_charged_um(
            found.sigma_um or chosen.sigma_um, found.charges.chain, _true_um(found)
        ),
        sigma_theta_rad=_sigma_theta_rad(found),
        limit_xy_um=found.chosen.limit_um,
        gates=gates,
        capture_um=case.spread.search_um,
        symmetry=shape.symmetry,
        symmetry_broken_by=shape.symmetry_broken_by
        if case.tolerance_theta_rad is not None
        else "",
        usable_focus_um=found.usable.focus_um,
        usable_magnification=found.usable.magnification,
        fallback_bias_um=_with_model(
            spare.bias_um if spare else None, found.charges.fallback
        ),
        fallback_sigma_xy_um=None if spare is None else _spare_sigma_um(found, spare),
        fallback_sigma_theta_rad=None if spare is None else spare.sigma_theta_rad,
        fallback_min_score=0.0
        if spare is None
        else _min_score(tried, spare, charges.fallback_accepted),
        feature="" if shape.name == target.name else shape.name,
        offset_um=offset_um(shape, target),
        turn_rad=shape.angle_rad,
        depth=found.depth,
        repeatability=repeatability_record(
            chosen,
            undetected(case, found.repeated.outcomes.by(chosen.chain), gates),
            found.repeated.true(chosen.chain),
        ),
        usable_draws=found.draws,
        model_cost=found.charges.chain,
        fallback_model_cost=found.charges.fallback,
    )


def _with_model(
    bias_um: tuple[float, float] | None, cost: p.ModelCost | None
) -> tuple[float, float]:
    """Return a bias in trials with that of their images, which it adds to."""
    x, y = bias_um or (0.0, 0.0)
    if cost is None:
        return (x, y)
    return (x + cost.bias_um[0], y + cost.bias_um[1])


def _charged_um(
    sigma_um: float | None, cost: p.ModelCost | None, true_um: float
) -> float:
    """Return sigma of trials with what images' errors change of it; None is 0."""
    own_um = sigma_um or 0.0
    return own_um if cost is None else cost.charged_um(own_um, true_um)


def _true_um(found: MeasuredFeature, spare: ChainScore | None = None) -> float:
    """Return how far discrepancies move the chain's answers, or the fallback's, um."""
    chain = (spare or found.promised).chain
    return found.repeated.true(chain).worse_um


def _spare_sigma_um(found: MeasuredFeature, spare: ChainScore) -> float:
    """Return a fallback's sigma, um, with what the chain's own has besides trials."""
    own, counts = found.promised.sigma_um or 0.0, found.sigma_um or 0.0
    more = math.sqrt(max(counts**2 - own**2, 0.0))
    true_um = _true_um(found, spare)
    return math.hypot(
        _charged_um(spare.sigma_um, found.charges.fallback, true_um), more
    )


def _sigma_theta_rad(found: MeasuredFeature) -> float | None:
    """Return sigma of the angle; of one of several features, its bias included."""
    sigma = found.promised.sigma_theta_rad
    if sigma is None:
        return sigma
    cost = found.charges.chain
    if cost is not None:
        sigma = math.hypot(sigma, cost.sigma_theta_rad or 0.0)
    if found.sigma_um is None:
        return sigma
    return math.hypot(sigma, found.promised.bias_theta_rad or 0.0)


def depth_record(case: LookCase, usable: UsableRange) -> p.Depth:
    """Return the depths of field to compare a usable focus range with."""
    low, high = (float(v) for v in contrast(case, usable.focus_um))
    turned_um = spurious_um(case)
    return p.Depth(
        textbook_um=case.microscope.wave_depth_um,
        spurious_um=turned_um if math.isfinite(turned_um) else None,
        contrast=(low, high),
    )


def look_key(request: Request, target: TargetShape, shape: TargetShape) -> str:
    """Return the name that the files of a look's feature begin with."""
    return request.id if shape.name == target.name else f"{request.id}.{shape.name}"


def acceptance_gates(
    tried: Evaluation, chosen: ChainScore, accepted: AcceptedRange
) -> p.Gates:
    """Return the acceptance gates of a measurement: all good answers and a margin.

    Those of trials, and on better images.
    """
    good, gate = _good(tried, chosen), _gate(tried, chosen)
    spreads = [o.spread_um for o in good if o.spread_um is not None]
    widest = SPREAD_MARGIN * max(*spreads, accepted.widest_um, 0.0)
    cap_um = math.inf if gate is None else gate.cap_um
    return p.Gates(
        min_score=_min_score(tried, chosen, accepted),
        max_shift_um=SHIFT_MARGIN * tried.case.spread.search_um,
        max_turn_rad=None,
        max_spread_um=min(max(widest, tried.case.tolerance_um), cap_um),
    )


def _min_score(tried: Evaluation, chain: ChainScore, accepted: AcceptedRange) -> float:
    """Return the least score a chain may have: a margin below the good answers.

    Those on better images are among them. Wrong answers in trials are refused as far as
    the limit of undetected failures asks for.
    """
    scores = [o.score for o in _good(tried, chain) if o.score is not None]
    usual = usual_score(min([*scores, accepted.least_score])) if scores else 0.0
    gate = _gate(tried, chain)
    return usual if gate is None else max(usual, gate.refuses)


def usual_score(least: float) -> float:
    """Return the least score to believe, where good answers of trials had `least`.

    0..1. A share of it; near 1 a multiple of what it lacks, or parts that look nearly
    like the target would pass.
    """
    return max(SCORE_MARGIN * least, 1 - SHORTFALL * max(1 - least, LACKS))


def _gate(tried: Evaluation, chain: ChainScore) -> Gate | None:
    """Return what keeps a chain's undetected failures in trials below the limit."""
    mine = tried.comparison.outcomes.by(chain.chain)
    return choose_gate(tried.case, mine, silent_limit=Limits().silent_upper)


def _good(tried: Evaluation, chain: ChainScore) -> list[Outcome]:
    """Return the outcomes of a chain that are not wrong."""
    mine = tried.comparison.outcomes.by(chain.chain)
    return [o for o in mine if not is_wrong(tried.case, o)]


def _jacobian(case: LookCase) -> tuple[tuple[float, ...], ...]:
    """Return d(u, v) / d(x, y, theta, zoom) at the nominal position.

    Columns as in `microplan.optics.lens.jacobian.point_jacobian`; the rotation is about
    the target.
    """
    here_um = (case.x_um, case.y_um)
    point = to_px(np.array([here_um]), case.microscope)
    matrix = point_jacobian(point, case.microscope, axis_um=here_um)
    return tuple(tuple(float(v) for v in row) for row in matrix)
