"""Outcomes in rows are those that were written down."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Book, Outcome, Outcomes
from microplan.planner.store.canonical import decode, encode

NUMBERS = st.floats(allow_nan=False) | st.none()
PAIRS = st.tuples(st.floats(allow_nan=False), st.floats(allow_nan=False)) | st.none()
OUTCOMES = st.builds(
    Outcome,
    chain=st.sampled_from([("otsu",), ("ncc",), ("otsu", "circle_caliper")]),
    trial=st.integers(0, 3000),
    failure=st.none() | st.sampled_from(["no_edge", "at_rim"]),
    world_um=PAIRS,
    target_um=PAIRS,
    theta_rad=NUMBERS,
    score=NUMBERS,
    spread_um=NUMBERS,
    spread_theta_rad=NUMBERS,
    axis_rad=NUMBERS,
    depth_um=NUMBERS,
    z_um=NUMBERS,
    zoom=NUMBERS,
)
LISTS = st.lists(OUTCOMES, max_size=12)


def signed(outcomes: list[Outcome]) -> list[str]:
    """Return outcomes with the sign of a zero, which == does not see."""
    return [repr(each) for each in outcomes]


@given(LISTS)
def test_what_is_read_is_what_was_written(written: list[Outcome]) -> None:
    held = Outcomes.of(written)
    assert signed(list(held)) == signed(written)
    assert signed([held[k] for k in range(-len(held), 0)]) == signed(written)
    for copy in (decode(encode(held)), pickle.loads(pickle.dumps(held))):
        assert signed(list(copy)) == signed(written)
    assert list(held[1::2]) == written[1::2]


@given(LISTS, LISTS)
def test_they_add_up_and_part_like_lists(
    one: list[Outcome], two: list[Outcome]
) -> None:
    both = Outcomes.of(one) + Outcomes.of(two)
    assert list(both) == one + two
    assert both == Outcomes.of(one + two)
    assert (Outcomes.of(one) == Outcomes.of(two)) == (one == two)
    for chain in [("ncc",), ("nobody",)]:
        assert list(both.by(chain)) == [o for o in one + two if o.chain == chain]
    failed = [o for o in one + two if o.failure is not None]
    assert list(both.only(lambda o: o.failure is not None)) == failed


@given(LISTS)
def test_a_book_gives_them_by_chain_and_trial(written: list[Outcome]) -> None:
    last: dict[tuple[Chain, int], Outcome] = {(o.chain, o.trial): o for o in written}
    book = Book()
    for outcome in written:
        book.add(outcome)
    assert list(book.pick(reversed(last))) == list(reversed(last.values()))
    assert all(key in book for key in last)
    assert (("ncc",), 3001) not in book
    assert (("nobody",), 0) not in book
    gaps = set(range(3001)) - {trial for chain, trial in last if chain == ("ncc",)}
    assert not any((("ncc",), trial) in book for trial in gaps)
    for missing in [(("ncc",), min(gaps)), (("ncc",), 3001), (("nobody",), 0)]:
        with pytest.raises(KeyError):
            book.pick([missing])


def test_nothing_stays_nothing_and_no_number_becomes_one() -> None:
    empty = Outcome(
        chain=("ncc",), trial=0, failure="no_edge", world_um=None, target_um=None,
        theta_rad=None, score=math.nan, spread_um=math.inf,
    )  # fmt: skip
    (found,) = Outcomes.of([empty])
    assert found.score is not None
    assert math.isnan(found.score)
    assert (found.spread_um, found.theta_rad, found.world_um) == (math.inf, None, None)


def test_an_outcome_takes_nineteen_numbers_once() -> None:
    one = Outcome(
        chain=("ncc",), trial=7, failure=None, world_um=(1.0, 2.0),
        target_um=(2.0, 1.0), theta_rad=0.1, score=0.9, spread_um=0.1,
    )  # fmt: skip
    many = Outcomes.of([one]) + Outcomes.of([one] * 99)
    assert many.rows.nbytes == 100 * 19 * 8
    assert np.array_equal(many.rows[0], many.rows[-1])
    with pytest.raises(IndexError):
        many[100]
