"""What a fit says of pixels that fit and of those that do not."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines.likelihood.fit_quality import quality

EDGE, FLAT = 400, 3600  # pixels


def pixels() -> tuple[FloatArray, BoolArray, FloatArray]:
    """Return noise at an edge and beside it, all of it clear, and its slopes."""
    rng = np.random.default_rng(5)
    slopes = np.zeros((2, EDGE + FLAT))
    slopes[:, :EDGE] = rng.normal(0, 1, (2, EDGE))
    return rng.normal(0, 1, EDGE + FLAT), np.ones(EDGE + FLAT, dtype=bool), slopes


def test_an_edge_that_is_elsewhere_counts_by_what_it_tells() -> None:
    residual, clear, slopes = pixels()
    residual[: EDGE // 4] = 40.0  # 2.5 % of the pixels
    found = quality(residual, clear, slopes)
    told = (slopes**2).sum(axis=0)
    assert found.used == pytest.approx(1 - told[: EDGE // 4].sum() / told.sum())
    assert found.chi2 == pytest.approx(1.0, abs=0.15)  # by those that fit
    assert found.score < 0.85


def test_dust_beside_the_edge_costs_nothing() -> None:
    residual, clear, slopes = pixels()
    residual[-FLAT // 4 :] = 40.0
    found = quality(residual, clear, slopes)
    assert found.used == 1.0
    assert found.chi2 < 1.6


def test_what_is_cut_off_tells_nothing() -> None:
    residual, clear, slopes = pixels()
    clear[: EDGE // 2] = False
    assert quality(residual, clear, slopes).used == 1.0
    residual[EDGE // 2 : 3 * EDGE // 4] = 40.0
    assert 0.3 < quality(residual, clear, slopes).used < 0.7
    assert quality(residual, clear, 0 * slopes).used == 0.0
    assert quality(residual, 0 * clear > 0, slopes).used == 0.0
