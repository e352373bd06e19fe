from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.localisation.information import only, together, without
from microplan.arrays import FloatArray
from microplan.featuresel.limits.information import (
    Information,
    covariance,
    inverse,
    limit,
)


def of(slopes: FloatArray, *names: str, faked: float = 0.0) -> Information:
    """Return what rows of slopes tell with noise of 1."""
    names = names or tuple("abcdefgh")[: len(slopes)]
    return Information(
        names=names, matrix=slopes @ slopes.T, faked=np.full(len(slopes), faked)
    )


def drawn(seed: int, count: int, pixels: int = 40) -> FloatArray:
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-6, 6, (count, 1))
    return np.asarray(scale * rng.standard_normal((count, pixels)))


SEEDS = st.integers(0, 2**32 - 1)


@given(seed=SEEDS, count=st.integers(1, 7))
def test_bound_of_a_regular_matrix_is_its_inverse(seed: int, count: int) -> None:
    told = of(drawn(seed, count))
    expected = np.linalg.inv(told.matrix)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(covariance(told) / scale, expected / scale, atol=1e-8)


@given(seed=SEEDS, count=st.integers(2, 6))
def test_more_images_never_make_a_limit_worse(seed: int, count: int) -> None:
    one, two = of(drawn(seed, count)), of(drawn(seed + 1, count))
    alone, both = limit(one), limit(together(one, two))
    assert all(both[name] <= alone[name] * (1 + 1e-9) for name in one.names)


@given(seed=SEEDS)
def test_fewer_unknowns_never_make_a_limit_worse(seed: int) -> None:
    told = of(drawn(seed, 5))
    fewer = limit(only(told, "abc"))
    assert all(fewer[name] <= limit(told)[name] * (1 + 1e-9) for name in "abc")


@given(seed=SEEDS)
def test_leaving_names_unknown_changes_no_other_limit(seed: int) -> None:
    told = of(drawn(seed, 5))
    rest = limit(without(told, "be"))
    assert set(rest) == set("acd")
    for name, sigma in rest.items():
        assert sigma == pytest.approx(limit(told)[name], rel=1e-6)


@given(seed=SEEDS)
def test_a_blind_parameter_does_not_poison_others(seed: int) -> None:
    slopes = drawn(seed, 4)
    slopes[1] = 0.0
    sigmas = limit(of(slopes))
    assert sigmas["b"] == math.inf
    rest = limit(of(slopes[[0, 2, 3]], "a", "c", "d"))
    assert {name: sigmas[name] for name in "acd"} == pytest.approx(rest)


@given(seed=SEEDS)
def test_parameters_that_cannot_be_told_apart_are_not_observable(seed: int) -> None:
    slopes = drawn(seed, 4)
    slopes[3] = slopes[0] / slopes[0].std() - 2 * slopes[2] / slopes[2].std()
    sigmas = limit(of(slopes))
    assert sigmas["a"] == sigmas["c"] == sigmas["d"] == math.inf
    known = limit(of(slopes[:3]))["b"]  # a and c span all that d can do
    assert sigmas["b"] == pytest.approx(known, rel=1e-6)


@given(seed=SEEDS)
def test_slopes_made_of_errors_are_blind(seed: int) -> None:
    rng = np.random.default_rng(seed)
    slopes = rng.standard_normal((3, 400))
    slopes[2] *= 1e-6  # what rounding leaves of a slope that is 0
    faked = np.array([0.0, 0.0, (slopes[2] ** 2).sum()])
    told = Information(names=("x", "y", "theta"), matrix=slopes @ slopes.T, faked=faked)
    sigmas = limit(told)
    assert sigmas["theta"] == math.inf
    assert sigmas["x"] == pytest.approx(1 / 20, rel=0.2)  # 1 / sqrt(400)


@given(seed=SEEDS)
def test_parameters_apart_by_less_than_their_errors_are_not_told_apart(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    slopes = rng.standard_normal((2, 400))
    slopes[1] = slopes[0] + 1e-4 * slopes[1]
    matrix = slopes @ slopes.T
    unsure, sure = (
        Information(names=("x", "y"), matrix=matrix, faked=share**2 * np.diag(matrix))
        for share in (1e-4, 1e-6)
    )
    assert limit(unsure) == {"x": math.inf, "y": math.inf}
    assert max(limit(sure).values()) < math.inf


def test_a_prior_makes_a_blind_parameter_known() -> None:
    told = of(np.array([[1.0, 0.0, 2.0], [0.0, 0.0, 0.0]]))
    known = limit(told.with_prior({"b": 0.5}))
    assert known == pytest.approx({"a": 1 / math.sqrt(5), "b": 0.5})
    with pytest.raises(ValueError, match="prior of b"):
        told.with_prior({"b": 0.0})


def test_names_of_several_images_are_joined() -> None:
    slopes = np.eye(2)
    both = together(of(slopes, "z", "gain"), of(3 * slopes, "z", "x"))
    assert both.names == ("z", "gain", "x")
    np.testing.assert_array_equal(np.diag(both.matrix), (10, 1, 9))


def test_nothing_at_all_tells_nothing() -> None:
    told = of(np.zeros((2, 5)))
    assert limit(told) == {"a": math.inf, "b": math.inf}
    assert (inverse(told)[0] == 0).all()
    assert limit(of(np.zeros((0, 5)))) == {}
    assert limit(without(told, ("a",))) == {"b": math.inf}


def test_missing_names_and_wrong_shapes_are_refused() -> None:
    told = of(np.eye(2))
    for call in (only, without):
        with pytest.raises(KeyError, match="zoom"):
            call(told, ("zoom",))
    with pytest.raises(ValueError, match="matrix must be"):
        Information(names=("x",), matrix=np.eye(2), faked=np.zeros(1))
    with pytest.raises(ValueError, match="finite"):
        Information(names=("x",), matrix=np.full((1, 1), np.nan), faked=np.zeros(1))
