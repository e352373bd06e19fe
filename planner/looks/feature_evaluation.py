"""The features of one look, each raced as one of several that are measured together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from microplan.featuresel.features.feature import Feature
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.evaluate import RoutineComparison, compare_routines
from microplan.featuresel.selection.select import select
from microplan.featuresel.trials.trial_cache import Looks
from microplan.featuresel.trials.trials import Map
from microplan.planner.looks.evaluation import Evaluation, TestedFeature, unseen
from microplan.planner.looks.look_problem import LookProblem, TargetResult
from microplan.planner.looks.scenario import SHARE_TOGETHER, feature_case
from microplan.planner.task.presets import Effort
from microplan.planner.views.features import Proposals, drawn, proposals
from microplan.planner.views.targets import TargetShape
from microplan.schemas import plan as p

_Spread = Callable[
    [Callable[[LookCase], RoutineComparison], Sequence[LookCase]],
    Iterable[RoutineComparison],
]
Candidate = tuple[Feature, TargetShape, LookCase]  # a feature that is to be raced


@dataclass(frozen=True, slots=True, kw_only=True)
class _Stakes:
    """What all features of a look are raced with."""

    seed: int
    effort: Effort


def _contest(
    stakes: _Stakes,
    case: LookCase,
    *,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
    looks: Looks | None = None,
) -> RoutineComparison:
    """Return the race over one of several features."""
    effort = stakes.effort
    return compare_routines(
        case,
        root_seed=stakes.seed,
        most=effort.trials,
        thorough=effort.thorough,
        limited=effort.limited,
        in_set=True,
        map=map,
        looks=looks,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Races:
    """The features of a look's part, raced beside the target's own contest."""

    job: LookProblem
    alone: TargetResult

    def run(self) -> tuple[list[TestedFeature], list[p.FeatureRow]]:
        """Return the features that were raced, and a row for each that was not."""
        known = self._known
        others, skipped = self._worth_racing(known)
        return [self._target(known.target), *self._others(others)], skipped

    def begin(self) -> None:
        """Race the features beside the target; the job's beginning takes what it shows.

        What they have to meet may be another thing when their turn comes.
        """
        others, _ = self._worth_racing(self._known)
        self._contests([case for *_, case in others], self._begin)

    def unraced(self) -> tuple[TestedFeature, list[p.FeatureRow]]:
        """Return the target as it is alone, and a row for every other feature."""
        known = self._known
        reason = f"not tried: {self.job.shape.name} alone does"
        others = [_not_tried(shape, reason) for _, shape in known.others]
        target = self._raced_target(known.target, self.alone.tried)
        return target, [*others, *_avoided(known)]

    @property
    def _known(self) -> Proposals:
        """Return the features that may be measured, and those that may not."""
        return proposals(self.job.task, self.job.request, self.job.shape)

    def _worth_racing(
        self, known: Proposals
    ) -> tuple[list[Candidate], list[p.FeatureRow]]:
        """Return the features to race beside the target, and a row for each other."""
        most = self.job.effects.effort.features
        others, skipped = list[Candidate](), _avoided(known)
        for feature, shape in known.others:
            case = self._case(shape)
            why = unseen(case)
            if not why and len(others) == most:
                why = f"not tried: {most} others were"
            if why:
                skipped.append(_not_tried(shape, why))
            else:
                others.append((feature, shape, case))
        return others, skipped

    def _case(self, shape: TargetShape) -> LookCase:
        """Return the case of one of several features."""
        job, alone = self.job, self.alone
        return feature_case(job.task, job.request, alone.view, alone.tried.case, shape)

    def _others(self, features: Sequence[Candidate]) -> list[TestedFeature]:
        """Return other features after their races."""
        found = self._contests([case for *_, case in features], self._spread)
        return [
            self._after(candidate, contest)
            for candidate, contest in zip(features, found, strict=True)
        ]

    def _contests(
        self, cases: Sequence[LookCase], spread: _Spread
    ) -> list[RoutineComparison]:
        return self.job.effects.memo.each(_contest, self._stakes, cases, spread)

    @property
    def _stakes(self) -> _Stakes:
        return _Stakes(seed=self.job.task.seed, effort=self.job.effects.effort)

    def _begin(
        self,
        _contest: Callable[[LookCase], RoutineComparison],
        cases: Sequence[LookCase],
    ) -> Iterator[RoutineComparison]:
        """Hold contests one by one, and keep what they show."""
        for case in cases:
            self.job.begun.others[case.key] = Looks()
            yield self._go_on(case)

    def _spread(
        self,
        contest: Callable[[LookCase], RoutineComparison],
        cases: Sequence[LookCase],
    ) -> Iterable[RoutineComparison]:
        """Hold contests side by side; where they have begun, here and one by one."""
        if any(case.key in self.job.begun.others for case in cases):
            return map(self._go_on, cases)
        return self.job.effects.map(contest, cases)

    def _go_on(self, case: LookCase) -> RoutineComparison:
        """Return a contest from what is known of it on."""
        looks, spread = self.job.begun.others.get(case.key), self.job.effects.map
        return _contest(self._stakes, case, map=spread, looks=looks)

    def _after(self, candidate: Candidate, found: RoutineComparison) -> TestedFeature:
        """Return another feature after its race."""
        feature, shape, case = candidate
        tried = Evaluation.of(case, self.alone.tried.fidelity, found)
        return TestedFeature(
            feature=feature, shape=shape, tried=tried, visible=found.visible
        )

    def _target(self, known: Feature | None) -> TestedFeature:
        """Return the target itself, its chains judged as those of one of several."""
        own, shape = self.alone.tried.case, self.job.shape
        turn = own.tolerance_theta_rad
        if turn is not None and shape.symmetry == 0:
            # alone it had few trials, as hopeless: it tells no angle
            (found,) = self._others([(known or drawn(shape), shape, self._case(shape))])
            return found
        case = replace(
            own,
            tolerance_um=own.tolerance_um * SHARE_TOGETHER,
            tolerance_theta_rad=None if turn is None else turn * SHARE_TOGETHER,
        )
        return self._raced_target(known, self._judged_again(case))

    def _judged_again(self, case: LookCase) -> Evaluation:
        """Return the target's own trials, judged by other tolerances."""
        selection = select(
            self.alone.tried.scores,
            Constraints(
                tolerance_um=case.tolerance_um,
                tolerance_theta_rad=case.tolerance_theta_rad,
                target=case.target,
                visible=self.alone.visible,
                in_set=True,
            ),
        )
        return replace(self.alone.tried, case=case, selection=selection)

    def _raced_target(self, known: Feature | None, tried: Evaluation) -> TestedFeature:
        """Return the target as a feature; where it is measured, not where proposed."""
        shape = self.job.shape
        feature = replace(
            known or drawn(shape), center_um=shape.center_um, angle_rad=shape.angle_rad
        )
        return TestedFeature(
            feature=feature, shape=shape, tried=tried, visible=self.alone.visible
        )


def _not_tried(shape: TargetShape, reason: str) -> p.FeatureRow:
    """Return the row of a feature that was not raced."""
    return p.FeatureRow(name=shape.name, kind=shape.kind, reason=reason)


def _avoided(known: Proposals) -> list[p.FeatureRow]:
    """Return the rows of what the task forbids."""
    return [
        p.FeatureRow(name=name, kind=kind, reason="avoided: the task says so")
        for name, kind in known.avoided
    ]
