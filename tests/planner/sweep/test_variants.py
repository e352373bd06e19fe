"""Settings as text, and their combinations."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.planner.sweep.variants import (
    MOST_ROWS,
    SweepError,
    settings,
    variants,
    written,
)


def test_values_are_read_as_in_the_file() -> None:
    (found,) = settings([("a.b", "1, 2.5,x, [3, 4], {min: 1, max: 2}, no, 'a,b'")])
    assert found.values == (1, 2.5, "x", [3, 4], {"min": 1, "max": 2}, "no", "a,b")


WHOLE = st.integers(-(2**53), 2**53)  # a file's numbers are kept exactly up to these


@given(st.lists(st.lists(WHOLE, min_size=1, max_size=4), min_size=1, max_size=4))
def test_rows_are_every_combination_the_first_key_slowest(
    values: list[list[int]],
) -> None:
    asked = [(f"k{n}", ",".join(map(str, each))) for n, each in enumerate(values)]
    found = variants(settings(asked))
    rows: list[list[int]] = [[]]
    for each in values:
        rows = [[*row, value] for row in rows for value in each]
    assert [list(variant.values.values()) for variant in found] == rows
    assert [variant.row for variant in found] == list(range(1, len(rows) + 1))


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ([("a", "[1")], "never closed"),
        ([("a", "1]")], "not valid YAML"),
        ([("a", ",")], "not valid YAML"),
        ([("a", "&x 1")], "anchor"),
        ([("a", ".nan")], "finite"),
        ([("a", "1"), ("a", "2")], "set twice"),
        ([("a", ",".join(["1"] * 101)), ("b", ",".join(["1"] * 100))], "101 x 100"),
    ],
)
def test_what_cannot_be_swept_is_refused(
    asked: list[tuple[str, str]], said: str
) -> None:
    with pytest.raises(SweepError) as found:
        settings(asked)
    assert found.value.code == "MP730"
    assert said in str(found.value)


def test_as_many_rows_as_allowed_are_allowed() -> None:
    (found,) = settings([("a", ",".join(map(str, range(MOST_ROWS))))])
    assert len(found.values) == MOST_ROWS


def test_a_value_is_written_as_yaml_takes_it() -> None:
    values = [1, 2.5, "x", [3, "y"], {"min": 1}, True, None]
    (found,) = settings([("a", ", ".join(map(written, values)))])
    assert list(found.values) == values
