"""Half-widths of costs by draws, and costs of several effects and features."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from microplan.planner.looks.model_errors.answer_shift import AnswerShift, difference
from microplan.planner.looks.model_errors.better_models import BetterModel
from microplan.planner.looks.model_errors.combined_costs import (
    of_either,
    together_cost,
)
from microplan.planner.looks.model_errors.model_cost import (
    EffectDifference,
    model_cost,
)
from microplan.planner.looks.model_errors.used_poses import LEAST
from microplan.schemas.plan import ModelCost

ONE = ModelCost(
    pairs=12, freedom=6, bias_um=(0.1, -0.2), half_width_um=(0.05, 0.02),
    interval_um=(0.01, 0.0), sigma_um=(0.03, 0.04), bias_theta_rad=1e-3,
    half_width_theta_rad=2e-3, interval_theta_rad=0.0, sigma_theta_rad=3e-3,
    spread_um=(0.05, 0.06), spread_theta_rad=4e-3,
)  # fmt: skip


def poses(values: np.ndarray) -> dict[int, np.ndarray]:
    return dict(enumerate(values))


def no_errors(ends: Sequence[Mapping[int, np.ndarray]]) -> list[dict[int, np.ndarray]]:
    """Return usual answers that are all right."""
    return [{k: np.zeros_like(each) for k, each in end.items()} for end in ends]


def mirrored(rng: np.random.Generator, count: int = LEAST) -> np.ndarray:
    half = rng.normal(0, 1, (count // 2, 2))
    return np.stack([half, -half], axis=1).reshape(count, 2)


@pytest.mark.parametrize("ends", [1, 2])
def test_the_half_width_holds_the_mean_as_often_as_it_says(ends: int) -> None:
    """Of noise beside an error that changes its sign with the displacement."""
    rng, runs, held = np.random.default_rng(11), 400, 0
    for _ in range(runs):
        values, at = [], []
        for mean in (0.7, -0.2)[:ends]:
            where = mirrored(rng, LEAST // ends)
            noise = rng.normal(0, 0.3, (len(where), 1))
            values.append(poses(mean + 2 * where[:, :1] + noise))
            at.append(poses(where))
        found = difference(values, at, no_errors(values), is_apart=ends > 1)
        truth = np.mean((0.7, -0.2)[:ends])
        held += bool(abs(found.mean[0] - truth) <= found.half_width[0])
    # 95 % of one end; of two an interval's half besides, so never less
    least = 0.95 - 4 * math.sqrt(0.95 * 0.05 / runs)
    assert held / runs >= least
    assert ends > 1 or held / runs <= 0.95 + 4 * math.sqrt(0.95 * 0.05 / runs)


def test_an_error_that_changes_its_sign_has_a_spread_and_no_bias() -> None:
    """A wall's: 0 where all is concentric, .4 um at 1.45 um."""
    where = mirrored(np.random.default_rng(2))
    values = 0.4 / 1.45 * where
    ends = [poses(values)]
    found = difference(ends, [poses(where)], no_errors(ends), is_apart=False)
    assert np.abs(found.mean).max() < 1e-12
    assert found.half_width.max() < 1e-12
    np.testing.assert_allclose(found.sigma, values.std(axis=0, ddof=1))


def test_without_any_displacement_the_half_width_is_student_s() -> None:
    values = np.random.default_rng(3).normal(0, 1, (LEAST, 1))
    still = poses(np.zeros((LEAST, 2)))
    ends = [poses(values)]
    found = difference(ends, [still], no_errors(ends), is_apart=False)
    assert found.freedom == LEAST - 1
    expected = 2.200985 * values.std(ddof=1) / math.sqrt(LEAST)  # t of 11, a table's
    assert found.half_width[0] == pytest.approx(expected, rel=1e-6)


def test_an_end_of_too_few_poses_is_refused() -> None:
    few = poses(np.zeros((LEAST // 2 - 1, 2)))
    with pytest.raises(ValueError, match="6 poses at least"):
        difference([few], [few], [few], is_apart=False)


def effect(mean: float, sigma: float) -> EffectDifference:
    pair = np.array([mean, -mean])
    flat = np.abs(pair)
    place = AnswerShift(
        pairs=12, freedom=9, mean=pair, half_width=flat / 2, interval=flat / 4,
        sigma=np.array([sigma, sigma]),
    )  # fmt: skip
    return EffectDifference(
        model=BetterModel(effects=("x",), by="x", ends=()), place=place, turn=None,
        image_error=0.0,
    )  # fmt: skip


def tried_at(count: int, size: float, seed: int) -> EffectDifference:
    """Return an effect that changes answers by noise, at so many poses."""
    rng = np.random.default_rng(seed)
    ends = [poses(rng.normal(0, size, (count, 2)))]
    still = [poses(np.zeros((count, 3)))]
    place = difference(ends, still, no_errors(ends), is_apart=False)
    return replace(effect(0.0, 0.0), place=place)


def test_what_went_on_keeps_all_its_poses_beside_what_did_not() -> None:
    big, other = tried_at(48, 0.2, 1), tried_at(48, 0.1, 2)
    small = tried_at(LEAST, 0.01, 3)
    (alone, pair, little, both) = (
        model_cost(some) for some in ([big], [big, other], [small], [big, small])
    )
    assert alone and pair and little and both  # noqa: PT018 - none is missing
    for k in range(2):
        own = np.array([each.sigma_um[k] for each in (alone, little)])
        assert own[0] == pytest.approx(0.2, rel=0.3)
        assert both.sigma_um[k] == pytest.approx(own.sum())
        # independent ones at the same poses add up in squares
        assert pair.sigma_um[k] == pytest.approx(math.hypot(0.2, 0.1), rel=0.3)


def test_effects_add_up_linearly() -> None:
    """They are of the same poses: no root of squares."""
    found = model_cost([effect(0.2, 0.03), effect(0.1, 0.04)])
    assert found is not None
    assert found.bias_um == pytest.approx((0.3, -0.3))
    assert found.half_width_um == pytest.approx((0.15, 0.15))
    assert found.sigma_um == pytest.approx((0.07, 0.07))
    assert found.bias_theta_rad is None
    assert model_cost([]) is None


def test_a_fallback_s_wider_half_width_counts_and_its_bias_does_not() -> None:
    other = replace(ONE, bias_um=(9.0, 9.0), half_width_um=(0.01, 0.3))
    found = of_either(ONE, other)
    assert found is not None
    assert (found.bias_um, found.half_width_um) == (ONE.bias_um, (0.05, 0.3))
    assert of_either(ONE, None) == ONE
    assert of_either(None, ONE) is None


def test_a_chain_and_its_fallback_are_both_spared_only_what_each_is() -> None:
    spared = replace(ONE, spared_um=(0.02, 0.01))
    other = replace(spared, spared_um=(0.01, 0.03))
    found = of_either(spared, other)
    assert found is not None
    assert found.spared_um == (0.01, 0.01)


def test_a_set_errs_by_no_more_than_its_worst_feature() -> None:
    """Any weights of two features' errors, drawn within their half-widths."""
    other = replace(ONE, half_width_um=(0.01, 0.09))
    found = together_cost([ONE, other], 50.0)
    assert found is not None
    rng = np.random.default_rng(4)
    errors = rng.uniform(-1, 1, (1000, 2, 2))
    errors *= np.array([ONE.half_width_um, other.half_width_um])
    share = rng.uniform(0, 1, (1000, 1))
    place = share * errors[:, 0] + (1 - share) * errors[:, 1]
    assert np.abs(place).max() <= found.half_width_um[0] == 0.09
    turn = np.abs(errors[:, 0] - errors[:, 1]).max() / 50.0
    assert found.half_width_theta_rad is not None
    assert turn <= found.half_width_theta_rad
    assert together_cost([None], 1.0) is None


def test_what_trials_draw_is_in_no_bias_and_no_sigma_again() -> None:
    """Only the lower bound has it besides, at its worst."""
    rng, where = np.random.default_rng(4), mirrored(np.random.default_rng(5))
    found = []
    for is_drawn in (False, True):
        values = [poses(mean + rng.normal(0, 0.1, (LEAST, 2))) for mean in (0.2, 0.6)]
        at = [poses(where)] * 2
        place = difference(values, at, no_errors(values), is_apart=False)
        model = BetterModel(effects=("a",), by="b", ends=(), is_drawn=is_drawn)
        found.append(
            EffectDifference(model=model, place=place, turn=None, image_error=0.1)
        )
    paid, drawn = found
    both, alone = model_cost(found), model_cost([paid])
    assert both is not None
    assert alone is not None
    assert replace(both, drawn_um=(0.0, 0.0), pairs=0, freedom=0) == replace(
        alone, pairs=0, freedom=0
    )
    assert both.drawn_um == pytest.approx(tuple(drawn.place.half_width))
    assert min(both.drawn_um) > 0.2  # half of what the ends differ by
    assert alone.drawn_um == (0.0, 0.0)
    assert drawn.cost.bias_um == drawn.cost.sigma_um == (0.0, 0.0)
    assert drawn.cost.half_width_um == both.drawn_um
    assert of_either(alone, both) == replace(alone, drawn_um=both.drawn_um)
    together = together_cost([both, alone], 50.0)
    assert together is not None
    assert together.drawn_um == (max(both.drawn_um),) * 2


def test_an_interval_adds_what_its_worse_end_does() -> None:
    """Ends that follow the place to either side: their middle does not move."""
    where = mirrored(np.random.default_rng(8))
    at = [poses(where)] * 2
    ends = [poses(0.4 * where), poses(-0.1 * where)]
    place = difference(ends, at, no_errors(ends), is_apart=False)
    model = BetterModel(effects=("a",), by="b", ends=())
    cost = model_cost(
        [EffectDifference(model=model, place=place, turn=None, image_error=0.1)]
    )
    assert cost is not None
    np.testing.assert_allclose(cost.sigma_um, 0.4 * where.std(axis=0, ddof=1))


def test_effects_are_added_pose_by_pose_their_spreads_at_most() -> None:
    rng, where = np.random.default_rng(9), mirrored(np.random.default_rng(9))
    one, other = rng.normal(0, 0.1, (2, LEAST, 2))
    effects = []
    for values in (one, other - one):
        ends = [poses(values)]
        place = difference(ends, [poses(where)], no_errors(ends), is_apart=False)
        model = BetterModel(effects=("a",), by="b", ends=())
        effects.append(
            EffectDifference(model=model, place=place, turn=None, image_error=0.1)
        )
    cost = model_cost(effects)
    assert cost is not None
    assert cost.spread_um == pytest.approx(
        tuple(np.sum([each.place.sigma for each in effects], axis=0))
    )
    np.testing.assert_allclose(cost.sigma_um, other.std(axis=0, ddof=1), rtol=0.25)


def test_noise_that_better_images_have_not_is_spared() -> None:
    """Usual answers with noise of their own: the better ones are without it."""
    rng, where = np.random.default_rng(10), mirrored(np.random.default_rng(9), 400)
    noise, kept = rng.normal(0, 0.3, (400, 2)), rng.normal(0, 0.4, (400, 2))
    place = difference(
        [poses(-noise)], [poses(where)], [poses(kept + noise)], is_apart=False
    )
    model = BetterModel(effects=("a",), by="b", ends=())
    cost = model_cost(
        [EffectDifference(model=model, place=place, turn=None, image_error=0.1)]
    )
    assert cost is not None
    assert cost.sigma_um == (0.0, 0.0)
    error = math.sqrt(2 / 400) * 0.5**2  # of the variance of the usual answers
    assert min(cost.spared_um) ** 2 == pytest.approx(0.3**2, abs=4 * error)
    assert cost.charged_um(0.5) == pytest.approx(0.4, abs=4 * error / 0.8)


@pytest.mark.parametrize(
    ("added", "spared", "sigma"),
    [
        ((0.0, 0.3), (0.4, 0.0), math.sqrt(0.5**2 + 0.3**2)),  # one axis is worse
        ((0.0, 0.0), (0.3, 0.4), math.sqrt(0.5**2 - 0.3**2)),
        ((0.0, 0.0), (9.0, 9.0), 0.25),  # half of it at least
    ],
)
def test_sigma_is_charged_by_its_worse_axis(
    added: tuple[float, float], spared: tuple[float, float], sigma: float
) -> None:
    cost = replace(ONE, sigma_um=added, spared_um=spared)
    assert cost.charged_um(0.5) == pytest.approx(sigma)
    assert cost.charged_um(math.inf) == math.inf


def test_nothing_of_the_trueness_is_spared() -> None:
    """Pairs of images have no discrepancy: what real pictures add they cannot take."""
    cost = replace(ONE, sigma_um=(0.0, 0.0), spared_um=(9.0, 9.0))
    assert cost.charged_um(0.05, 0.04) == pytest.approx(math.hypot(0.03 / 2, 0.04))
    assert cost.charged_um(0.05, 0.05) == pytest.approx(0.05)
    for sigma_um, true_um in ((0.05, 0.04), (0.05, 0.0), (0.05, 0.05)):
        charged_um = cost.charged_um(sigma_um, true_um)
        assert cost.trials_um(charged_um, true_um) == pytest.approx(sigma_um)
