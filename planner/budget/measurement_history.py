"""Measurement history: results of earlier steps for later ones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from microplan.planner.assembly.assembly import owner_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.looks.look_record import CompiledLook
from microplan.planner.views.view_times import MicroscopeSetting
from microplan.schemas.plan.verdicts import MethodChoice, MethodName


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasurementHistory:
    """Measurements and settings of earlier steps, as later steps use them."""

    magnification: float  # the microscope is at
    seen: Mapping[str, PastMeasurement]  # owner -> its last look
    looks: Mapping[str, CompiledLook] = field(default_factory=dict)  # the looks
    within_um: float  # of the last alignment
    key: str  # journal key of the step before
    choice: MethodChoice | None = None  # of the last alignment
    # of the microscope; None: nothing was looked at
    setting: MicroscopeSetting | None = None
    before: PastMeasurement | None = None  # the look that its first approach went by
    # owner -> the last look that measured its angle
    angles: Mapping[str, PastMeasurement] = field(default_factory=dict)


def remember(
    history: MeasurementHistory, step: str, look: CompiledLook, moved_um: float = 0.0
) -> MeasurementHistory:
    """Return the history after a look of a step.

    `moved_um` is the error of the target's position by moves since its frame, one
    sigma.
    """
    view, measure = look.look.view, look.look.measure
    known = look.look.repeatability
    seen = PastMeasurement(
        name=look.look.target,
        step=step,
        sigma_um=math.hypot(look.look.sigma_xy_um, moved_um),
        sigma_without_scale_um=math.hypot(look.sigma_without_scale_um, moved_um),
        sigma_theta_rad=look.look.sigma_theta_rad,
        magnification=view.magnification,
        focus_um=view.focus_um,
        distortion_sigma_um=look.distortion_sigma_um,
        coherence_um=look.coherence_um,
        coherence_rad=look.coherence_rad,
        response_um=look.response.um,
        response_rad=look.response.rad,
        place_um=(measure.reference.pose.x_um, measure.reference.pose.y_um),
        moved_um=moved_um,
        trueness_um=0.0 if known is None else known.true_um,
        repeatability=known,
        model_cost=look.model_cost,
        own_cost=look.look.model_cost,
    )
    owner = owner_of(look.look.target)
    angle = {} if seen.sigma_theta_rad is None else {owner: seen}
    return replace(
        history,
        magnification=view.magnification,
        setting=MicroscopeSetting(look=look.look.id, view=view),
        seen={**history.seen, owner: seen},
        looks={**history.looks, owner: look},
        angles={**history.angles, **angle},
    )


def method_taken(align: StepState, history: MeasurementHistory) -> MethodName:
    """Return the method of an alignment: the one chosen, else the task's."""
    if history.choice is not None:
        return history.choice.method
    return "look_then_move" if align.step.method == "look_then_move" else "servo"
