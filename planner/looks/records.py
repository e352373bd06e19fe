"""Records of a look in the plan: view, scene, evidence, reasons of rejection."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.bounds import (
    NORMAL_KURTOSIS,
    Estimate,
    failure_upper,
    half_width,
)
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.repeatability import Trueness
from microplan.featuresel.trials.score import ChainScore
from microplan.featuresel.trials.trials import is_wrong
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.looks.evaluation import ChosenSet, Evaluation
from microplan.planner.store.pictures import Picture, picture_sha256
from microplan.planner.task.task import Task
from microplan.planner.views.focus import look_stops
from microplan.planner.views.requests import Request
from microplan.planner.views.scenes import shade_of
from microplan.planner.views.target_views import needed_shape, target_pose
from microplan.planner.views.targets import TargetShape
from microplan.schemas import plan as p

_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
_UNSEEN = frozenset({
    "flat", "few_points", "few_rays", "misfit", "no_blob", "no_contrast", "no_edge",
    "no_fit", "no_notch", "no_peak", "no_teeth", "not_prepared", "too_dim",
})  # fmt: skip
_AWAY = frozenset({"border", "not_captured", "outside"})
_BLURRED = frozenset({"no_focus", "scale_off"})
_FAINT = (
    "most trials fail for want of contrast: a darker or brighter ground "
    "('reflectance'), other light, or another feature"
)
_FAR = (
    "most trials fail as it lies too far off: state a smaller sigma at its start if "
    "that is so, or locate something first that shows in a wider field"
)
_OTHER = (
    "most trials fail as scale or focus is off: state a smaller 'focus_sigma_um' or "
    "'magnification_sigma' if the station keeps them"
)
_SPOILT = {"edges": "every edge", "area": "the brightness of every area"}
_HINTS = ((_UNSEEN, _FAINT), (_AWAY, _FAR), (_BLURRED, _OTHER))


def rejections(reasons: Sequence[tuple[Chain, str]]) -> str:
    """Return the reasons against chains, the commonest first.

    Reasons that differ in numbers alone count as one; the first chain's numbers stand
    for them. Equally common ones keep their order.

    Parameters
    ----------
    reasons : sequence of (chain, reason)
        As in `microplan.featuresel.selection.select.Selection`.
    """
    kinds: dict[str, list[tuple[Chain, str]]] = {}
    for chain, why in reasons:
        said = why.removeprefix("rejected: ")
        kinds.setdefault(_kind(said), []).append((chain, said))
    ordered = sorted(kinds.values(), key=lambda alike: -len(alike))  # stable
    return "; ".join(map(_described, ordered))


def commonest_hint(scores: Sequence[ChainScore], advice: str) -> str:
    """Return a hint against the commonest failure of all trials, and `advice`.

    `advice` alone where trials fail by nothing that is known.
    """
    codes: Counter[str] = Counter()
    for score in scores:
        codes.update(dict(score.failures))
    counts = [sum(codes[code] for code in kind) for kind, _ in _HINTS]
    answered = sum(score.success + score.silent for score in scores)
    if max(counts) <= answered:  # most trials had an answer: what it lacks is advised
        return advice
    hint = _HINTS[counts.index(max(counts))][1]
    return f"{advice}; {hint}" if advice else hint


def _kind(why: str) -> str:
    """Return a reason without its numbers, and without how far off answers were."""
    return _NUMBER.sub("#", re.sub(r"; worst .*", "", why))


def _described(alike: Sequence[tuple[Chain, str]]) -> str:
    """Return one reason, with its first chain and how many share it."""
    chain, why = alike[0]
    more = f" and {len(alike) - 1} more" if len(alike) > 1 else ""
    return f"{' > '.join(chain)}{more}: {why}"


def view_record(
    task: Task,
    request: Request,
    case: LookCase,
    usable_um: Sequence[tuple[float, float]],
) -> p.View:
    """Return the microscope's setting; `usable_um` has each feature's focus range."""
    shape = needed_shape(task, request)
    return p.View(
        magnification=case.microscope.magnification,
        focus_um=case.focus_um,
        focus_stops_um=look_stops(
            task, request.state, shape.owner, case.focus_um, usable_um
        ),
        light=case.light.gain,
        field_um=case.microscope.field_um,
        um_per_px=case.microscope.um_per_px,
        follows=target_pose(task, request, shape).followed_um > 0,
    )


def evidence(
    tried: Evaluation,
    chosen: ChainScore,
    features: Sequence[p.FeatureRow],
    tolerance_um: float,
) -> p.Evidence:
    """Return every chain's score with the reason for or against it.

    `tolerance_um` is the look's own; one of several features may have a wider one.
    """
    reasons = dict(tried.comparison.selection.reasons)
    spare = tried.comparison.selection.fallback
    return p.Evidence(
        tolerance_um=tolerance_um,
        chosen=_score(chosen, reasons[chosen.chain]),
        others=tuple(
            _score(other, reasons[other.chain])
            for other in tried.comparison.scores
            if other.chain != chosen.chain
        ),
        features=tuple(features),
        fallback=fallback_record(tried, chosen, spare),
    )


def fallback_record(
    tried: Evaluation, chosen: ChainScore, spare: ChainScore | None
) -> p.FallbackRecord:
    """Return how often a chain and its fallback fail, and fail together."""
    failed, had = _wrong_trials(tried, chosen.chain)
    both_failed = failed
    if spare is not None:
        spare_failed, spare_had = _wrong_trials(tried, spare.chain)
        had &= spare_had
        failed &= had
        both_failed = failed & spare_failed
    another = spare is not None and spare.principle != chosen.principle
    return p.FallbackRecord(
        principle=chosen.principle,
        other_principle="" if spare is None else spare.principle,
        trials=len(had),
        chain_failed=len(failed),
        both_failed=len(both_failed),
        both_failed_upper=failure_upper(len(both_failed), len(had)),
        lack="" if another else _lack(chosen, spare, len(both_failed), len(had)),
    )


def _wrong_trials(tried: Evaluation, chain: Chain) -> tuple[set[int], set[int]]:
    """Return the trials in which a chain gave no right answer, and all of its own."""
    outcomes = tried.comparison.outcomes.by(chain)
    wrong = {
        o.trial for o in outcomes if o.failure is not None or is_wrong(tried.case, o)
    }
    return wrong, {o.trial for o in outcomes}


def _lack(
    chosen: ChainScore, spare: ChainScore | None, failed: int, trials: int
) -> str:
    """Return what it costs that no fallback rests on another principle."""
    other = "area" if chosen.principle == "edges" else "edges"
    if spare is None:
        return (
            f"no other chain passes: {failed} of {trials} trials need another look, "
            "and what spoils every image stops the run"
        )
    return (
        f"no chain by {other} passes; the fallback goes by {spare.principle} too: "
        f"{failed} of {trials} trials need another look, and what spoils "
        f"{_SPOILT[chosen.principle]} stops the run"
    )


def scene_record(
    task: Task,
    request: Request,
    scope: Microscope,
    layers: Iterable[Layer],
    shape: TargetShape,
    name: str,
    image: Picture,
) -> p.SceneRecord:
    """Return the scene's layers, and the edges that are hidden or shaded."""
    spot = target_pose(task, request, shape)
    return p.SceneRecord(
        layers=tuple(
            p.LayerRecord(name=la.name, z_um=la.z_um, reflectance=la.reflectance)
            for la in sorted(layers, key=lambda la: (la.z_um, la.name))
        ),
        shades=shade_of(
            task, request.state, shape, spot, scope.aperture, scope.medium_index
        ),
        image=name,
        image_sha256=picture_sha256(image),
    )


def together_record(found: ChosenSet, cost: p.ModelCost | None = None) -> p.Together:
    """Return the pose accuracy of all features of a look together.

    Fabrication tolerances and biases may make sigma larger than in the set's trials:
    the larger counts. What errors of its images `cost` comes on top.
    """
    known = found.found.known
    dropped = math.hypot(found.found.dropped_um, found.shared_um)
    score = found.repeated or found.score
    turn = score.sigma_theta_rad
    if turn is not None and math.isfinite(known.sigma_theta_rad):
        turn = max(turn, known.sigma_theta_rad)
    sigma_um = found.sigma_um
    if cost is not None:
        sigma_um = math.hypot(sigma_um, max(cost.sigma_um))
        turn = None if turn is None else math.hypot(turn, cost.sigma_theta_rad or 0.0)
    return p.Together(
        sigma_xy_um=sigma_um,
        sigma_theta_rad=turn,
        conditioning=known.conditioning,
        dropped_um=dropped if math.isfinite(dropped) else None,
        least=found.least,
        success_lower=found.score.success_lower,
        silent_upper=found.score.silent_upper,
        repeatability=repeatability_record(score, score.silent, found.trueness),
        model_cost=cost,
    )


def _score(found: ChainScore, reason: str) -> p.Score:
    """Return a chain's score as the plan has it."""
    return p.Score(
        chain=found.chain,
        trials=found.trials,
        success=found.success,
        success_lower=found.success_lower,
        silent=found.silent,
        silent_upper=found.silent_upper,
        bias_um=found.bias_um,
        sigma_um=found.sigma_um,
        worst_um=found.worst_um,
        sigma_theta_rad=found.sigma_theta_rad,
        cost=found.cost,
        reason=reason,
        sigma_upper_um=_sigma_upper(found),
        ratio_to_limit=found.ratio,
        worst_trial=found.worst_trial,
        median_trial=found.median_trial,
        first_failing_trial=found.first_failing,
    )


def _sigma_upper(found: ChainScore) -> float | None:
    """Return the bound of the larger axis' sigma, None where nothing is known."""
    axes = [axis for axis in (found.x, found.y, found.along) if axis is not None]
    upper = max((axis.sigma_upper for axis in axes), default=math.inf)
    return upper if math.isfinite(upper) else None


def undetected(case: LookCase, outcomes: Sequence[Outcome], gates: p.Gates) -> int:
    """Return how many wrong answers the gates of a measurement accept."""
    return sum(
        is_wrong(case, o)
        and (o.score or 0.0) >= gates.min_score
        and (o.spread_um or 0.0) <= (gates.max_spread_um or math.inf)
        for o in outcomes
    )


def repeatability_record(
    found: ChainScore, undetected: int, true: Trueness | None = None
) -> p.Repeatability:
    """Return what random trials said of a chain, or of a set, as the plan has it.

    `true` is how far discrepancies moved the answers.
    """
    true = Trueness() if true is None else true
    axes = [axis for axis in (found.x, found.y, found.along) if axis is not None]
    theta = found.theta
    return p.Repeatability(
        trials=found.trials,
        answered=found.success,
        undetected=undetected,
        sigma_um=_on_axes(found, lambda axis: axis.sigma),
        kurtosis=max((axis.kurtosis for axis in axes), default=NORMAL_KURTOSIS),
        half_width_um=_on_axes(found, half_width),
        kurtosis_theta=None if theta is None else theta.kurtosis,
        bias_theta_rad=None if theta is None else theta.mean,
        half_width_theta_rad=None if theta is None else half_width(theta),
        trueness_um=true.um,
        trueness_rad=true.rad,
    )


def _on_axes(
    found: ChainScore, value: Callable[[Estimate], float]
) -> tuple[float, float]:
    """Return a number of each axis of the target's frame, of one direction its parts.

    0 where nothing was answered.
    """
    if found.along is not None and found.axis_rad is not None:
        length = value(found.along)
        c, s = math.cos(found.axis_rad), math.sin(found.axis_rad)
        return (length * abs(c), length * abs(s))
    if found.x is None or found.y is None:
        return (0.0, 0.0)
    return (value(found.x), value(found.y))
