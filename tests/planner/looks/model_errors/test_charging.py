"""Chains and fallbacks that stand their charges, against all pairs of chains."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.featuresel.routines.contract import Principle
from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.evaluate import RoutineComparison
from microplan.featuresel.selection.select import independence, select
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcomes
from microplan.featuresel.trials.score import ChainScore
from microplan.featuresel.trials.trials import PreparedRoutines
from microplan.optics.render.fidelity import Fidelity
from microplan.optics.render.sampling import Sampling
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.model_errors.answer_shift import AnswerShift
from microplan.planner.looks.model_errors.better_models import WALLS, BetterModel
from microplan.planner.looks.model_errors.chain_differences import Differences
from microplan.planner.looks.model_errors.charged_chains import ChargedChains
from microplan.planner.looks.model_errors.charging import (
    charge_chains,
    judged_member,
)
from microplan.planner.looks.model_errors.model_cost import (
    EffectDifference,
)
from tests.featuresel.conftest import post_alone
from tests.featuresel.selection.test_select import GEAR, NOTCH, a_score, with_failures

TOLERANCE_UM = 1.0
CASE = replace(post_alone(), tolerance_um=TOLERANCE_UM, tolerance_theta_rad=None)
FIDELITY = Fidelity(
    model="exact", sampling=Sampling(), predicted_error=0.0, sampling_error=0.0,
    limit=0.01, refused=(),
)  # fmt: skip
OPEN = "4 of 12 better images are answered wrongly"
NAMES = ["a", "b", "c", "a>b", "a>c", "b>c", "b>a", "c>b"]


def charge_um(half_width_um: float) -> tuple[EffectDifference, ...]:
    """Return a charge that has this half-width along x, and no sigma."""
    shift = AnswerShift(
        pairs=12, freedom=6, mean=np.zeros(2), sigma=np.zeros(2),
        half_width=np.array([half_width_um, 0.0]), interval=np.zeros(2),
    )  # fmt: skip
    model = BetterModel(effects=(WALLS,), by="solid bodies", ends=())
    return (EffectDifference(model=model, place=shift, turn=None, image_error=0.1),)


@dataclass(frozen=True)
class Field:
    """Chains by their trials, with what each would be charged: None is open."""

    scores: tuple[ChainScore, ...]
    half_um: Mapping[Chain, float | None]
    asked: list[Chain] = field(default_factory=list)

    @property
    def tried(self) -> Evaluation:
        chains = tuple(score.chain for score in self.scores)
        task = Constraints(tolerance_um=TOLERANCE_UM, tolerance_theta_rad=None)
        found = RoutineComparison(
            prepared=PreparedRoutines(chains=chains, artifacts={}), limit_um=None,
            outcomes=Outcomes.of(), scores=self.scores, visible=None,
            selection=select(self.scores, task),
        )  # fmt: skip
        return Evaluation(case=CASE, fidelity=FIDELITY, comparison=found)

    def charge(self, _: Evaluation, chains: Sequence[Chain]) -> Differences:
        self.asked.extend(chains)
        return {
            chain: OPEN if half_um is None else charge_um(half_um)
            for chain in chains
            for half_um in [self.half_um[chain]]
        }

    def run(self, *, is_fixed: bool = False) -> tuple[Evaluation, ChargedChains]:
        again = judged_member if is_fixed else rejecting
        return charge_chains(self.tried, self.charge, again, is_fixed=is_fixed)

    def need_um(self, score: ChainScore) -> float:
        half_um = self.half_um[score.chain]
        return np.inf if half_um is None else 2 * (score.sigma_um or 0.0) + half_um


def rejecting(tried: Evaluation, rejected: Mapping[Chain, str]) -> Evaluation:
    judged = tried.comparison.judged(tried.case, rejected=rejected)
    return replace(tried, comparison=judged)


@st.composite
def fields(draw: st.DrawFn) -> Field:
    names = draw(st.lists(st.sampled_from(NAMES), min_size=1, unique=True))
    scores, half_um = [], {}
    kinds: list[Principle] = ["edges", "area"]
    for name in names:
        sigma_um = draw(st.sampled_from([0.1, 0.2, 0.3, 0.45, 0.6]))
        score = a_score(name, sigma_um, draw(st.sampled_from([1.0, 2.0, 3.0, 4.0])))
        score = replace(score, principle=draw(st.sampled_from(kinds)))
        scores.append(with_failures(score, draw(st.sampled_from([0, 0, 0, 5])), 0))
        half_um[score.chain] = draw(st.sampled_from([None, 0.0, 0.15, 0.5, 0.7, 2.0]))
    return Field(tuple(scores), half_um)


@given(fields())
def test_chain_and_fallback_stand_and_have_the_least_in_common(found: Field) -> None:
    """By all pairs of chains that pass their trials and stand their charges."""
    passing = [s for s in found.scores if s.success == 64 and s.need_um <= TOLERANCE_UM]
    stand = [s for s in passing if found.need_um(s) <= TOLERANCE_UM]
    if not passing:
        return  # such a look is not charged
    tried, charges = found.run()
    chosen = tried.comparison.selection.chosen
    fallback = tried.comparison.selection.fallback
    assert len(found.asked) == len(set(found.asked))
    assert {*found.asked} <= {score.chain for score in passing}
    assert chosen is not None
    if not stand:
        assert fallback is None or charges.fault
        payable = [s for s in passing if found.half_um[s.chain] is not None]
        assert bool(charges.fault) == (not payable)
        assert bool(charges.missed) == bool(payable)
        if payable:
            assert found.need_um(chosen) == min(map(found.need_um, payable))
        return
    assert (charges.fault, charges.missed) == ("", "")
    roomy = [s for s in stand if s.need_um <= TOLERANCE_UM / 2]
    if roomy:
        assert chosen == min(roomy, key=lambda s: (s.cost, s.chain))
    pairs = [pair for pair in itertools.permutations(stand, 2) if pair[0] == chosen]
    assert (fallback is None) == (not pairs)
    if fallback is not None:
        assert (chosen, fallback) in pairs
        most = max(independence(other, chosen) for _, other in pairs)
        assert independence(fallback, chosen) == most
        assert charges.fallback is not None
    assert charges.chain is not None
    assert not {score.chain for score in stand} & set(charges.struck)


@given(fields())
def test_reasons_are_those_of_a_choice_that_knows_who_is_struck(found: Field) -> None:
    if found.tried.comparison.selection.chosen is None:
        return
    tried, charges = found.run()
    if charges.fault:
        assert tried == found.tried
        return
    told = {c: f"errors of images: {why}" for c, why in charges.struck.items()}
    reasons = dict(rejecting(found.tried, told).comparison.selection.reasons)
    assert dict(tried.comparison.selection.reasons) == reasons
    for chain, why in told.items():
        assert reasons[chain] == f"rejected: {why}"


def edges(name: str, sigma_um: float, cost: float) -> ChainScore:
    return replace(a_score(name, sigma_um, cost), principle="edges")


AREA = a_score("otsu", 0.1, 1.0)
SPARE, FINE = edges("contour_match", 0.1, 4.0), edges("circle_caliper", 0.05, 2.0)


def of(**half_um: float | None) -> Field:
    names = {"otsu": AREA, "contour_match": SPARE, "circle_caliper": FINE}
    return Field(
        tuple(names[name] for name in half_um),
        {(name,): value for name, value in half_um.items()},
    )


def test_a_struck_fallback_gives_way_to_the_next_of_its_principle() -> None:
    tried, charges = of(otsu=0.1, circle_caliper=None, contour_match=0.2).run()
    selection = tried.comparison.selection
    assert (selection.chosen, selection.fallback) == (AREA, SPARE)
    assert charges.struck == {("circle_caliper",): OPEN}
    assert charges.chain is not None
    assert charges.fallback is not None
    assert charges.fallback.half_width_um == (0.2, 0.0)


def test_a_struck_chain_costs_the_look_no_fallback() -> None:
    tried, charges = of(otsu=2.0, circle_caliper=0.1, contour_match=0.2).run()
    selection = tried.comparison.selection
    assert (selection.chosen, selection.fallback) == (FINE, SPARE)
    (why,) = charges.struck.values()
    assert why == "2 sigma and the half-width are 2.2 um, tolerance 1 um"


@pytest.mark.parametrize(("half_rad", "stands"), [(0.007, True), (0.009, False)])
def test_an_angle_that_is_needed_has_to_stand_too(
    half_rad: float, stands: bool
) -> None:
    """2 sigma of the trials are .002 rad, of .01."""
    teeth = replace(GEAR, parameters={**GEAR.parameters, **NOTCH})
    case = replace(CASE, tolerance_theta_rad=0.01, target=teeth)
    found = Field((AREA,), {AREA.chain: 0.1})
    turn = AnswerShift(
        pairs=12, freedom=6, mean=np.zeros(1), sigma=np.zeros(1),
        half_width=np.array([half_rad]), interval=np.zeros(1),
    )  # fmt: skip
    (place,) = charge_um(0.1)
    _, charges = charge_chains(
        replace(found.tried, case=case),
        lambda _, chains: {chain: (replace(place, turn=turn),) for chain in chains},
        rejecting,
    )
    need = "" if stands else "2 sigma and the half-width are 0.011 rad"
    assert charges.missed.split(", ")[0] == need


@pytest.mark.parametrize(("own", "is_open"), [(2.0, False), (None, True)])
def test_the_chain_of_a_set_s_feature_stays_or_is_a_fault(
    own: float | None,
    is_open: bool,
) -> None:
    found = of(otsu=own, circle_caliper=None, contour_match=0.2)
    tried, charges = found.run(is_fixed=True)
    assert tried.comparison.selection.chosen == AREA
    assert bool(charges.fault) == is_open
    if not is_open:
        assert tried.comparison.selection.fallback == SPARE
        assert charges.chain is not None


def test_the_chain_of_a_set_s_feature_stays_though_its_rivals_change() -> None:
    """Another is chosen of two that are left: the finer is not half as fine again."""
    cheap, own = a_score("otsu", 0.45, 1.0), a_score("circle_caliper", 0.28, 3.0)
    between = a_score("contour_match", 0.4, 2.0)
    halves = {cheap.chain: None, own.chain: 0.1, between.chain: 0.1}
    found = Field((cheap, between, own), halves)
    assert found.tried.comparison.selection.chosen == own
    left = select(
        (between, own), Constraints(tolerance_um=TOLERANCE_UM, tolerance_theta_rad=None)
    )
    assert left.chosen == between
    tried, charges = found.run(is_fixed=True)
    selection = tried.comparison.selection
    assert (selection.chosen, selection.fallback) == (own, between)
    assert charges.struck == {cheap.chain: OPEN}


def test_of_chains_that_fail_further_trials_none_is_the_nearest() -> None:
    """The one that stands fails in its further trials as the other is struck."""
    found = of(otsu=0.1, circle_caliper=2.0)

    def longer(tried: Evaluation, rejected: Mapping[Chain, str]) -> Evaluation:
        scores = (with_failures(AREA, 5, 0), FINE)
        comparison = replace(tried.comparison, scores=scores)
        return rejecting(replace(tried, comparison=comparison), rejected)

    tried, charges = charge_chains(found.tried, found.charge, longer)
    selection = tried.comparison.selection
    assert (selection.chosen, selection.fallback) == (FINE, None)
    assert charges.missed == "2 sigma and the half-width are 2.1 um, tolerance 1 um"
