"""Several features of one look: which are raced, which set is used, and why."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from featuresel.case import LookCase
from featuresel.constraints import Constraints, Limits
from featuresel.contest import Contest, compete, is_roomy
from featuresel.feature import Feature
from featuresel.feature_set import FeatureSet, choose_set
from featuresel.perturb import design
from featuresel.pose_need import Need
from featuresel.score import Score
from featuresel.select import select
from featuresel.set_trials import Member, score_set
from featuresel.sights import Sight, sight_of
from featuresel.trials import Map, Prepared
from optics.ties import at_most
from planner.caching.memo import Memo
from planner.cases import MOST_TOGETHER, SHARE_TOGETHER, feature_case
from planner.inputs.task import Task
from planner.model.features import Proposals, drawn, offset_um, proposals
from planner.model.requests import Request
from planner.model.targets import Shape
from planner.model.views import ViewPlan
from planner.presets import Effort
from planner.raced import Judged, Raced, unseen
from planner.tried import Tried
from schemas import plan as p


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenSet:
    """The features that a look measures, the look's own target first if among them."""

    raced: tuple[Raced, ...]
    sights: tuple[Sight, ...]
    score: Score  # of fresh trials of all of them
    found: FeatureSet
    least: int  # that must answer
    shared_um: float  # one sigma of the target's place on the part, as made

    @property
    def sigma_um(self) -> float:
        """Return the spread of the target's place; the worse of trials and model."""
        seen = max(self.score.sigma_um or 0.0, self.found.known.sigma_um)
        return math.hypot(seen, self.shared_um)

    @property
    def need_um(self) -> float:
        """Return 2 sigma + |bias|, what a tolerance must hold."""
        return 2 * self.sigma_um + math.hypot(*(self.score.bias_um or (0.0, 0.0)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Sets:
    """What the search for a set came to."""

    chosen: ChosenSet | None
    rows: tuple[p.FeatureRow, ...]
    advice: str  # what to relax where nothing was chosen


@dataclass(frozen=True, slots=True, kw_only=True)
class _Stakes:
    """What all features of a look are raced with."""

    seed: int
    effort: Effort


def _contest(stakes: _Stakes, case: LookCase) -> Contest:
    """Return the race over one of several features."""
    effort = stakes.effort
    return compete(
        case,
        root_seed=stakes.seed,
        most=effort.trials,
        thorough=effort.thorough,
        limited=effort.limited,
        in_set=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """A look whose features are raced where its target alone does not do.

    `alone` is the target's own contest.
    """

    task: Task
    request: Request
    shape: Shape
    view: ViewPlan
    alone: Tried
    visible: float | None
    effort: Effort
    map: Map
    memo: Memo

    def run(self) -> Sets:
        """Return the set to use, or why there is none."""
        raced, skipped = self._race()
        sights = {r.shape.name: self._sight(r) for r in raced if r.passes}
        found = self._found(list(sights.values())) if sights else None
        chosen, advice = self._settled(raced, sights, found)
        said = {} if found is None or chosen is None else dict(found.reasons)
        if chosen is None and self.alone.selection.chosen is not None:
            said = {self.shape.name: f"used: it alone passes; no set does: {advice}"}
        unused = f"passes as one of several; no set is used: {advice}"
        rows = [
            self._judged.row(
                r, sight, _fault(r) if sight is None else said.get(name, unused)
            )
            for r in raced
            for name, sight in [(r.shape.name, sights.get(r.shape.name))]
        ]
        if chosen is not None:
            sigma_um = chosen.found.known.sigma_um
            rows.append(self._judged.set_row(chosen.raced, chosen.sights, sigma_um))
        return Sets(chosen=chosen, rows=(*rows, *skipped), advice=advice)

    def _settled(
        self,
        raced: Sequence[Raced],
        sights: Mapping[str, Sight],
        found: FeatureSet | None,
    ) -> tuple[ChosenSet | None, str]:
        """Return the set after its own trials, or what to relax."""
        if found is None:
            faults = (f"{r.shape.name}: {r.tried.selection.advice}" for r in raced)
            return None, "; ".join(faults)
        if not found.qualifies:
            return None, "; ".join(found.relaxations)
        alone = self.alone.selection.chosen
        if alone is not None and found.names == (self.shape.name,):
            return None, f"{self.shape.name} alone does"
        members = [r for r in raced if r.shape.name in found.names]
        chosen = self._tested(members, [sights[r.shape.name] for r in members], found)
        fault = self._fault(chosen)
        rival = None if self.effort.thorough else alone
        if not fault and rival is not None and at_most(rival.need_um, chosen.need_um):
            fault = f"{self.shape.name} alone does better"
        if fault:
            return None, f"{' + '.join(found.names)}: {fault}"
        return chosen, ""

    def _fault(self, chosen: ChosenSet) -> str:
        """Return what a set misses in its own trials, as the part may be made."""
        case = self.alone.case
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

    def left_out(self) -> tuple[p.FeatureRow, ...]:
        """Return the rows of a look whose target alone does."""
        known = proposals(self.task, self.request, self.shape)
        target = self._raced_target(known.target, self.alone)
        reason = f"not tried: {self.shape.name} alone does"
        return (
            self._judged.row(target, self._sight(target), "used: it alone does"),
            *(
                p.FeatureRow(name=shape.name, kind=shape.kind, reason=reason)
                for _, shape in known.others
            ),
            *_avoided(known),
        )

    def _race(self) -> tuple[list[Raced], list[p.FeatureRow]]:
        """Return the features that were raced, and a row for each that was not."""
        known = proposals(self.task, self.request, self.shape)
        skipped, others = _avoided(known), list[tuple[Feature, Shape, LookCase]]()
        for feature, shape in known.others:
            case = feature_case(
                self.task, self.request, self.view, self.alone.case, shape
            )
            why = unseen(case)
            if not why and len(others) == self.effort.features:
                why = f"not tried: {self.effort.features} others were"
            if why:
                row = p.FeatureRow(name=shape.name, kind=shape.kind, reason=why)
                skipped.append(row)
            else:
                others.append((feature, shape, case))
        return [self._target(known.target), *self._others(others)], skipped

    def _others(
        self, features: Sequence[tuple[Feature, Shape, LookCase]]
    ) -> list[Raced]:
        """Return other features after their races, which are held side by side."""
        stakes = _Stakes(seed=self.task.seed, effort=self.effort)
        found = self.memo.each(
            _contest, stakes, [case for *_, case in features], self.map
        )
        return [
            self._after(feature, shape, case, contest)
            for (feature, shape, case), contest in zip(features, found, strict=True)
        ]

    def _target(self, known: Feature | None) -> Raced:
        """Return the target itself, its chains judged as those of one of several."""
        own = self.alone.case
        turn = own.tolerance_theta_rad
        if turn is not None and self.shape.symmetry == 0:
            # alone it had few trials, as hopeless: it tells no angle
            case = feature_case(self.task, self.request, self.view, own, self.shape)
            (found,) = self._others([(known or drawn(self.shape), self.shape, case)])
            return found
        case = replace(
            own,
            tolerance_um=own.tolerance_um * SHARE_TOGETHER,
            tolerance_theta_rad=None if turn is None else turn * SHARE_TOGETHER,
        )
        selection = select(
            self.alone.scores,
            tolerance_um=case.tolerance_um,
            tolerance_theta_rad=case.tolerance_theta_rad,
            target=case.target,
            visible=self.visible,
            in_set=True,
        )
        tried = replace(self.alone, case=case, selection=selection)
        return self._raced_target(known, tried)

    def _raced_target(self, known: Feature | None, tried: Tried) -> Raced:
        """Return the target as a feature; where it is measured, not where proposed."""
        feature = replace(
            known or drawn(self.shape),
            center_um=self.shape.center_um,
            angle_rad=self.shape.angle_rad,
        )
        return Raced(
            feature=feature, shape=self.shape, tried=tried, visible=self.visible
        )

    def _after(
        self, feature: Feature, shape: Shape, case: LookCase, found: Contest
    ) -> Raced:
        """Return another feature after its race."""
        tried = Tried.of(case, self.alone.fidelity, found)
        return Raced(feature=feature, shape=shape, tried=tried, visible=found.visible)

    def _found(self, sights: Sequence[Sight]) -> FeatureSet:
        """Return the smallest set that does, with a feature to spare where wanted."""
        need = self._need
        if self.effort.thorough:
            spare = choose_set(sights, replace(need, redundant=True))
            if spare.qualifies:
                return spare
        return choose_set(sights, need)

    @property
    def _need(self) -> Need:
        """Return what a set has to tell: two sigma within each tolerance.

        Where the target alone does, a set has to leave the room that it does not.
        """
        case = self.alone.case
        share = 1.0 if self.alone.selection.chosen is None else Limits().roomy
        if self.effort.thorough:
            share = 1.0
        turn = case.tolerance_theta_rad
        return Need(
            sigma_um=share * case.tolerance_um / 2,
            sigma_theta_rad=None if turn is None else share * turn / 2,
            radius_um=self._judged.radius_um,
            most=MOST_TOGETHER,
            redundant=False,
        )

    @property
    def _judged(self) -> Judged:
        """Return how features are compared: a turn counts as its corners' way."""
        x0, y0, x1, y1 = self.shape.box_um
        radius_um = math.hypot(x1 - x0, y1 - y0) / 2
        return Judged(case=self.alone.case, radius_um=radius_um)

    def _sight(self, raced: Raced) -> Sight:
        """Return a feature as the search for a set has it.

        The target is where the look is to find it; on a part as made its edges and
        those of others lie off the drawing, each by the profile tolerance.
        """
        own = raced.shape.name == self.shape.name
        return sight_of(
            raced.feature,
            raced.chosen,
            about_um=self.shape.center_um,
            theta_rad=self.alone.case.theta_rad,
            made_um=0.0 if own else self._made_um,
        )

    @property
    def _made_um(self) -> float:
        """Return one sigma of where a part as made has an edge, uniform within."""
        part = self.task.parts.get(self.shape.owner)
        return 0.0 if part is None else part.profile_tolerance_um / math.sqrt(3)

    def _shared_um(self, raced: Sequence[Raced], found: FeatureSet) -> float:
        """Return what the target's own making adds to a set: others do not see it.

        In so far as the target itself is measured its weight takes that off.
        """
        weight = 0.0
        for each in raced:
            if each.shape.name == self.shape.name:
                own = self._sight(each).sigma_um
                weight = min(1.0, (found.known.sigma_um / own) ** 2) if own else 1.0
        return (1 - weight) * self._made_um

    def _tested(
        self, raced: Sequence[Raced], sights: Sequence[Sight], found: FeatureSet
    ) -> ChosenSet:
        """Return the set with the score of fresh trials."""
        case = self.alone.case
        names = "+".join(r.shape.name for r in raced)
        fresh = replace(case, key=f"{case.key}/{names}")
        need = self._need
        spare = found.dropped_um <= need.sigma_um and (
            need.sigma_theta_rad is None
            or found.dropped_theta_rad <= need.sigma_theta_rad
        )
        least = len(raced) - 1 if spare else len(raced)
        score = self.memo.call(
            score_set,
            fresh,
            [self._member(r, s) for r, s in zip(raced, sights, strict=True)],
            design(fresh, self.effort.trials, self.task.seed),
            least=least,
            map=self.map,
        )
        return ChosenSet(
            raced=tuple(raced), sights=tuple(sights), score=score, found=found,
            least=least, shared_um=self._shared_um(raced, found),
        )  # fmt: skip

    def _member(self, raced: Raced, sight: Sight) -> Member:
        """Return a feature as trials of the set measure it."""
        chain = raced.chosen.chain
        artifacts = raced.tried.prepared.artifacts
        return Member(
            case=raced.tried.case,
            prepared=Prepared(
                chains=(chain,), artifacts={name: artifacts[name] for name in chain}
            ),
            score=raced.chosen,
            offset_um=offset_um(raced.shape, self.shape),
            sigma_um=sight.sigma_um,
        )


def wanted(found: Contest, case: LookCase, effort: Effort) -> bool:
    """Return whether more features are raced though the target alone does."""
    return effort.thorough or (effort.limited and not is_roomy(case, found.selection))


def _avoided(known: Proposals) -> list[p.FeatureRow]:
    """Return the rows of what the task forbids."""
    return [
        p.FeatureRow(name=name, kind=kind, reason="avoided: the task says so")
        for name, kind in known.avoided
    ]


def _fault(raced: Raced) -> str:
    """Return why no chain of a feature passes."""
    return f"rejected: {raced.tried.selection.advice}"
