"""Effects of a look above their limits, charged in um to chains that stand them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.score import ChainScore
from microplan.optics.outline.tolerant_order import at_most
from microplan.planner.assembly.assembly import bodies
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.look_problem import LookProblem
from microplan.planner.looks.model_errors.better_models import better_models
from microplan.planner.looks.model_errors.chain_differences import (
    DifferenceMeter,
    Differences,
)
from microplan.planner.looks.model_errors.charged_chains import ChargedChains
from microplan.planner.looks.model_errors.effect_rows import open_effects
from microplan.planner.looks.model_errors.model_cost import (
    AcceptedRange,
    EffectDifference,
    model_cost,
)
from microplan.schemas import plan as p

_Charge = tuple[EffectDifference, ...] | str  # or why there is none
Charge = Callable[[Evaluation, Sequence[Chain]], Differences]
Again = Callable[[Evaluation, Mapping[Chain, str]], Evaluation]


def charged(
    problem: LookProblem,
    tried: Evaluation,
    rows: Sequence[p.EffectRow],
    *,
    in_set: bool = False,
) -> tuple[Evaluation, ChargedChains]:
    """Return what effects cost a feature's chain and fallback, and who these are then.

    A chain that cannot be charged, or misses its tolerance by what it is charged, is
    struck out, and chain and fallback are chosen again among what is left. The chain of
    a feature that is `in_set` stays: the set was chosen by it.
    """
    effects = open_effects(rows)
    if tried.comparison.selection.chosen is None or not effects:
        return tried, ChargedChains()
    standing = tuple(bodies(problem.task, problem.request.state))
    wavefront = problem.task.workcell.optics.wavefront
    models = better_models(tried.case, effects, standing, wavefront)
    known = {name for model in models for name in model.effects}
    lacking = [name for name in effects if name not in known]
    if lacking:
        fault = f"no better image has {', '.join(lacking)}"
        return tried, ChargedChains(fault=fault)
    meter = DifferenceMeter(problem=problem, models=models)
    again = judged_member if in_set else problem.without
    return charge_chains(tried, meter.differences, again, is_fixed=in_set)


def judged_member(tried: Evaluation, rejected: Mapping[Chain, str]) -> Evaluation:
    """Return one of several features with its fallback chosen again."""
    own = tried.comparison.selection.chosen
    judged = tried.comparison.judged(
        tried.case,
        in_set=True,
        rejected=rejected,
        kept=None if own is None else own.chain,
    )
    return replace(tried, comparison=judged)


def charge_chains(
    tried: Evaluation, charge: Charge, again: Again, *, is_fixed: bool = False
) -> tuple[Evaluation, ChargedChains]:
    """Return an evaluation whose chain and fallback stand what they are charged.

    Where no chain does, it is the one that misses its tolerance by least, without a
    fallback, and `missed` says so; where none can be charged, `fault` says why.

    Parameters
    ----------
    tried : Evaluation
        With a chain that its trials chose.
    charge : callable
        Returns what some chains of an evaluation are charged; none is asked for twice.
    again : callable
        Returns an evaluation with chain and fallback chosen again, without chains that
        are rejected for the reasons given.
    is_fixed : bool
        Whether the chain stays if it can be charged at all: its fallback alone changes.
    """
    found, known = tried, dict[Chain, _Charge]()
    struck = dict[Chain, str]()
    fixed = _both(tried)[0].chain if is_fixed else None
    while both := _both(found):
        new = tuple(each.chain for each in both if each.chain not in known)
        known |= charge(found, new)
        faults = {each.chain: _fault(found, each, known[each.chain]) for each in both}
        if fixed is not None and isinstance(known[fixed], str):
            return tried, ChargedChains(fault=_listed({fixed: faults[fixed]}))
        fallen = {c: why for c, why in faults.items() if why and c != fixed}
        if not fallen:
            return found, _charges(both, known, struck)
        struck |= fallen
        found = again(found, _rejections(struck))
    # one that stood may have failed further trials since: it is not among them
    best = _least_missed(found, {chain: known[chain] for chain in struck})
    if best is None:
        return tried, ChargedChains(fault=_listed(struck))
    missed = struck.pop(best)
    judged = found.comparison.judged(found.case, rejected=_rejections(struck))
    found = replace(found, comparison=judged)
    return found, replace(_charges(_both(found), known, struck), missed=missed)


def _least_missed(found: Evaluation, known: Differences) -> Chain | None:
    """Return the chain with the least need, None where none can be charged."""
    needs = [
        (max(need / limit for need, limit, _ in _needs(found, score, each)), score)
        for score in found.comparison.scores
        if not isinstance(each := known.get(score.chain, ""), str)
    ]
    return min(needs, key=lambda pair: pair[0])[1].chain if needs else None


def _both(tried: Evaluation) -> tuple[ChainScore, ...]:
    """Return the scores of chain and fallback, as far as there are any."""
    selection = tried.comparison.selection
    both = (selection.chosen, selection.fallback)
    return tuple(score for score in both if score is not None)


def _fault(tried: Evaluation, score: ChainScore, found: _Charge) -> str:
    """Return why a chain does not stand errors of images, "" if it does."""
    if isinstance(found, str):
        return found
    for need, limit, unit in _needs(tried, score, found):
        if not at_most(need, limit):
            return (
                f"2 sigma and the half-width are {need:.3g} {unit}, tolerance "
                f"{limit:.3g} {unit}"
            )
    return ""


def _needs(
    tried: Evaluation, score: ChainScore, found: Sequence[EffectDifference]
) -> list[tuple[float, float, str]]:
    """Return 2 sigma and half-width with the tolerance, of the place and the angle."""
    cost, case = model_cost(found), tried.case
    if cost is None:
        return [(0.0, case.tolerance_um, "um")]
    sigma_um = cost.charged_um(score.sigma_um or 0.0)
    need_um = 2 * sigma_um + math.hypot(*cost.half_width_um)
    needs = [(need_um, case.tolerance_um, "um")]
    turn, half_rad = case.tolerance_theta_rad, cost.half_width_theta_rad
    if turn is not None and half_rad is not None:
        sigma_rad = math.hypot(score.sigma_theta_rad or 0.0, cost.sigma_theta_rad or 0)
        needs.append((2 * sigma_rad + half_rad, turn, "rad"))
    return needs


def _rejections(struck: Mapping[Chain, str]) -> Mapping[Chain, str]:
    """Return reasons as a choice among chains gives them."""
    return {chain: f"errors of images: {why}" for chain, why in struck.items()}


def _listed(faults: Mapping[Chain, str]) -> str:
    """Return chains with their faults."""
    return "; ".join(f"{' > '.join(chain)}: {why}" for chain, why in faults.items())


def _charges(
    both: Sequence[ChainScore], known: Differences, struck: Mapping[Chain, str]
) -> ChargedChains:
    """Return the costs of a chain and its fallback, if there is one."""
    own, *spare = [
        each for score in both if not isinstance(each := known[score.chain], str)
    ]
    return ChargedChains(
        chain=model_cost(own),
        fallback=model_cost(spare[0]) if spare else None,
        rows={name: each for each in own for name in each.model.effects},
        struck=struck,
        accepted=AcceptedRange.of(each.accepted for each in own),
        fallback_accepted=AcceptedRange.of(
            each.accepted for chain in spare for each in chain
        ),
    )
