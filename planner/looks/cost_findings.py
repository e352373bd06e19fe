"""Findings about what errors of a look's images cost."""

from __future__ import annotations

import math
from collections.abc import Sequence

from microplan.featuresel.trials.chains import Chain
from microplan.planner.looks.measures import MeasuredFeature
from microplan.planner.looks.model_errors.charged_chains import ChargedChains
from microplan.planner.source.diagnostics import Report
from microplan.planner.views.requests import Request
from microplan.schemas import plan as p

CODE = "MP503"
_HINT = "state what the image is not sure of (walls, finish, light, wavefront, halo)"


def report_costs(
    request: Request, look: p.Look, found: Sequence[MeasuredFeature], report: Report
) -> bool:
    """Report what errors of images cost a look, in um; False if that is not known.

    A look that has a chain without a number is refused.
    """
    faults = [each.charges.fault for each in found if each.charges.fault]
    if faults:
        report.refuse(
            CODE,
            request.where,
            f"look {request.id!r}: images err by more than max_image_error, and what "
            f"that costs cannot be measured: {'; '.join(faults)}",
            f"{_HINT}, or look at another feature",
        )
        return False
    for each in found:
        spare = each.tried.comparison.selection.fallback
        said = struck_words(
            each.charges, each.chosen.chain, None if spare is None else spare.chain
        )
        if said:
            report.note(
                CODE,
                request.where,
                f"look {request.id!r}: {said}",
                _HINT,
            )
    words = cost_words(look.effects, look.model_cost)
    if words:
        report.fact(CODE, request.where, f"look {request.id!r}: {words}")
    return True


def struck_words(charges: ChargedChains, own: Chain, spare: Chain | None) -> str:
    """Return which chains errors of images spoil and what is used instead, or ""."""
    spoilt = {**charges.struck, own: charges.missed}
    faults = [f"{' > '.join(chain)}: {why}" for chain, why in spoilt.items() if why]
    if not faults:
        return ""
    nearest = ", of these the nearest to its tolerance" if charges.missed else ""
    then = "without a fallback" if spare is None else f"then {' > '.join(spare)}"
    return (
        f"errors of images spoil {'; '.join(faults)}; {' > '.join(own)} is used"
        f"{nearest}, {then}"
    )


def cost_words(rows: Sequence[p.EffectRow], cost: p.ModelCost | None) -> str:
    """Return what effects cost in um, the largest first, "" where there are none."""
    if cost is None:
        return ""
    each = [(row.effect, row.cost) for row in rows if row.cost is not None]
    each.sort(key=lambda pair: -size_um(pair[1]))
    parts = ", ".join(f"{effect} {effect_words(found)}" for effect, found in each)
    return (
        "what images err by beyond max_image_error costs a bias of "
        f"{_ends(cost.bias_um, cost.half_width_um)} um, taken off, and sigma "
        f"{max(cost.sigma_um):.2g} um, by {cost.pairs} pairs of images: {parts}"
    )


def effect_words(cost: p.EffectCost) -> str:
    """Return what one effect costs, um."""
    return _ends(cost.bias_um, cost.half_width_um)


def size_um(cost: p.EffectCost) -> float:
    """Return how large the bias of an effect may be, um."""
    return math.hypot(*cost.bias_um) + math.hypot(*cost.half_width_um)


def _ends(bias_um: tuple[float, float], half_um: tuple[float, float]) -> str:
    return f"{math.hypot(*bias_um):.2g} ± {math.hypot(*half_um):.2g}"
