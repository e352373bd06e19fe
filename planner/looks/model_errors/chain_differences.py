"""What better images change of the answers of a look's chains."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.trials import PreparedRoutines
from microplan.optics.outline.tolerant_order import above
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
from microplan.planner.looks.model_errors.used_poses import LEAST, SPARE, used_poses
from microplan.planner.looks.progress.work import PAIRS

# Share of a tolerance: where Student's part of a half-width is less, more poses than
# the least would narrow it by no more than that. As it is looked at after the least, it
# misses up to 5.8 % in place of 5 (normal differences).
_DOUBT = 0.02
# by each better model, or why that is open
Differences = Mapping[Chain, tuple[EffectDifference, ...] | str]


@dataclass(frozen=True, slots=True, kw_only=True)
class DifferenceMeter:
    """Pairs of images of one look, made once for all of its chains."""

    problem: LookProblem
    models: tuple[BetterModel, ...]
    # by the models that they are of
    pictures: dict[tuple[int, ...], PairPictures] = field(default_factory=dict)

    def differences(self, tried: Evaluation, chains: Sequence[Chain]) -> Differences:
        """Return what each model changes of each chain's answers, or why that is open.

        All models are tried at the least number of poses, those at all of them whose
        half-widths matter. Where too few pairs are answered, more poses are tried.
        """
        if not chains:
            return {}
        count, case = self.problem.context.effort.pairs, tried.case
        every = {(chain, k) for chain in chains for k in range(len(self.models))}
        answers = self._answers(tried, every, slice(0, LEAST))
        further = {
            which
            for which, each in self._found(chains, answers)
            if _is_doubtful(each, case)
        }
        answers += self._answers(tried, further, slice(LEAST, count))
        few = {which for which, each in self._found(chains, answers) if _is_short(each)}
        answers += self._answers(tried, few, slice(count, count + SPARE))
        return _by_chain(self.models, chains, answers)

    def _found(
        self, chains: Sequence[Chain], answers: Sequence[PairedAnswer]
    ) -> Iterator[tuple[tuple[Chain, int], EffectDifference | str]]:
        """Yield what each model changes of each chain's answers, and which these are.

        A chain, and the number of a model.
        """
        for number, model in enumerate(self.models):
            for chain in chains:
                own = [a for a in answers if (a.chain, a.model) == (chain, number)]
                yield (chain, number), effect_difference(model, own)

    def _answers(
        self, tried: Evaluation, asked: Collection[tuple[Chain, int]], which: slice
    ) -> tuple[PairedAnswer, ...]:
        """Return what chains say of models' pairs of images at some of the poses."""
        context, request = self.problem.context, self.problem.request
        numbers = tuple(sorted({number for _, number in asked}))
        chains = tuple(sorted({chain for chain, _ in asked}))
        names = sorted({name for chain in chains for name in chain})
        artifacts = tried.comparison.prepared.artifacts
        poses = used_poses(
            tried.case,
            request.used_within_um,
            count=context.effort.pairs + SPARE,
            root_seed=self.problem.task.seed,
        )[which]
        if not (numbers and poses):
            return ()
        found: tuple[PairedAnswer, ...] = context.memo.call(
            image_pairs,
            tried.case,
            PreparedRoutines(
                chains=chains,
                artifacts={name: artifacts[name] for name in names},
            ),
            tuple(self.models[number] for number in numbers),
            poses,
            map=context.spread("pairs", lambda _: PAIRS),
            known=self.pictures.setdefault(numbers, PairPictures()),
        )
        named = (replace(each, model=numbers[each.model]) for each in found)
        # what one chain lacks is no other's business
        return tuple(each for each in named if (each.chain, each.model) in asked)


def _is_short(found: EffectDifference | str) -> bool:
    """Return whether too few pairs were answered: more poses may help."""
    return isinstance(found, str) and WRONG not in found


def _is_doubtful(found: EffectDifference | str, case: LookCase) -> bool:
    """Return whether more poses would make a half-width smaller by what matters."""
    if isinstance(found, str):
        return _is_short(found)
    place, turn = found.place, found.turn
    doubt_um = (place.half_width - place.interval).max()
    if above(float(doubt_um), _DOUBT * case.tolerance_um):
        return True
    if turn is None or case.tolerance_theta_rad is None:
        return False
    doubt_rad = (turn.half_width - turn.interval).max()
    return above(float(doubt_rad), _DOUBT * case.tolerance_theta_rad)


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
