"""Sobol points in groups of axes, and the corners of the two-level design."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from microplan.featuresel.features.factorial_design import (
    GROUPS,
    corner,
    interior,
    words,
)


def test_words_are_those_of_sha256() -> None:
    assert words("")[0] == 0xE3B0C442  # sha256 of nothing
    assert len(words("x")) == 8


def test_groups_take_dimensions_of_their_own() -> None:
    taken = [axis for first, end in GROUPS.values() for axis in range(first, end)]
    assert taken == list(range(17))


@pytest.mark.parametrize("group", GROUPS)
def test_a_point_does_not_depend_on_the_count(group: str) -> None:
    many = interior(group, "key", 3, 200)
    for count in (1, 2, 33, 128):
        few = interior(group, "key", 3, count)
        assert len(few) >= count
        np.testing.assert_array_equal(few[:count], many[:count])


def test_all_groups_together_are_even_in_every_pair_of_axes() -> None:
    count = 256
    points = np.hstack([interior(group, "key", 3, count) for group in GROUPS])
    for a, b in itertools.combinations(range(points.shape[1]), 2):
        cells = np.floor(4 * points[:, [a, b]]).astype(int)
        found = np.bincount(4 * cells[:, 0] + cells[:, 1], minlength=16)
        # 16 in each of 16 cells. Random points would leave it by up to 4 sigma = 16;
        # axes that share a dimension of the sequence leave half of the cells empty
        assert 8 <= found.min() <= found.max() <= 24


def test_corners_balance_each_axis_and_separate_it_from_pairs_of_others() -> None:
    signs = np.array([corner(turn) for turn in range(32)])
    assert corner(32) == corner(0)
    np.testing.assert_array_equal(signs.sum(axis=0), 0)
    np.testing.assert_array_equal(signs.T @ signs, 32 * np.eye(16))
    for a, b in itertools.combinations(range(16), 2):
        np.testing.assert_array_equal(signs.T @ (signs[:, a] * signs[:, b]), 0)
