"""The choice of a set of features: the best of all, or near it, and with reasons."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.selection.feature_sets import log_det
from microplan.featuresel.sets.feature_set import MARGIN, SetSearch, choose_set
from microplan.featuresel.sets.pose_covariance import (
    FeatureMeasurement,
    PoseRequirement,
    known,
)

LOOSE = PoseRequirement(sigma_um=1.0, sigma_theta_rad=0.1, radius_um=50.0)


def point(name: str, x: float, y: float, sigma: float = 0.1) -> FeatureMeasurement:
    return FeatureMeasurement(name=name, x_um=x, y_um=y, sigma_um=sigma, cost=1.0)


def square(sigma: float = 0.1) -> list[FeatureMeasurement]:
    corners = ((-40, -40), (40, -40), (40, 40), (-40, 40))
    return [point(f"p{k}", x, y, sigma) for k, (x, y) in enumerate(corners)]


def random_sights(rng: np.random.Generator, count: int) -> list[FeatureMeasurement]:
    """Return points, edges and features with an angle, costs all one."""
    found = []
    for k in range(count):
        x, y = rng.uniform(-50, 50, 2)
        sigma = float(np.exp(rng.uniform(-4, 0)))
        axis = float(rng.uniform(0, math.pi)) if rng.random() < 0.4 else None
        theta = float(np.exp(rng.uniform(-6, -2))) if rng.random() < 0.2 else None
        found.append(
            FeatureMeasurement(name=f"f{k:02}", x_um=x, y_um=y, sigma_um=sigma,
                               axis_rad=axis, sigma_theta_rad=theta, cost=1.0)
        )  # fmt: skip
    return found


def test_greedy_with_exchange_is_as_good_as_trying_all() -> None:
    rng = np.random.default_rng(8)
    equal, problems = 0, 150
    for k in range(problems):
        measured = random_sights(rng, 8)
        need = replace(LOOSE, sigma_theta_rad=0.1 if k % 3 else None)
        size = 2 + k % 3
        taken = SetSearch.of(measured, need).best_of(size)
        told = log_det([measured[i] for i in taken], need)
        best = max(
            log_det(some, need) for some in itertools.combinations(measured, size)
        )
        equal += told >= best - MARGIN
    assert equal == problems


def test_the_smallest_set_that_is_good_enough_wins() -> None:
    measured = square()
    alone = choose_set(measured, replace(LOOSE, redundant=False, sigma_theta_rad=None))
    assert alone.qualifies is False or len(alone.names) > 1  # the arm spoils one
    centre = [*square(), point("middle", 0, 0)]
    need = replace(LOOSE, redundant=False, sigma_theta_rad=None)
    assert choose_set(centre, need).names == ("middle",)
    both = choose_set(centre, replace(need, sigma_theta_rad=0.1))
    assert len(both.names) == 2
    assert both.qualifies


def test_redundancy_holds_with_any_feature_dropped() -> None:
    found = choose_set(square(), LOOSE)
    assert found.qualifies
    assert len(found.names) == 3
    by_name = {measurement.name: measurement for measurement in square()}
    for out in found.names:
        rest = [by_name[name] for name in found.names if name != out]
        left = known(rest, LOOSE)
        assert left.sigma_um <= found.dropped_um <= LOOSE.sigma_um
        assert left.sigma_theta_rad <= found.dropped_theta_rad <= 0.1
    without = choose_set(square(), replace(LOOSE, redundant=False))
    assert len(without.names) == 2


def test_an_ill_conditioned_set_is_refused() -> None:
    near = [point("a", 0, 0), point("b", 0.5, 0), point("c", 0, 0.5)]
    need = PoseRequirement(
        sigma_um=10, sigma_theta_rad=3, radius_um=50.0, redundant=False
    )
    found = choose_set(near, need)
    assert not found.qualifies
    assert found.known.conditioning > need.conditioning
    assert any(words.startswith("conditioning up to") for words in found.relaxations)
    far = choose_set([*near, point("d", 45, 0)], need)
    assert far.qualifies
    assert "d" in far.names
    assert far.known.conditioning <= need.conditioning


def test_among_equals_the_cheaper_then_the_first_by_name() -> None:
    need = replace(LOOSE, redundant=False, sigma_theta_rad=None)
    same = [point("b", 0, 0), point("a", 0, 0)]
    assert choose_set(same, need).names == ("a",)
    cheap = [point("a", 0, 0), replace(point("b", 0, 0), cost=0.5)]
    assert choose_set(cheap, need).names == ("b",)
    slight = [point("a", 0, 0, 0.1 * 0.997), replace(point("b", 0, 0), cost=0.5)]
    assert choose_set(slight, need).names == ("b",)  # .3 % better is no reason
    for order in itertools.permutations(square()):
        assert choose_set(order, LOOSE).names == choose_set(square(), LOOSE).names


def test_every_feature_has_its_reason() -> None:
    measured = [
        *square(),
        point("blind", 0, 0, math.inf),
        point("rough", 0, 9, 5.0),
    ]
    found = choose_set(measured, LOOSE)
    reasons = dict(found.reasons)
    assert list(reasons) == [measurement.name for measurement in measured]
    for name in found.names:
        assert reasons[name].startswith("taken: without it sigma is ")
    assert reasons["blind"] == "left out: it tells nothing of the pose"
    assert reasons["rough"].startswith("left out: with it sigma is ")
    full = choose_set(measured, replace(LOOSE, most=3))
    spare = next(s.name for s in square() if s.name not in full.names)
    assert "in place of p" in dict(full.reasons)[spare]


@pytest.mark.parametrize(
    ("measured", "need", "words"),
    [
        ([point("one", 0, 0)], LOOSE, "a feature that tells the angle"),
        (
            [point("one", 0, 0), point("two", 0, 0)],
            LOOSE,
            "a feature that tells the angle",
        ),
        (
            [replace(point(f"e{y}", 0, y), axis_rad=0.0) for y in (-30, 0, 30)],
            LOOSE,
            "other direction of the place",
        ),
        (square(3.0), LOOSE, "sigma up to"),
        (square()[:2], LOOSE, "a set that needs all its features"),
        (square(1.2), replace(LOOSE, most=2), "up to 4 features"),
    ],
)
def test_when_nothing_qualifies_what_would_is_said(
    measured: Sequence[FeatureMeasurement], need: PoseRequirement, words: str
) -> None:
    found = choose_set(measured, need)
    assert not found.qualifies
    assert any(words in relaxation for relaxation in found.relaxations)


def test_a_stated_relaxation_is_enough() -> None:
    found = choose_set(square(3.0), replace(LOOSE, redundant=False))
    words = next(w for w in found.relaxations if w.startswith("sigma up to"))
    enough = float(words.split()[3]) * 1.01  # said with three digits
    assert choose_set(
        square(3.0), replace(LOOSE, redundant=False, sigma_um=enough)
    ).qualifies


def test_extremes_are_no_nan() -> None:
    for sigma in (0.0, 1e-9, 1e6, math.inf):
        for count in (1, 2, 4):
            found = choose_set(square(sigma)[:count], LOOSE)
            numbers = [*itertools.chain(*found.known.covariance), found.dropped_um]
            assert not any(map(math.isnan, numbers))
            assert found.qualifies == (sigma < 1 and count == 4)


def test_nonsense_is_an_error() -> None:
    with pytest.raises(ValueError, match="names that differ"):
        choose_set([], LOOSE)
    with pytest.raises(ValueError, match="names that differ"):
        choose_set([point("a", 0, 0)] * 2, LOOSE)
    with pytest.raises(ValueError, match="positive"):
        replace(LOOSE, sigma_um=math.nan)
    with pytest.raises(ValueError, match=">= 1"):
        replace(LOOSE, most=0)
