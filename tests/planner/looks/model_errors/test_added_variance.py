"""What errors of images change of a variance, by draws of what answers may do."""

from __future__ import annotations

import math

import numpy as np
import pytest

from microplan.planner.looks.model_errors.added_variance import (
    Changes,
    PosedChange,
    added_variance,
)
from microplan.planner.looks.model_errors.used_poses import LEAST

USUAL = 0.2  # standard deviation of answers on usual images, um


def changes(at: np.ndarray, usual: np.ndarray, other: np.ndarray) -> Changes:
    """Return what other answers change of usual ones."""
    rest = (other - usual) - (other - usual).mean(axis=0)
    rows = zip(at, usual, rest, strict=True)
    return {
        k: PosedChange(at_um=a, error=e, change=d) for k, (a, e, d) in enumerate(rows)
    }


def draws(count: int, seed: int = 7) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return displacements, errors of usual answers, and fresh ones as large as 1."""
    rng = np.random.default_rng(seed)
    at, usual, fresh = (rng.normal(0, s, (count, n))
                        for s, n in ((1, 3), (USUAL, 2), (1, 2)))  # fmt: skip
    return at, usual, fresh


@pytest.mark.parametrize(
    ("kept", "own"), [(0.0, 0.2), (0.5, 0.2), (1.0, 0.1), (0.7, 0.0), (0.0, 0.1)]
)
def test_answers_that_err_otherwise_change_the_variance_by_their_own(
    kept: float, own: float
) -> None:
    """A share of the usual error is kept on the other image, the rest is new."""
    at, usual, fresh = draws(4000)
    found = added_variance([changes(at, usual, kept * usual + own * fresh)])
    more = (kept * USUAL) ** 2 + own**2 - USUAL**2
    assert found is not None
    np.testing.assert_allclose(found, more, atol=6 * USUAL**2 / math.sqrt(4000))


def test_what_follows_place_and_focus_counts_whatever_answers_err_besides() -> None:
    at, usual, fresh = draws(4000)
    slope = np.array([[0.1, 0.0], [0.0, 0.0], [0.0, 0.3]])
    found = added_variance([changes(at, usual, at @ slope + USUAL * fresh)])
    assert found is not None
    np.testing.assert_allclose(np.sqrt(found), [0.1, 0.3], atol=0.03)


def test_effects_that_cancel_each_other_add_nothing() -> None:
    at, usual, fresh = draws(50)
    one, other = (changes(at, usual, usual + sign * fresh) for sign in (1, -1))
    found = added_variance([one, other])
    assert found is not None
    np.testing.assert_allclose(found, 0.0, atol=1e-8)


@pytest.mark.parametrize(
    ("kept", "own"), [(0.3, 0.2), (1.0, 0.2), (1.0, 0.1), (0.0, 0.2), (0.5, 0.0)]
)
def test_the_variance_of_twelve_pairs_is_right_in_the_mean_or_larger(
    kept: float, own: float
) -> None:
    found = []
    for seed in range(400):
        at, usual, fresh = draws(LEAST, seed)
        part = added_variance([changes(at, usual, kept * usual + own * fresh)])
        assert part is not None
        found.append(part)
    more = (kept * USUAL) ** 2 + own**2 - USUAL**2
    noise = 4 * np.std(found) / math.sqrt(2 * len(found))
    assert more - noise < np.mean(found) < more + 0.6 * USUAL**2


def test_too_few_common_poses_say_nothing() -> None:
    at, usual, fresh = draws(2 * LEAST)
    whole = changes(at, usual, fresh)
    few = {k: each for k, each in whole.items() if k < LEAST - 1}
    late = {k: each for k, each in whole.items() if k >= LEAST}
    assert added_variance([whole, few]) is None
    assert added_variance([few, late]) is None
    assert added_variance([whole, late]) is not None
