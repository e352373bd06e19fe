"""One look compiled: trials, choice, and what the plan says of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from featuresel.bias_prediction import predict_bias
from featuresel.case import LookCase
from featuresel.contest import Contest, compete
from featuresel.known import Looks
from featuresel.trials import Map
from featuresel.usable import usable_range
from optics.fidelity import Fidelity
from planner.caching.memo import EVERY_TIME, Memo
from planner.cases import build_case
from planner.checks.views import view_verdict
from planner.diagnostics import Report
from planner.effects import effect_rows
from planner.evidence import evidence_of
from planner.frames import frame, seen_scene
from planner.inputs.task import Task
from planner.lens import (
    middle_offset_um,
    middle_sigma_um,
)
from planner.measures import Measured, depth_record, look_key, measure_record
from planner.model.requests import Request
from planner.model.scenes import world_scene
from planner.model.sightings import (
    marks_view,
    needed_shape,
    spot_of,
    views,
    whole_view,
)
from planner.model.targets import Shape
from planner.model.views import ViewPlan
from planner.outputs.emit import Shot
from planner.outputs.scenes import look_scene
from planner.pictures import Picture, picture
from planner.presets import Effort
from planner.records import evidence, scene_record, together_record, view_record
from planner.sets import ChosenSet, Search, Sets, wanted
from planner.steady import steady_sigma_um
from planner.tried import Arrays, Tried, arrays_of
from schemas import plan as p
from schemas.scenes import LookScene
from schemas.views import ZoomTried

BORNE = "what the insertion bears at this magnification"
WORTH = "the best here: another zoom would cost the insertion more"
NEAR = 1.05  # of the best need, so that new draws of the same chain keep it


@dataclass(frozen=True, slots=True, kw_only=True)
class Effects:
    """What the whole compile shares: how much to spend, what spends it, what keeps."""

    effort: Effort
    max_image_error: float
    map: Map
    memo: Memo = EVERY_TIME


@dataclass(frozen=True, slots=True, kw_only=True)
class CompiledLook:
    """A look as the plan has it, with the files that belong to it."""

    look: p.Look
    case: LookCase
    picture: Picture
    arrays: Arrays
    distortion_sigma_um: float  # of the middle of the target, by the lens
    coherence_um: float  # how far partly coherent light moves it
    placed: LookScene
    found: tuple[Measured, ...] = ()  # the features measured, the target first
    steady_um: float = math.inf  # `Sighted.steady_um`
    shot: Shot | None = None  # what reports show of it


@dataclass(frozen=True, slots=True)
class Begun:
    """What is known of a look, whatever it has to meet; grows, and changes no result.

    Demands differ in the place's tolerance and in where that comes from.
    """

    looks: Looks = field(default_factory=Looks)  # what the last contest showed
    cases: list[tuple[Request, ViewPlan, LookCase, Fidelity]] = field(
        default_factory=list
    )

    def case(
        self, task: Task, request: Request, view: ViewPlan, limit: float, memo: Memo
    ) -> tuple[LookCase, Fidelity]:
        """Return what `planner.cases.build_case` does."""
        bare = replace(
            request, tolerance_um=None, asked_by="", borne_um=None, worth_um=None
        )
        for asked, seen, case, fidelity in self.cases:
            if (asked, seen) == (bare, view):
                tolerance_um = request.tolerance_um or view.microscope.um_per_px
                return replace(case, tolerance_um=tolerance_um), fidelity
        case, fidelity = build_case(task, request, view, limit, memo)
        self.cases.append((bare, view, case, fidelity))
        return case, fidelity


def compile_look(
    task: Task,
    request: Request,
    effects: Effects,
    current: float,
    report: Report,
    *,
    once: bool = False,
    known: Begun | None = None,
) -> CompiledLook | None:
    """Return the look, None if there is a reason why it cannot be done.

    Magnifications are tried in order of preference until a chain of routines meets the
    tolerance on the target; if none does, until several features of its part do
    together. `current` is the magnification that the microscope is at. Before leaving
    the one preferred, what the insertion after the look bears is tried there: another
    zoom would cost it a parcentric jump. With `once` only the first magnification and
    the target are tried. `known` is what a contest over the look has shown already.
    """
    settings = views(task, request, current, report)
    if not settings:
        return None
    settings = settings[:1] if once else settings
    refused: list[ZoomTried] = []
    shape, known = needed_shape(task, request), known or Begun()
    job = _Job(task, request, shape, effects, refused, known)
    for view in settings:
        tried, found = job.alone(view)
        if tried.selection.chosen is not None:
            return job.finish(view, tried, found)
        refused.append(_refused(view, tried.selection.advice))
        if view is settings[0] and (look := job.kept(view)) is not None:
            return look
        if job.is_round:
            break  # no magnification gives it the angle that is needed
    advice = tried.selection.advice
    wider = [] if once else [(v, wide) for v in settings for wide in job.wider(v)]
    for view, whole in wider:
        tried, found = job.alone(whole)
        if tried.selection.chosen is not None:
            return job.finish(whole, tried, found)
        sets = job.search(whole, tried, found).run()
        if sets.chosen is not None:
            return job.finish_set(tried, sets)
        advice = sets.advice
        refused.append(_refused(view, advice))
    _report_failure(request, view, tried, advice, report)
    return None


def look_at_first(
    task: Task, request: Request, effects: Effects, view: ViewPlan, known: Begun
) -> None:
    """Hold the first contest over a look; `known` takes what it shows."""
    shape = needed_shape(task, request)
    _Job(task, request, shape, effects, (), known).alone(view)


@dataclass(frozen=True, slots=True)
class _Job:
    """One look to be compiled."""

    task: Task
    request: Request
    shape: Shape
    effects: Effects
    refused: Sequence[ZoomTried]  # before the one that does
    begun: Begun

    @property
    def is_round(self) -> bool:
        """Return whether an angle is needed that the target itself does not have."""
        return self.request.needs_angle_rad is not None and self.shape.symmetry == 0

    def wider(self, view: ViewPlan) -> list[ViewPlan]:
        """Return views that show more of the target's part, the smaller first."""
        found = [whole_view(self.task, self.request, view)]
        if self.is_round:  # the task's own marks tell the angle, if any do
            found.insert(0, marks_view(self.task, self.request, view))
        return [v for k, v in enumerate(found) if v not in (view, *found[:k])]

    def alone(self, view: ViewPlan) -> tuple[Tried, Contest]:
        """Return the choice among all chains for the target, with the trials."""
        effort, limit = self.effects.effort, self.effects.max_image_error
        memo = self.effects.memo
        case, fidelity = self.begun.case(self.task, self.request, view, limit, memo)
        found = memo.call(
            compete,
            case,
            root_seed=self.task.seed,
            most=effort.trials,
            thorough=effort.thorough,
            limited=effort.limited,
            map=self.effects.map,
            looks=self.begun.looks,
        )
        return Tried.of(case, fidelity, found), found

    def kept(self, view: ViewPlan) -> CompiledLook | None:
        """Return a look that fails its share, where another zoom would cost more.

        The insertion after it bears it, or would be less likely with a faultless look
        at another zoom.
        """
        asked_um, bears = self.request.tolerance_um, self.request
        if asked_um is None:
            return None
        if bears.borne_um is not None and bears.borne_um > asked_um:
            look = self._asked(bears.borne_um, BORNE).compiled(view)
            if look is not None:
                return look
        if bears.worth_um is None or bears.worth_um <= asked_um:
            return None
        _, found = self._asked(bears.worth_um, WORTH).alone(view)
        # not the cheapest that is worth it, but the best
        reliable = found.selection.pareto
        best_um = NEAR * min((s.need_um for s in reliable), default=math.inf)
        return self._asked(min(best_um, bears.worth_um), WORTH).compiled(view)

    def _asked(self, tolerance_um: float, asked_by: str) -> _Job:
        """Return the same look at another tolerance, as the only one there is."""
        request = replace(
            self.request,
            tolerance_um=tolerance_um,
            borne_um=None,
            worth_um=None,
            asked_by=asked_by,
        )
        return replace(self, request=request, refused=())

    def compiled(self, view: ViewPlan) -> CompiledLook | None:
        """Return the look at a magnification, None if no chain is good enough."""
        tried, found = self.alone(view)
        chosen = tried.selection.chosen
        return None if chosen is None else self.finish(view, tried, found)

    def search(self, view: ViewPlan, tried: Tried, found: Contest) -> Search:
        """Return the search for several features beside the target."""
        return Search(
            task=self.task,
            request=self.request,
            shape=self.shape,
            view=view,
            alone=tried,
            visible=found.visible,
            effort=self.effects.effort,
            map=self.effects.map,
            memo=self.effects.memo,
        )

    def finish(self, view: ViewPlan, tried: Tried, found: Contest) -> CompiledLook:
        """Return a look whose target alone does, or several features where those are
        wanted and do better, or have one to spare."""
        search = self.search(view, tried, found)
        if not wanted(found, tried.case, self.effects.effort):
            return self._look(tried, [self._measured(tried)], search.left_out(), None)
        sets = search.run()
        if sets.chosen is None:
            return self._look(tried, [self._measured(tried)], sets.rows, None)
        return self.finish_set(tried, sets)

    def finish_set(self, tried: Tried, sets: Sets) -> CompiledLook:
        """Return a look that measures the features of a set."""
        chosen = sets.chosen
        if chosen is None:
            raise ValueError("no set was chosen")
        found = [
            self._measured(raced.tried, raced.shape, sight.sigma_um)
            for raced, sight in zip(chosen.raced, chosen.sights, strict=True)
        ]
        return self._look(tried, found, sets.rows, chosen)

    def _measured(
        self, tried: Tried, shape: Shape | None = None, sigma_um: float | None = None
    ) -> Measured:
        """Return a feature with the range and the bias of its chain."""
        case, chosen = tried.case, tried.selection.chosen
        if chosen is None:
            raise ValueError("no chain was chosen")
        seed, effects = self.task.seed, self.effects
        usable = effects.memo.call(
            usable_range,
            case,
            tried.prepared,
            chosen.chain,
            root_seed=seed,
            draws=effects.effort.range_draws,
            map=effects.map,
        )
        only = replace(tried.prepared, chains=(chosen.chain,))
        curves = effects.memo.call(
            predict_bias, case, only, root_seed=seed, map=effects.map
        )
        return Measured(
            shape=shape or self.shape,
            tried=tried,
            chosen=chosen,
            usable=usable,
            curve=curves.get(chosen.chain),
            depth=depth_record(case, usable) if effects.effort.limited else None,
            sigma_um=sigma_um,
        )

    def _look(
        self,
        tried: Tried,
        found: Sequence[Measured],
        rows: Sequence[p.FeatureRow],
        together: ChosenSet | None,
    ) -> CompiledLook:
        """Return what the plan says of a look; `tried` is of its target."""
        task, request, shape, case = self.task, self.request, self.shape, tried.case
        first, *others = [measure_record(request, shape, each) for each in found]
        usable = {each.shape.name: each.usable.focus_um for each in found}
        view = view_record(task, request, case, list(usable.values()))
        image = reference_image(task, request, case, self.effects.memo)
        name = f"images/{request.id}.png"
        return CompiledLook(
            look=p.Look(
                id=request.id,
                target=shape.name,
                view=view,
                scene=scene_record(task, request, case, shape, name, image),
                effects=effect_rows(task, request, tried, self.effects.memo),
                measure=first,
                evidence=evidence(
                    found[0].tried, found[0].chosen, rows, case.tolerance_um
                ),
                others=tuple(others),
                together=None if together is None else together_record(together),
                verdict=view_verdict(task, request, view, usable, self.refused),
            ),
            case=case,
            picture=image,
            arrays={
                path: arrays
                for each in found
                for path, arrays in arrays_of(
                    look_key(request, shape, each.shape), each.tried
                ).items()
            },
            distortion_sigma_um=middle_sigma_um(
                task.workcell, case.microscope, spot_of(task, request, shape)
            ),
            coherence_um=middle_offset_um(task, request.state, shape, case.microscope),
            placed=look_scene(
                task, request.state, request.id, shape, spot_of(task, request, shape)
            ),
            found=tuple(found),
            steady_um=math.inf
            if together is not None
            else steady_sigma_um(found[0].tried, found[0].chosen, task.seed),
            shot=evidence_of(task, request, found, self.effects.memo),
        )


def reference_image(
    task: Task, request: Request, case: LookCase, memo: Memo = EVERY_TIME
) -> Picture:
    """Return the whole frame at the nominal state by the exact law, 8 bit.

    What the case's fidelity was chosen for is its region.
    """
    cell, scope = task.workcell, case.microscope
    seen = seen_scene(cell, world_scene(task, request.state), scope, case.focus_um)
    image = frame(
        cell, seen, scope, focus_um=case.focus_um, level=case.light.gain, memo=memo
    )
    return picture(image)


def _refused(view: ViewPlan, why: str) -> ZoomTried:
    """Return a magnification at which nothing found was good enough."""
    return ZoomTried(magnification=view.microscope.magnification, reason=why)


def _report_failure(
    request: Request,
    view: ViewPlan,
    tried: Tried,
    advice: str,
    report: Report,
) -> None:
    """Report that neither a chain nor a set of features is good enough."""
    reasons = "; ".join(
        f"{' > '.join(chain)}: {why}" for chain, why in tried.selection.reasons
    )
    report.refuse(
        "MP501",
        request.where,
        f"look {request.id!r}: no routine finds {request.target} well enough at "
        f"{view.microscope.magnification:.4g} x, 2 sigma + |bias| within "
        f"{tried.case.tolerance_um:.3g} um ({request.asked_by}): {reasons}",
        advice,
    )
