"""What better images change of the answers of a look's chains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.trials import PreparedRoutines
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.look_problem import LookProblem
from microplan.planner.looks.model_errors.better_models import BetterModel
from microplan.planner.looks.model_errors.image_pairs import PairedAnswer, image_pairs
from microplan.planner.looks.model_errors.model_cost import (
    WRONG,
    EffectDifference,
    effect_difference,
)
from microplan.planner.looks.model_errors.pair_pictures import PairPictures
from microplan.planner.looks.model_errors.used_poses import SPARE, used_poses

# by each better model, or why that is open
Differences = Mapping[Chain, tuple[EffectDifference, ...] | str]


@dataclass(frozen=True, slots=True, kw_only=True)
class DifferenceMeter:
    """Pairs of images of one look, made once for all of its chains."""

    problem: LookProblem
    models: tuple[BetterModel, ...]
    pictures: PairPictures = field(default_factory=PairPictures)

    def differences(self, tried: Evaluation, chains: Sequence[Chain]) -> Differences:
        """Return what each model changes of each chain's answers, or why that is open.

        Where too few pairs are answered, more poses are tried.
        """
        if not chains:
            return {}
        count = self.problem.context.effort.pairs
        answers = self._answers(tried, chains, slice(0, count))
        found = _by_chain(self.models, chains, answers)
        if any(isinstance(each, str) and WRONG not in each for each in found.values()):
            more = slice(count, count + SPARE)
            answers += self._answers(tried, chains, more)
            found = _by_chain(self.models, chains, answers)
        return found

    def _answers(
        self, tried: Evaluation, chains: Sequence[Chain], which: slice
    ) -> tuple[PairedAnswer, ...]:
        """Return what chains say of pairs of images at some of the poses."""
        context, request = self.problem.context, self.problem.request
        names = sorted({name for chain in chains for name in chain})
        artifacts = tried.comparison.prepared.artifacts
        poses = used_poses(
            tried.case,
            request.used_within_um,
            count=context.effort.pairs + SPARE,
            root_seed=self.problem.task.seed,
        )
        return context.memo.call(
            image_pairs,
            tried.case,
            PreparedRoutines(
                chains=tuple(chains),
                artifacts={name: artifacts[name] for name in names},
            ),
            self.models,
            poses[which],
            map=context.map,
            known=self.pictures,
        )


def _by_chain(
    models: Sequence[BetterModel],
    chains: Sequence[Chain],
    answers: Sequence[PairedAnswer],
) -> Differences:
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
