"""Mechanical effects of a step in the ledger: modelled or not, at what level."""

from __future__ import annotations

from microplan.planner.assembly.step_states import StepState
from microplan.schemas.plan import Budget, EffectRow
from microplan.schemas.plan.verdicts import FitVerdict, GraspVerdict, ReleaseVerdict

UN, RAD, UM = "uN", "rad", "um"
LEFT_OUT = "not modelled"
INTERVAL = "interval"

# What no step models, with what leaving it out means.
NEVER = (
    ("impact and vibration", "moves end in settle_s; nothing is known of the frame"),
    ("deformation of the part", "parts are rigid; fingers bend, parts do not"),
    ("electric double layers", "only in liquids, where no release is judged"),
)


def mechanical_rows(
    here: StepState,
    budget: Budget,
    fit: FitVerdict | None,
    grasp: GraspVerdict | None,
    release: ReleaseVerdict | None,
) -> tuple[EffectRow, ...]:
    """Return which mechanical effects of a step were modelled, at what level.

    A step that touches nothing has none.
    """
    if here.step.verb not in ("align", "grasp", "insert", "release", "move"):
        return ()
    rows = [
        _row("collision", "swept hulls, 2 sigma", None, UM, "every move is checked")
    ]
    if here.step.verb == "insert":
        rows += _insert_rows(budget, fit)
    if grasp is not None:
        rows += _grasp_rows(grasp)
    if release is not None:
        if (
            budget.analysis is not None
        ):  # the position of the released part is asked for
            rows += _budget_rows(budget)
        rows += _adhesion_rows(release)
    else:
        rows.append(
            _row("adhesion", LEFT_OUT, None, UN, "no part changes hands by it here")
        )
    rows += [_row(effect, LEFT_OUT, None, UM, why) for effect, why in NEVER]
    return tuple(rows)


def _insert_rows(budget: Budget, fit: FitVerdict | None) -> list[EffectRow]:
    """Return the terms of an insertion's budget, and what its fit takes."""
    rows = _budget_rows(budget)
    if fit is not None:
        rows.append(_row("taper", "worst case", fit.taper_um, UM, "off the clearance"))
        wedging = "inequality" if fit.wedging_rad is not None else LEFT_OUT
        why = "tilt < clearance / diameter / friction"
        rows.append(_row("wedging", wedging, fit.wedging_rad, RAD, why))
    rows.append(
        _row("contact forces on insertion", LEFT_OUT, None, UN, "no sensor feels them")
    )
    return rows


def _budget_rows(budget: Budget) -> list[EffectRow]:
    """Return the terms of a budget, one sigma each."""
    return [
        _row(row.term, "normal", None, UM, f"{row.sigma_um:.3g} um: {row.source}")
        if row.sigma_um is not None
        else _row(row.term, LEFT_OUT, None, UM, row.source)
        for row in budget.rows
    ]


def _grasp_rows(grasp: GraspVerdict) -> list[EffectRow]:
    """Return what holds the part, and how it rotates."""
    level = LEFT_OUT if grasp.force_un is None else "cantilever"
    most = None if grasp.force_un is None else grasp.force_un[1]
    return [
        _row("hold force", level, most, UN, grasp.reason),
        _row(
            "turn into a flat position",
            "nearest minimum of hull width",
            grasp.theta_within_rad,
            RAD,
            f"{grasp.settles} minima in half a turn",
        ),
        _row(
            "weight and hold of the stage", INTERVAL, grasp.lift_un[1], UN, "lift-off"
        ),
    ]


def _adhesion_rows(release: ReleaseVerdict) -> list[EffectRow]:
    """Return every force between part and finger, and what it lies on."""
    rows = [_row("weight", "volume x density", release.weight_un[1], UN, "outline")]
    for side, found in (("finger", release.finger), ("below", release.holding)):
        rows += [
            _row(f"{force.name}, {side}", INTERVAL, force.most_un, UN, force.validity)
            for force in found
        ]
    return rows


def _row(
    effect: str, level: str, size: float | None, unit: str, reason: str
) -> EffectRow:
    return EffectRow(
        effect=effect,
        level=level,
        predicted_error=size,
        limit=None,
        unit=unit,
        reason=reason,
    )
