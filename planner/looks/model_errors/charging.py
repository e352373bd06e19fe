"""Effects of a look above their limits, charged to its chains in um."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.score import ChainScore
from microplan.featuresel.trials.trials import PreparedRoutines
from microplan.optics.ledger import CONTRAST
from microplan.optics.outline.tolerant_order import above, at_most
from microplan.planner.assembly.assembly import bodies
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.look_problem import LookProblem
from microplan.planner.looks.model_errors.better_models import (
    CHARGED,
    FINISH,
    BetterModel,
    better_models,
)
from microplan.planner.looks.model_errors.charged_chains import ChargedChains
from microplan.planner.looks.model_errors.image_pairs import PairedAnswer, image_pairs
from microplan.planner.looks.model_errors.model_cost import (
    WRONG,
    EffectDifference,
    effect_difference,
    model_cost,
)
from microplan.planner.looks.model_errors.used_poses import SPARE, used_poses
from microplan.schemas import plan as p


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


def charged(
    problem: LookProblem,
    tried: Evaluation,
    rows: Sequence[p.EffectRow],
    *,
    may_swap: bool = True,
) -> tuple[Evaluation, ChargedChains]:
    """Return what effects cost a feature's chain and fallback.

    Where the chain cannot be charged, or misses its tolerance by what it is charged,
    its fallback takes its place if it can, and if the look `may_swap` them; a fallback
    that cannot is left out. Where neither can, `fault` says why.
    """
    selection = tried.comparison.selection
    effects = open_effects(rows)
    if selection.chosen is None or not effects:
        return tried, ChargedChains()
    standing = tuple(bodies(problem.task, problem.request.state))
    models = better_models(tried.case, effects, standing)
    known = {name for model in models for name in model.effects}
    lacking = [name for name in effects if name not in known]
    if lacking:
        fault = f"no better image has {', '.join(lacking)}"
        return tried, ChargedChains(fault=fault)
    scores = [s for s in (selection.chosen, selection.fallback) if s is not None]
    chains = tuple(dict.fromkeys(score.chain for score in scores))
    found = _differences(problem, tried, models, chains)
    own: tuple[EffectDifference, ...] | str = found[selection.chosen.chain]
    spare_chain = None if selection.fallback is None else selection.fallback.chain
    spare = None if spare_chain is None else found[spare_chain]
    spoilt = _spoilt(tried, selection.chosen, own)
    if spoilt and not isinstance(spare, str) and spare is not None and may_swap:
        other = selection.fallback
        if other is not None and not _spoilt(tried, other, spare):
            own = spoilt
    if isinstance(own, str):
        if spare is None or isinstance(spare, str) or not may_swap:
            fault = f"{' > '.join(selection.chosen.chain)}: {own}"
            return tried, ChargedChains(fault=fault)
        tried = _without(tried, own, is_swapped=True)
        return tried, replace(_charges(spare, None), swapped=own)
    if isinstance(spare, str):
        return _without(tried, spare), replace(_charges(own, None), dropped=spare)
    return tried, _charges(own, spare)


def _spoilt(
    tried: Evaluation,
    score: ChainScore,
    found: tuple[EffectDifference, ...] | str,
) -> str:
    """Return that errors of images make a chain miss its tolerance, "" if not."""
    cost = None if isinstance(found, str) else model_cost(found)
    if cost is None or score.sigma_um is None:
        return ""
    sigma_um = math.hypot(score.sigma_um, max(cost.sigma_um))
    need_um = 2 * sigma_um + math.hypot(*cost.half_width_um)
    tolerance_um = tried.case.tolerance_um
    if at_most(need_um, tolerance_um):
        return ""
    return (
        f"2 sigma and the half-width are {need_um:.3g} um, tolerance "
        f"{tolerance_um:.3g} um"
    )


def _differences(
    problem: LookProblem,
    tried: Evaluation,
    models: tuple[BetterModel, ...],
    chains: tuple[Chain, ...],
) -> Mapping[Chain, tuple[EffectDifference, ...] | str]:
    """Return what each model changes of each chain's answers, or why that is open.

    Where too few pairs are answered, more poses are tried.
    """
    count = problem.context.effort.pairs
    answers = _answers(problem, tried, models, chains, slice(0, count))
    found = _by_chain(models, chains, answers)
    if any(isinstance(each, str) and WRONG not in each for each in found.values()):
        more = slice(count, count + SPARE)
        answers += _answers(problem, tried, models, chains, more)
        found = _by_chain(models, chains, answers)
    return found


def _answers(
    problem: LookProblem,
    tried: Evaluation,
    models: tuple[BetterModel, ...],
    chains: tuple[Chain, ...],
    which: slice,
) -> tuple[PairedAnswer, ...]:
    """Return what chains say of pairs of images at some of the poses."""
    context, case = problem.context, tried.case
    names = sorted({name for chain in chains for name in chain})
    artifacts = tried.comparison.prepared.artifacts
    poses = used_poses(
        case,
        problem.request.used_within_um,
        count=context.effort.pairs + SPARE,
        root_seed=problem.task.seed,
    )
    return context.memo.call(
        image_pairs,
        case,
        PreparedRoutines(
            chains=chains, artifacts={name: artifacts[name] for name in names}
        ),
        models,
        poses[which],
        map=context.map,
    )


def _by_chain(
    models: Sequence[BetterModel],
    chains: Sequence[Chain],
    answers: Sequence[PairedAnswer],
) -> dict[Chain, tuple[EffectDifference, ...] | str]:
    """Return the differences of each chain, or the first reason why one is open."""
    found: dict[Chain, tuple[EffectDifference, ...] | str] = {}
    for chain in chains:
        each = [
            effect_difference(
                model, [a for a in answers if (a.chain, a.model) == (chain, k)]
            )
            for k, model in enumerate(models)
        ]
        faults = [
            f"{', '.join(model.effects)}: {fault}"
            for model, fault in zip(models, each, strict=True)
            if isinstance(fault, str)
        ]
        right = tuple(one for one in each if not isinstance(one, str))
        found[chain] = "; ".join(faults) if faults else right
    return found


def _charges(
    own: tuple[EffectDifference, ...], spare: tuple[EffectDifference, ...] | None
) -> ChargedChains:
    """Return the costs of a chain and its fallback."""
    return ChargedChains(
        chain=model_cost(own),
        fallback=None if spare is None else model_cost(spare),
        rows={name: each for each in own for name in each.model.effects},
    )


def _without(tried: Evaluation, why: str, *, is_swapped: bool = False) -> Evaluation:
    """Return an evaluation without its fallback, or with it in the chain's place.

    Reasons say so: `why` of the one that is not used.
    """
    selection = tried.comparison.selection
    kept, left = selection.chosen, selection.fallback
    if is_swapped:
        kept, left = left, kept
    told = dict(selection.reasons)
    if left is not None:
        told[left.chain] = f"rejected: errors of images: {why}"
    if is_swapped and kept is not None:
        told[kept.chain] = told[kept.chain].replace("fallback:", "chosen:", 1)
    selection = replace(
        selection, chosen=kept, fallback=None, reasons=tuple(told.items())
    )
    return replace(tried, comparison=replace(tried.comparison, selection=selection))


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
