"""Effects ledger of a look: how each is imaged, what leaving the rest out may cost."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace

from microplan.featuresel.look.scenario import scene
from microplan.optics.layers.layer_error import (
    TREATMENTS,
    LayerChoice,
    LayerRefusal,
    layer_error,
)
from microplan.optics.ledger import CONTRAST, Imaged, ledger
from microplan.optics.lens.distorted_scene import lens_scene
from microplan.optics.outline.tolerant_order import above
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.model_errors.better_models import CHARGED, FINISH
from microplan.planner.looks.model_errors.charged_chains import ChargedChains
from microplan.planner.looks.model_errors.halo_ends import halo_row
from microplan.planner.looks.model_errors.wavefront_ends import wavefront_rows
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.task.task import Task
from microplan.planner.views.lens_errors import NM_PER_UM, lamp_aperture, lens_rows
from microplan.planner.views.light.lit_layers import asks_for_walls
from microplan.planner.views.requests import Request
from microplan.planner.views.target_views import needed_shape, target_pose
from microplan.schemas import plan as p


def effect_rows(
    task: Task, request: Request, tried: Evaluation, memo: Memo = EVERY_TIME
) -> tuple[p.EffectRow, ...]:
    """Return the effects ledger of a look."""
    case, shape = tried.case, needed_shape(task, request)
    spot = target_pose(task, request, shape)
    rows = memo.call(
        ledger,
        _imaged(task, tried, memo),
        lens_rows(task, request.state, shape, spot, case.microscope),
        shift_limit_nm=NM_PER_UM * case.tolerance_um,
    )
    found = tuple(p.EffectRow(**asdict(row)) for row in rows)
    limit, lens = tried.fidelity.limit, task.workcell.optics
    unknown = wavefront_rows(lens.wavefront, limit)
    return (*found, finish_row(limit), *unknown, halo_row(lens.halo, limit))


def _imaged(task: Task, tried: Evaluation, memo: Memo) -> Imaged:
    """Return the nominal image of a look, and how it is computed."""
    limit = tried.fidelity.limit
    # rows of their own have what a wavefront error and a halo leave
    perfect = replace(tried.case.microscope, wavefront=(), halo=None)
    case = replace(tried.case, microscope=perfect)
    shown = lens_scene(
        scene(case, 0.0, 0.0, 0.0), case.microscope, case.lens, case.focus_um
    )
    errors = {
        treatment: memo.call(
            layer_error,
            shown,
            case.microscope,
            focus_um=case.focus_um,
            treatment=treatment,
            window=case.window,
            lamp_aperture=case.lamp_aperture,
        )
        for treatment in TREATMENTS
    }
    layering = LayerChoice(
        treatment=case.treatment,
        predicted_error=errors[case.treatment],
        limit=limit,
        refused=tuple(
            LayerRefusal(treatment=name, predicted_error=error)
            for name, error in errors.items()
            if name != case.treatment and errors[case.treatment] > limit
        ),
    )
    return Imaged(
        scene=shown,
        microscope=case.microscope,
        focus_um=case.focus_um,
        window=case.window,
        fidelity=tried.fidelity,
        layering=layering,
        coherence=task.workcell.optics.coherence,
        lamp_aperture=lamp_aperture(task.workcell, case.microscope),
        is_shaded=case.lamp_aperture is not None,
        light=task.workcell.light.kind if asks_for_walls(task.workcell) else "",
    )


def open_effects(rows: Iterable[p.EffectRow]) -> tuple[str, ...]:
    """Return the image effects that are above their limits, or have no number."""
    return tuple(
        row.effect
        for row in rows
        if row.unit == CONTRAST
        and row.limit is not None
        and row.effect not in CHARGED
        and (row.predicted_error is None or above(row.predicted_error, row.limit))
    )


def with_costs(
    rows: Sequence[p.EffectRow], charges: ChargedChains
) -> tuple[p.EffectRow, ...]:
    """Return a ledger's rows with what those above their limits cost the look's chain.

    What had no number has that of the pairs of images.
    """
    found = []
    for row in rows:
        known = charges.rows.get(row.effect)
        if known is None:
            found.append(row)
            continue
        error = row.predicted_error
        level = row.level
        if error is None:
            error, level = known.image_error, "charged"
        found.append(replace(row, predicted_error=error, level=level, cost=known.cost))
    return tuple(found)


def finish_row(limit: float) -> p.EffectRow:
    """Return the row of faces that may be dull or mirrors, before it is charged."""
    return p.EffectRow(
        effect=FINISH,
        level="not modelled",
        predicted_error=None,
        limit=limit,
        unit=CONTRAST,
        reason="a mirror returns its light once, a dull face is shaded twice",
    )
