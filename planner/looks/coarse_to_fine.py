"""Coarse-to-fine measurement: a look of its own, or a coarse and a fine one."""

from __future__ import annotations

import math
from dataclasses import replace

from microplan.planner.looks.compile_look import compile_look
from microplan.planner.looks.look_problem import Begun, CompileContext
from microplan.planner.looks.look_record import CompiledLook
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from microplan.planner.views.coarse import (
    MAY_HELP,
    CoarseLook,
    assumed,
    centring,
    coarse_requests,
    fine_request,
    may_gain,
    report_coarse,
)
from microplan.planner.views.requests import Request
from microplan.planner.views.target_views import needed_shape, target_pose, views
from microplan.planner.views.view_times import centre_times
from microplan.schemas.plan.views import TimeRow


def compile_looks(
    task: Task,
    request: Request,
    context: CompileContext,
    current: float,
    report: Report,
    *,
    known: Begun | None = None,
) -> tuple[CompiledLook, ...]:
    """Return the looks of a request: one, or a coarse one followed by a fine one.

    Empty if there is a reason why it cannot be done, which is reported. `current` is
    the magnification that the microscope is at, `known` has results of a
    single look already.
    """
    plain = Report()
    look = compile_look(task, request, context, current, plain, known=known)
    if look is None:
        codes = {d.code for d in plain.found if d.severity == "infeasible"}
        may_help = codes & set(MAY_HELP)  # by a better known position
        if may_help and (pair := _pair(task, request, context, plain, report)):
            return pair
    report.found += plain.found
    return () if look is None else (look,)


def waits_between(task: Task, request: Request) -> tuple[TimeRow, ...]:
    """Return the times that a target takes to centre before its fine look."""
    spot = target_pose(task, request, needed_shape(task, request))
    return centre_times(task, spot.carrier, spot.sigma_xy_um)


def _pair(
    task: Task, request: Request, context: CompileContext, plain: Report, report: Report
) -> tuple[CompiledLook, ...]:
    """Return a coarse look and the fine one that it makes possible, () if none does."""
    low, _ = task.workcell.optics.magnification
    tried = any(d.code == "MP501" for d in plain.found)
    for coarse in coarse_requests(task, request):
        supposed = fine_request(task, request, coarse, assumed(task, coarse))
        if supposed is None or not views(task, supposed, low, Report()):
            continue
        if tried and not may_gain(task, request, supposed):
            continue
        found = Report()
        first = compile_look(task, coarse, context, low, found, once=True)
        if first is None:
            continue
        fine = fine_request(task, request, coarse, _seen(first))
        if fine is None:
            continue
        zoom = first.look.view.magnification
        second = compile_look(task, fine, context, zoom, found)
        if second is None:
            continue
        report.found += found.found
        how = f"at {zoom:.4g} x to {first.look.sigma_xy_um:.2g} um"
        report_coarse(request, coarse, plain, how, report)
        way = centring(task, request, first.look.id)
        return first, replace(second, look=replace(second.look, coarse=way))
    return ()


def _seen(look: CompiledLook) -> CoarseLook:
    """Return the accuracy of a coarse look: at an unknown angle its bias stays."""
    bias_um = math.hypot(*look.look.measure.bias_um)
    if look.model_cost is not None:
        bias_um += math.hypot(*look.model_cost.half_width_um)
    return CoarseLook(
        sigma_um=math.hypot(
            look.look.sigma_xy_um,
            bias_um,
            look.distortion_sigma_um,
            look.coherence_um,
            look.response.um,
        ),
        sigma_theta_rad=look.look.sigma_theta_rad,
        magnification=look.look.view.magnification,
        focus_um=look.look.view.focus_um,
    )
