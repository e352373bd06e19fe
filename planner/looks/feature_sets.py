"""Choice of the set of features that one look measures together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from microplan.featuresel.look.design import design, random_design
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.selection.constraints import Constraints, Limits
from microplan.featuresel.selection.evaluate import has_margin
from microplan.featuresel.sets.feature_set import FeatureSet, choose_set
from microplan.featuresel.sets.pose_covariance import (
    FeatureMeasurement,
    PoseRequirement,
    measurement_of,
)
from microplan.featuresel.sets.set_trials import Member, repeated_set, score_set
from microplan.featuresel.trials.score import ChainScore
from microplan.featuresel.trials.trials import PreparedRoutines
from microplan.optics.outline.tolerant_order import at_most
from microplan.planner.looks.evaluation import (
    ChosenSet,
    Evaluation,
    FeatureRanking,
    TestedFeature,
)
from microplan.planner.looks.feature_evaluation import target_alone
from microplan.planner.looks.look_problem import LookProblem
from microplan.planner.looks.scenario import MOST_TOGETHER
from microplan.planner.task.presets import Effort
from microplan.planner.task.workcell import Interval
from microplan.planner.views.features import offset_um
from microplan.schemas import plan as p


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureSetResult:
    """Result of the search for a set of features."""

    chosen: ChosenSet | None
    rows: tuple[p.FeatureRow, ...]
    advice: str  # what to relax where nothing was chosen


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureSetSearch:
    """The search for a set of features of one look that are measured together."""

    problem: LookProblem
    tried: Evaluation  # of the target alone

    def among(
        self, tested: Sequence[TestedFeature], skipped: Sequence[p.FeatureRow]
    ) -> FeatureSetResult:
        """Return the set to use of features that were evaluated, or why there is none.

        `skipped` are the rows of those that were not.
        """
        sights = {r.shape.name: self._sight(r) for r in tested if r.passes}
        found = self._found(list(sights.values())) if sights else None
        chosen, advice = self._settled(tested, sights, found)
        reasons = self._reasons(tested, found, chosen, advice)
        rows = [
            self._ranking.row(r, sights.get(r.shape.name), reasons[r.shape.name])
            for r in tested
        ]
        if chosen is not None:
            sigma_um = chosen.found.known.sigma_um
            rows.append(self._ranking.set_row(chosen.tested, chosen.sights, sigma_um))
        return FeatureSetResult(chosen=chosen, rows=(*rows, *skipped), advice=advice)

    def left_out(self) -> tuple[p.FeatureRow, ...]:
        """Return the rows of a look whose target alone does."""
        target, others = target_alone(self.problem, self.tried)
        used = "used: it alone does"
        return (self._ranking.row(target, self._sight(target), used), *others)

    def _reasons(
        self,
        tested: Sequence[TestedFeature],
        found: FeatureSet | None,
        chosen: ChosenSet | None,
        advice: str,
    ) -> Mapping[str, str]:
        """Return why each feature is used or not, by name."""
        reasons = {
            each.shape.name: f"passes as one of several; no set is used: {advice}"
            for each in tested
        }
        if chosen is not None and found is not None:
            reasons |= dict(found.reasons)
        elif chosen is None and self._chosen_alone is not None:
            name = self.problem.shape.name
            reasons[name] = f"used: it alone passes; no set does: {advice}"
        return reasons | {
            each.shape.name: f"rejected: {each.tried.comparison.selection.advice}"
            for each in tested
            if not each.passes
        }

    def _settled(
        self,
        tested: Sequence[TestedFeature],
        sights: Mapping[str, FeatureMeasurement],
        found: FeatureSet | None,
    ) -> tuple[ChosenSet | None, str]:
        """Return the set after its own trials, or what to relax."""
        if found is None:
            faults = (
                f"{r.shape.name}: {r.tried.comparison.selection.advice}" for r in tested
            )
            return None, "; ".join(faults)
        if not found.qualifies:
            return None, "; ".join(found.relaxations)
        target = self.problem.shape.name
        if self._chosen_alone is not None and found.names == (target,):
            return None, f"{target} alone does"
        members = [r for r in tested if r.shape.name in found.names]
        chosen = self._tested(members, [sights[r.shape.name] for r in members], found)
        fault = self._missed(chosen)
        rival = None if self._effort.thorough else self._chosen_alone
        if not fault and rival is not None and at_most(rival.need_um, chosen.need_um):
            fault = f"{target} alone does better"
        if fault:
            return None, f"{' + '.join(found.names)}: {fault}"
        return chosen, ""

    def repeated(self, chosen: ChosenSet, usable_um: Sequence[Interval]) -> ChosenSet:
        """Return a set with its score on fresh random trials.

        `usable_um` has each feature's focus range: the stops of the look are by these.
        """
        context, fresh = self.problem.context, self._named(chosen.tested)
        found = context.memo.call(
            repeated_set,
            fresh,
            self._members(chosen.tested, chosen.sights),
            random_design(fresh, context.effort.random_trials, self.problem.task.seed),
            least=chosen.least,
            stops_um=self.problem.stops_um(fresh, usable_um),
            map=context.map,
        )
        (score,), (true,) = found.scores, found.trueness
        return replace(chosen, repeated=score, trueness=true)

    def _missed(self, chosen: ChosenSet) -> str:
        """Return which limit a set misses, as the part may be made."""
        case = self.tried.case
        task = Constraints(
            tolerance_um=case.tolerance_um,
            tolerance_theta_rad=case.tolerance_theta_rad,
        )
        fault = task.fault(chosen.score)
        if fault or at_most(chosen.need_um, case.tolerance_um):
            return fault
        return (
            f"with the part's profile tolerance 2 sigma + |bias| is "
            f"{chosen.need_um:.3g} um, tolerance {case.tolerance_um:.3g} um"
        )

    @property
    def _effort(self) -> Effort:
        return self.problem.context.effort

    @property
    def _chosen_alone(self) -> ChainScore | None:
        """Return the chain that the target alone would be measured with."""
        return self.tried.comparison.selection.chosen

    def _found(self, sights: Sequence[FeatureMeasurement]) -> FeatureSet:
        """Return the smallest set that does, with a feature to spare where wanted."""
        need = self._need
        if self._effort.thorough:
            spare = choose_set(sights, replace(need, redundant=True))
            if spare.qualifies:
                return spare
        return choose_set(sights, need)

    @property
    def _need(self) -> PoseRequirement:
        """Return the required accuracy of a set: two sigma within each tolerance.

        Where the target alone does, a set has to keep the margin that it does not.
        """
        case = self.tried.case
        is_whole = self._effort.thorough or self._chosen_alone is None
        share = 1.0 if is_whole else Limits().margin_share
        turn = case.tolerance_theta_rad
        return PoseRequirement(
            sigma_um=share * case.tolerance_um / 2,
            sigma_theta_rad=None if turn is None else share * turn / 2,
            radius_um=self._ranking.radius_um,
            most=MOST_TOGETHER,
            redundant=False,
        )

    @property
    def _ranking(self) -> FeatureRanking:
        """Return the ranking of features: a rotation counts as its corners' path."""
        x0, y0, x1, y1 = self.problem.shape.box_um
        radius_um = math.hypot(x1 - x0, y1 - y0) / 2
        return FeatureRanking(case=self.tried.case, radius_um=radius_um)

    def _sight(self, tested: TestedFeature) -> FeatureMeasurement:
        """Return the measurement of a feature, as the search for a set uses it.

        The target is where the look is to find it; on a part as fabricated its edges
        and those of others lie off the drawing, each by the profile tolerance.
        """
        shape = self.problem.shape
        return measurement_of(
            tested.feature,
            tested.chosen,
            about_um=shape.center_um,
            theta_rad=self.tried.case.theta_rad,
            made_um=0.0 if tested.shape.name == shape.name else self._made_um,
        )

    @property
    def _made_um(self) -> float:
        """Return sigma of the edges of a fabricated part, um, uniform within."""
        part = self.problem.task.parts.get(self.problem.shape.owner)
        return 0.0 if part is None else part.profile_tolerance_um / math.sqrt(3)

    def _shared_um(self, tested: Sequence[TestedFeature], found: FeatureSet) -> float:
        """Return what the target's fabrication adds to a set, um: others do not see it.

        In so far as the target itself is measured its weight takes that off.
        """
        weight = 0.0
        for each in tested:
            if each.shape.name == self.problem.shape.name:
                own = self._sight(each).sigma_um
                weight = min(1.0, (found.known.sigma_um / own) ** 2) if own else 1.0
        return (1 - weight) * self._made_um

    def _tested(
        self,
        tested: Sequence[TestedFeature],
        sights: Sequence[FeatureMeasurement],
        found: FeatureSet,
    ) -> ChosenSet:
        """Return the set with the score of fresh trials."""
        context, fresh = self.problem.context, self._named(tested)
        least = len(tested) - 1 if self._has_spare(found) else len(tested)
        score = context.memo.call(
            score_set,
            fresh,
            self._members(tested, sights),
            design(fresh, context.effort.trials, self.problem.task.seed),
            least=least,
            map=context.map,
        )
        return ChosenSet(
            tested=tuple(tested), sights=tuple(sights), score=score, found=found,
            least=least, shared_um=self._shared_um(tested, found),
        )  # fmt: skip

    def _named(self, tested: Sequence[TestedFeature]) -> LookCase:
        """Return the look with trials of its own for a set of features."""
        names = "+".join(each.shape.name for each in tested)
        return replace(self.tried.case, key=f"{self.tried.case.key}/{names}")

    def _members(
        self, tested: Sequence[TestedFeature], sights: Sequence[FeatureMeasurement]
    ) -> list[Member]:
        """Return features as trials of the set measure them."""
        return [self._member(r, s) for r, s in zip(tested, sights, strict=True)]

    def _has_spare(self, found: FeatureSet) -> bool:
        """Return whether a set still does without any one of its features."""
        need = self._need
        return found.dropped_um <= need.sigma_um and (
            need.sigma_theta_rad is None
            or found.dropped_theta_rad <= need.sigma_theta_rad
        )

    def _member(self, tested: TestedFeature, sight: FeatureMeasurement) -> Member:
        """Return a feature as trials of the set measure it."""
        chain = tested.chosen.chain
        artifacts = tested.tried.comparison.prepared.artifacts
        return Member(
            case=tested.tried.case,
            prepared=PreparedRoutines(
                chains=(chain,), artifacts={name: artifacts[name] for name in chain}
            ),
            score=tested.chosen,
            offset_um=offset_um(tested.shape, self.problem.shape),
            sigma_um=sight.sigma_um,
        )


def wanted(tried: Evaluation, effort: Effort) -> bool:
    """Return whether more features are evaluated though the target alone does."""
    if effort.thorough:
        return True
    return effort.limited and not has_margin(tried.case, tried.comparison.selection)
