"""The contest over a look's target: what it is held with, and what it showed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.selection.evaluate import compare_routines
from microplan.featuresel.trials.trial_cache import Looks
from microplan.featuresel.trials.trials import Map
from microplan.optics.render.fidelity import Fidelity
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.scenario import build_case
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.task.presets import Effort
from microplan.planner.task.task import Task
from microplan.planner.views.requests import Request
from microplan.planner.views.target_views import needed_shape
from microplan.planner.views.targets import TargetShape
from microplan.planner.views.views import ViewPlan


@dataclass(frozen=True, slots=True, kw_only=True)
class CompileContext:
    """What the whole compile shares: how much to spend, what spends it, what keeps."""

    effort: Effort
    max_image_error: float
    map: Map
    memo: Memo = EVERY_TIME


@dataclass(frozen=True, slots=True)
class Begun:
    """What is known of a look, whatever it has to meet; grows, and changes no result.

    Demands differ in the place's tolerance and in where that comes from.
    """

    looks: Looks = field(default_factory=Looks)  # what the last contest showed
    others: dict[str, Looks] = field(default_factory=dict)  # by case: other features'
    cases: list[tuple[Request, ViewPlan, LookCase, Fidelity]] = field(
        default_factory=list
    )

    def case(
        self, task: Task, request: Request, view: ViewPlan, limit: float, memo: Memo
    ) -> tuple[LookCase, Fidelity]:
        """Return what `microplan.planner.looks.scenario.build_case` does."""
        bare = replace(
            request,
            tolerance_um=None,
            asked_by="",
            admissible_um=None,
            break_even_um=None,
        )
        for asked, seen, case, fidelity in self.cases:
            if (asked, seen) == (bare, view):
                tolerance_um = request.tolerance_um or view.microscope.um_per_px
                return replace(case, tolerance_um=tolerance_um), fidelity
        case, fidelity = build_case(task, request, view, limit, memo)
        self.cases.append((bare, view, case, fidelity))
        return case, fidelity


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetResult:
    """What the contest over a look's target showed at one magnification."""

    view: ViewPlan
    tried: Evaluation
    visible: float | None  # share of the target's edges; None: not known


@dataclass(frozen=True, slots=True, kw_only=True)
class LookProblem:
    """One look to be compiled, with what is shared and known by then."""

    task: Task
    request: Request
    shape: TargetShape  # of the target
    effects: CompileContext
    begun: Begun

    @classmethod
    def of(
        cls, task: Task, request: Request, effects: CompileContext, begun: Begun
    ) -> LookProblem:
        """Return the job of a request."""
        return cls(
            task=task,
            request=request,
            shape=needed_shape(task, request),
            effects=effects,
            begun=begun,
        )

    @property
    def is_round(self) -> bool:
        """Return whether an angle is needed that the target itself does not have."""
        return self.request.needs_angle_rad is not None and self.shape.symmetry == 0

    def asked(self, tolerance_um: float, asked_by: str) -> LookProblem:
        """Return the same look at another tolerance, as the only one there is."""
        request = replace(
            self.request,
            tolerance_um=tolerance_um,
            admissible_um=None,
            break_even_um=None,
            asked_by=asked_by,
        )
        return replace(self, request=request)

    def contest(self, view: ViewPlan, *, to_the_end: bool = False) -> TargetResult:
        """Return the choice among all chains for the target, with the trials.

        `to_the_end` is for who wants more of the chains than which one is chosen.
        """
        effects, effort = self.effects, self.effects.effort
        case, fidelity = self.begun.case(
            self.task, self.request, view, effects.max_image_error, effects.memo
        )
        found = effects.memo.call(
            compare_routines,
            case,
            root_seed=self.task.seed,
            most=effort.trials,
            thorough=effort.thorough,
            to_the_end=to_the_end,
            limited=effort.limited,
            map=effects.map,
            looks=self.begun.looks,
        )
        tried = Evaluation.of(case, fidelity, found)
        return TargetResult(view=view, tried=tried, visible=found.visible)
