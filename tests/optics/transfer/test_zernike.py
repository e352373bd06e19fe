"""Zernike polynomials are Noll's: orthonormal over the disc, with his names."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.optics.transfer.zernike import MOST, terms_on_grid, zernike


def disc() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, y and weights of a rule for polynomials over the disc, sum 1."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    squares, turns = (nodes + 1) / 2, 2 * np.pi * np.arange(24) / 24
    radius = np.sqrt(squares)[:, None]
    share = (weights / 2)[:, None] * np.full(24, 1 / 24)
    return radius * np.cos(turns), radius * np.sin(turns), share


def test_they_are_orthonormal_over_the_disc() -> None:
    x, y, share = disc()
    each = np.array([zernike(noll, x, y) for noll in range(1, MOST + 1)])
    found = np.einsum("aij,bij,ij->ab", each, each, share)
    np.testing.assert_allclose(found, np.eye(MOST), atol=1e-12)


@pytest.mark.parametrize(
    ("noll", "at", "value"),
    [
        (2, (0.5, 0.3), 2 * 0.5),
        (3, (0.5, 0.3), 2 * 0.3),
        (4, (0.6, 0.0), np.sqrt(3) * (2 * 0.36 - 1)),
        (5, (0.5, 0.4), np.sqrt(6) * 2 * 0.5 * 0.4),
        (6, (0.5, 0.4), np.sqrt(6) * (0.25 - 0.16)),
        (7, (0.0, 0.7), np.sqrt(8) * (3 * 0.343 - 1.4)),
        (8, (0.7, 0.0), np.sqrt(8) * (3 * 0.343 - 1.4)),
        (10, (1.0, 0.0), np.sqrt(8)),
        (11, (0.6, 0.0), np.sqrt(5) * (6 * 0.6**4 - 6 * 0.36 + 1)),
        (22, (0.0, 1.0), np.sqrt(7)),
    ],
)
def test_they_are_nolls_table(noll: int, at: tuple[float, float], value: float) -> None:
    """Noll (1976), table I, in x = r cos(theta) and y = r sin(theta)."""
    found = zernike(noll, np.array(at[0]), np.array(at[1]))
    assert float(found) == pytest.approx(value, abs=1e-12)


def test_a_sum_on_a_grid_is_the_sum_at_its_points() -> None:
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-1.1, 1.1, 9), rng.uniform(-1.1, 1.1, 7)
    terms = [(noll, float(rng.normal())) for noll in range(1, MOST + 1)]
    at = np.meshgrid(x, y)
    expected = sum(waves * zernike(noll, *at) for noll, waves in terms)
    np.testing.assert_allclose(terms_on_grid(terms, x, y), expected, atol=1e-11)
    assert not terms_on_grid((), x, y).any()


@pytest.mark.parametrize("noll", [0, MOST + 1, -3])
def test_an_index_out_of_range_is_refused(noll: int) -> None:
    with pytest.raises(ValueError, match=r"noll must be in 1\.\.22"):
        zernike(noll, np.zeros(1), np.zeros(1))
