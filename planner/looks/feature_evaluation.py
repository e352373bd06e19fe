"""The features of one look, each evaluated as one of several in a set."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from microplan.featuresel.features.feature import Feature
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.selection.evaluate import RoutineComparison, compare_routines
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.trial_cache import Looks
from microplan.featuresel.trials.trials import Map
from microplan.optics.render.fidelity import Fidelity
from microplan.planner.looks.evaluation import Evaluation, TestedFeature, unseen
from microplan.planner.looks.look_problem import LookProblem
from microplan.planner.looks.scenario import SHARE_TOGETHER, feature_case
from microplan.planner.task.presets import Effort
from microplan.planner.views.features import Proposals, drawn, proposals
from microplan.planner.views.targets import TargetShape
from microplan.schemas import plan as p

_Comparer = Callable[[LookCase], RoutineComparison]
_Candidate = tuple[Feature, TargetShape, LookCase]  # a feature to be evaluated


def evaluate_features(
    problem: LookProblem, tried: Evaluation
) -> tuple[list[TestedFeature], list[p.FeatureRow]]:
    """Return the features that were evaluated, and a row for each that was not.

    `tried` is the evaluation of the target alone, here and below.
    """
    known = _proposals(problem)
    others, skipped = _candidates(problem, tried, known)
    target = _target(problem, tried, known.target)
    return [target, *_tested(problem, tried.fidelity, others)], skipped


def begin_features(problem: LookProblem, tried: Evaluation) -> None:
    """Evaluate the other features in advance; `problem.begun` takes the results.

    Their tolerances may be others when their turn comes.
    """

    def begin(_: _Comparer, cases: Sequence[LookCase]) -> Iterator[RoutineComparison]:
        for case in cases:
            problem.begun.others[case.key] = Looks()
            yield _continued(problem, case)

    others, _ = _candidates(problem, tried, _proposals(problem))
    stakes, cases = _stakes(problem), [case for *_, case in others]
    problem.context.memo.each(_compare, stakes, cases, begin)


def target_alone(
    problem: LookProblem, tried: Evaluation
) -> tuple[TestedFeature, list[p.FeatureRow]]:
    """Return the target as a feature, and a row for every other: none is evaluated."""
    known = _proposals(problem)
    reason = f"not tried: {problem.shape.name} alone does"
    others = [_not_tried(shape, reason) for _, shape in known.others]
    return _as_feature(problem, known.target, tried), [*others, *_avoided(known)]


def without_chains(tested: TestedFeature, struck: Mapping[Chain, str]) -> TestedFeature:
    """Return a feature whose chain is chosen without some, for the reasons given."""
    tried = tested.tried
    judged = tried.comparison.judged(tried.case, in_set=True, rejected=struck)
    return replace(tested, tried=replace(tried, comparison=judged))


def _proposals(problem: LookProblem) -> Proposals:
    """Return the features that may be measured, and those that may not."""
    return proposals(problem.task, problem.shape)


def _candidates(
    problem: LookProblem, tried: Evaluation, known: Proposals
) -> tuple[list[_Candidate], list[p.FeatureRow]]:
    """Return the features to evaluate besides the target, and a row for each other."""
    most = problem.context.effort.features
    others, skipped = list[_Candidate](), _avoided(known)
    for feature, shape in known.others:
        case = feature_case(
            problem.task, problem.request, tried.case, shape, problem.context.memo
        )
        why = unseen(case)
        if not why and len(others) == most:
            why = f"not tried: {most} others were"
        if why:
            skipped.append(_not_tried(shape, why))
        else:
            others.append((feature, shape, case))
    return others, skipped


def _tested(
    problem: LookProblem, fidelity: Fidelity, candidates: Sequence[_Candidate]
) -> list[TestedFeature]:
    """Return the features after the comparison of their routines.

    Comparisons that have begun go on.
    """

    def spread(_: _Comparer, cases: Sequence[LookCase]) -> Iterable[RoutineComparison]:
        return (_continued(problem, case) for case in cases)

    cases = [case for *_, case in candidates]
    found = problem.context.memo.each(_compare, _stakes(problem), cases, spread)
    return [
        TestedFeature(
            feature=feature,
            shape=shape,
            tried=Evaluation(case=case, fidelity=fidelity, comparison=comparison),
        )
        for (feature, shape, case), comparison in zip(candidates, found, strict=True)
    ]


def _compare(
    stakes: tuple[int, Effort],
    case: LookCase,
    *,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
    looks: Looks | None = None,
) -> RoutineComparison:
    """Return the comparison of routines for one of several features."""
    seed, effort = stakes
    return compare_routines(
        case,
        root_seed=seed,
        most=effort.trials,
        thorough=effort.thorough,
        limited=effort.limited,
        in_set=True,
        map=map,
        looks=looks,
    )


def _stakes(problem: LookProblem) -> tuple[int, Effort]:
    """Return the seed and the effort that all features of a look share."""
    return problem.task.seed, problem.context.effort


def _continued(problem: LookProblem, case: LookCase) -> RoutineComparison:
    """Return a comparison that goes on from the results known of it."""
    looks = problem.begun.others.get(case.key)
    spread = problem.context.spread("other features")
    return _compare(_stakes(problem), case, map=spread, looks=looks)


def _target(
    problem: LookProblem, tried: Evaluation, known: Feature | None
) -> TestedFeature:
    """Return the target itself, its chains judged as those of one of several."""
    own, shape = tried.case, problem.shape
    angle = own.tolerance_theta_rad
    if angle is not None and shape.symmetry == 0:
        # alone it had few trials, as hopeless: it has no angle
        case = feature_case(
            problem.task, problem.request, own, shape, problem.context.memo
        )
        candidate = (known or drawn(shape), shape, case)
        (found,) = _tested(problem, tried.fidelity, [candidate])
        return found
    case = replace(
        own,
        tolerance_um=own.tolerance_um * SHARE_TOGETHER,
        tolerance_theta_rad=None if angle is None else angle * SHARE_TOGETHER,
    )
    return _as_feature(problem, known, _judged_again(tried, case))


def _judged_again(tried: Evaluation, case: LookCase) -> Evaluation:
    """Return the target's own trials, judged by the tolerances of `case`."""
    comparison = tried.comparison.judged(case, in_set=True)
    return replace(tried, case=case, comparison=comparison)


def _as_feature(
    problem: LookProblem, known: Feature | None, tried: Evaluation
) -> TestedFeature:
    """Return the target as a feature; where it is measured, not where proposed."""
    shape = problem.shape
    feature = replace(
        known or drawn(shape), center_um=shape.center_um, angle_rad=shape.angle_rad
    )
    return TestedFeature(feature=feature, shape=shape, tried=tried)


def _not_tried(shape: TargetShape, reason: str) -> p.FeatureRow:
    """Return the row of a feature that was not evaluated."""
    return p.FeatureRow(name=shape.name, kind=shape.kind, reason=reason)


def _avoided(known: Proposals) -> list[p.FeatureRow]:
    """Return the rows of the features that the task excludes."""
    return [
        p.FeatureRow(name=name, kind=kind, reason="avoided: the task says so")
        for name, kind in known.avoided
    ]
