"""Numbers that are equal but for noise are decided by declared order."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.optics.outline.tolerant_order import (
    MARGIN,
    above,
    at_most,
    least,
    ordered,
    same,
)

NOISE = 1e-9  # relative; a thousandth of the margin


def noisy(values: list[float], rng: np.random.Generator) -> list[float]:
    return [v * (1 + NOISE * rng.uniform(-1, 1)) for v in values]


@given(st.permutations(range(6)), st.integers(0, 99))
def test_equals_keep_the_declared_order_whatever_the_noise(
    places: list[int], seed: int
) -> None:
    exact = [1.0, 1.0, 1.0, 2.0, 2.0, 5.0]
    names = list(places)
    values = dict(enumerate(noisy(exact, np.random.default_rng(seed))))
    found = ordered(names, values.__getitem__)
    wanted = sorted(names, key=lambda name: exact[name])  # stable
    assert found == wanted
    assert least(names, values.__getitem__) == wanted[0]


def test_a_clear_difference_decides() -> None:
    sizes = {"dear": 1 + 3 * MARGIN, "cheap": 1.0}
    assert least(["dear", "cheap"], sizes.__getitem__) == "cheap"
    assert ordered([3.0, 1.0, 2.0], float) == [1.0, 2.0, 3.0]


def test_a_chain_of_small_steps_ends_at_the_margin() -> None:
    """Of a, b, c with gaps below the margin and c beyond it, c is no equal of a."""
    steps = {"c": 1 + 1.2 * MARGIN, "b": 1 + 0.6 * MARGIN, "a": 1.0}
    assert ordered(["c", "b", "a"], steps.__getitem__) == ["b", "a", "c"]
    assert least(["c", "b", "a"], steps.__getitem__) == "b"


def test_a_limit_that_is_met_but_for_noise_is_kept() -> None:
    assert at_most(0.1 + 0.2, 0.3)
    assert above(0.3 + 3 * MARGIN, 0.3)
    assert at_most(1e-9, 0.0, scale=1.0)
    assert above(1e-9, 0.0)


@pytest.mark.parametrize("odd", [math.inf, -math.inf])
def test_infinity_equals_itself_alone(odd: float) -> None:
    assert same(odd, odd)
    assert not same(odd, 1e300)
    assert not same(0.0, odd, scale=1.0)
    assert at_most(odd, odd)


def test_nothing_to_choose_from_is_refused() -> None:
    assert ordered([], float) == []
    with pytest.raises(ValueError, match="empty"):
        least([], float)


def test_what_has_no_size_has_no_place() -> None:
    with pytest.raises(ValueError, match="nan"):
        ordered([1.0, math.nan, 2.0], lambda size: size)
    assert ordered([math.inf, -math.inf, math.inf], lambda s: s)[0] == -math.inf
