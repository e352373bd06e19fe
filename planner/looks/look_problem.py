"""The measurement problem of one look: its target, its request, its settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.selection.evaluate import (
    RejectedChains,
    RoutineComparison,
    compare_routines,
)
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.trial_cache import Looks
from microplan.featuresel.trials.trials import Map
from microplan.optics.render.fidelity import Fidelity
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.progress.work import (
    Stage,
    Told,
    nobody,
    telling,
    trials_of,
)
from microplan.planner.looks.scenario import build_case
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.task.presets import Effort
from microplan.planner.task.task import Task
from microplan.planner.task.workcell import Interval
from microplan.planner.views.focus import look_stops
from microplan.planner.views.requests import Request
from microplan.planner.views.target_views import needed_shape
from microplan.planner.views.targets import TargetShape
from microplan.planner.views.views import ViewPlan


@dataclass(frozen=True, slots=True, kw_only=True)
class CompileContext:
    """Settings that the whole compile shares: effort, processes, cache."""

    effort: Effort
    max_image_error: float
    map: Map
    memo: Memo = EVERY_TIME
    told: Told = nobody  # hears of the stages of the present look

    def spread(self, stage: Stage, images: Callable[[Any], float] = trials_of) -> Map:
        """Return `map` for a stage, which tells what is made of each item."""
        return telling(self.map, self.told, stage, images)


@dataclass(frozen=True, slots=True)
class Begun:
    """Results known of a look at any tolerance; it grows, and changes no result."""

    looks: Looks = field(default_factory=Looks)  # of the last comparison
    others: dict[str, Looks] = field(default_factory=dict)  # by case: other features'
    cases: list[tuple[Request, ViewPlan, LookCase, Fidelity]] = field(
        default_factory=list
    )

    def case(
        self, task: Task, request: Request, view: ViewPlan, limit: float, memo: Memo
    ) -> tuple[LookCase, Fidelity]:
        """Return the case and its fidelity, as `scenario.build_case` does."""
        bare = replace(
            request,
            tolerance_um=None,
            asked_by="",
            admissible_um=None,
            break_even_um=None,
            used_within_um=None,
        )
        for asked, seen, case, fidelity in self.cases:
            if (asked, seen) == (bare, view):
                tolerance_um = request.tolerance_um or view.microscope.um_per_px
                return replace(case, tolerance_um=tolerance_um), fidelity
        case, fidelity = build_case(task, request, view, limit, memo)
        self.cases.append((bare, view, case, fidelity))
        return case, fidelity


@dataclass(frozen=True, slots=True, kw_only=True)
class LookProblem:
    """One look to be compiled, with the results known by then."""

    task: Task
    request: Request
    context: CompileContext
    begun: Begun

    @property
    def shape(self) -> TargetShape:
        """Return the shape of the target."""
        return needed_shape(self.task, self.request)

    @property
    def is_round(self) -> bool:
        """Return whether an angle is needed that the target itself does not have."""
        return self.request.needs_angle_rad is not None and self.shape.symmetry == 0

    def stops_um(
        self, case: LookCase, usable_um: Sequence[Interval]
    ) -> tuple[float, ...]:
        """Return further focus stops from a look's own, by its features' ranges."""
        owner, focus_um = self.shape.owner, case.focus_um
        stops_um = look_stops(self.task, self.request.state, owner, focus_um, usable_um)
        return tuple(stop_um - focus_um for stop_um in stops_um)

    def asked(self, tolerance_um: float, asked_by: str) -> LookProblem:
        """Return the same look at another tolerance, as its only limit."""
        request = replace(
            self.request,
            tolerance_um=tolerance_um,
            admissible_um=None,
            break_even_um=None,
            asked_by=asked_by,
        )
        return replace(self, request=request)

    def evaluate(self, view: ViewPlan, *, to_the_end: bool = False) -> Evaluation:
        """Return the comparison of all routines for the target, with the choice.

        With `to_the_end` every chain that is not eliminated has all its trials.
        """
        context = self.context
        case, fidelity = self.begun.case(
            self.task, self.request, view, context.max_image_error, context.memo
        )
        found = self._compared(case, to_the_end=to_the_end)
        return Evaluation(case=case, fidelity=fidelity, comparison=found)

    def without(self, tried: Evaluation, rejected: Mapping[Chain, str]) -> Evaluation:
        """Return an evaluation whose chains were compared again without some of them.

        `rejected` says of each why.
        """
        out = RejectedChains(before=tried.comparison, reasons=rejected)
        return replace(tried, comparison=self._compared(tried.case, rejected=out))

    def _compared(
        self,
        case: LookCase,
        *,
        to_the_end: bool = False,
        rejected: RejectedChains | None = None,
    ) -> RoutineComparison:
        """Return the comparison of all routines for a case."""
        context, effort = self.context, self.context.effort
        return context.memo.call(
            compare_routines,
            case,
            root_seed=self.task.seed,
            most=effort.trials,
            thorough=effort.thorough,
            to_the_end=to_the_end,
            limited=effort.limited,
            map=context.spread("race"),
            looks=self.begun.looks,
            rejected=rejected,
        )
