"""Transfer functions against high-precision values and the overlap of two pupils."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.arrays import FloatArray
from microplan.optics.transfer.models import MODELS, TABLE_ERROR, tabulate, transfer
from microplan.optics.transfer.otf import (
    diffraction,
    geometric,
    hopkins,
    product,
    stokseth,
)
from tests.optics.shapes import microscope

ENTRIES = json.loads((Path(__file__).parents[1] / "optics_vectors.json").read_text())[
    "entries"
]


def _entries(name: str) -> list[tuple[dict[str, float], float]]:
    return [
        ({k: float(v) for k, v in e["params"].items()}, float(e["value"]))
        for e in ENTRIES
        if e["name"] == name
    ]


def _one(x: float) -> FloatArray:
    return np.array([x])


@pytest.mark.parametrize(("at", "value"), _entries("otf_diffraction"))
def test_diffraction_meets_the_vectors(at: dict[str, float], value: float) -> None:
    # a double holds 1 - 1e-12 to 1.1e-16 only: 1.5 x 1.1e-4 of T, halved by rounding
    rtol = 4e-5 if at["x"] > 0.999999 else 1e-9 if at["x"] > 0.9 else 1e-14
    np.testing.assert_allclose(diffraction(_one(at["x"])), value, rtol=rtol)


@pytest.mark.parametrize(("at", "value"), _entries("otf_defocus_hopkins"))
def test_hopkins_meets_the_vectors(at: dict[str, float], value: float) -> None:
    # the phase 8 pi w x is rounded to 1e-16 of itself: 4e-13 at w = 1000
    atol = 1e-14 if at["w"] <= 100 else 1e-12
    found = hopkins(_one(at["x"]), at["w"])
    np.testing.assert_allclose(found, value, rtol=0, atol=atol)


@pytest.mark.parametrize(("at", "value"), _entries("otf_disk"))
def test_geometric_meets_the_vectors(at: dict[str, float], value: float) -> None:
    found = geometric(_one(at["z"] / (8 * np.pi)), 1.0)
    np.testing.assert_allclose(found, value, rtol=0, atol=1e-15)


@pytest.mark.parametrize(("at", "value"), _entries("edge_spread"))
def test_the_edge_spread_follows_from_hopkins(
    at: dict[str, float], value: float
) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(200)
    v = (1 + nodes) / 2
    x = 1 - v**2  # in v the transfer's (1 - x)**1.5 is smooth
    wave = np.sin(4 * np.pi * x * at["X"]) / (np.pi * x)
    spread = 0.5 + (weights * v * hopkins(x, at["w"]) * wave).sum()
    np.testing.assert_allclose(spread, value, rtol=0, atol=1e-12)


def _overlap(shift: int, w: float, radius: int) -> complex:
    """Correlate a sampled pupil with itself, 2 * shift samples apart."""
    y, x = np.mgrid[-radius : radius + 1, -2 * radius : 2 * radius + 1] / radius
    left, right = x + shift / radius, x - shift / radius
    both = (np.hypot(left, y) <= 1) & (np.hypot(right, y) <= 1)
    phase = 2 * np.pi * w * (left**2 - right**2)
    return complex(np.exp(1j * phase)[both].sum() / (np.pi * radius**2))


@pytest.mark.parametrize("w", [0.0, 0.3, 1.0, 2.5])
def test_hopkins_is_the_overlap_of_two_pupils(w: float) -> None:
    radius = 200  # samples: the rim is off by <= 1 of 2 * radius, hence atol
    shifts = np.arange(0, radius, 20)
    found = np.array([_overlap(int(s), w, radius) for s in shifts])
    expected = hopkins(shifts / radius, w)
    np.testing.assert_allclose(found.real, expected, atol=1 / radius)
    np.testing.assert_allclose(found.imag, 0, atol=1 / radius)


def test_every_law_is_diffraction_in_focus() -> None:
    x = np.linspace(0, 1.2, 301)
    for law in (product, stokseth, hopkins):
        np.testing.assert_allclose(law(x, 0.0), diffraction(x), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(geometric(x, 0.0), np.ones_like(x))


def test_the_product_counts_diffraction_twice() -> None:
    # a quarter of the transfer is lost near w = .35: why it is not the default
    x = np.linspace(0, 1, 201)
    lost = np.abs(product(x, 0.35) - hopkins(x, 0.35)).max()
    assert lost == pytest.approx(0.25, abs=0.01)
    ignored = np.abs(diffraction(x) - hopkins(x, 0.2)).max()
    assert np.abs(product(x, 0.2) - hopkins(x, 0.2)).max() > ignored


@settings(max_examples=60, deadline=None)
@given(st.floats(0, 10), st.floats(-200, 200))
def test_transfers_stay_within_one_and_are_even(x: float, w: float) -> None:
    for law in (geometric, product, stokseth, hopkins):
        value = law(_one(x), w)
        assert np.isfinite(value).all()
        assert np.abs(value).max() <= 1 + 1e-14
        np.testing.assert_allclose(law(_one(-x), -w), value, rtol=0, atol=1e-15)


@pytest.mark.parametrize("x", [0.0, 1e-300, 1e-12, 1 - 1e-16, 1.0, 1e300])
@pytest.mark.parametrize("w", [0.0, 1e-300, 1e-9, 1000.0])
def test_extremes_are_finite(x: float, w: float) -> None:
    for law in (product, stokseth, hopkins):
        assert np.isfinite(law(_one(x), w)).all()
        if x >= 1:
            assert law(_one(x), w) == 0


def test_nan_is_refused() -> None:
    with pytest.raises(ValueError, match="x must not hold nan"):
        diffraction(_one(math.nan))
    for w in (math.nan, math.inf):
        with pytest.raises(ValueError, match="w must be finite"):
            hopkins(_one(0.5), w)


def test_transfer_takes_the_coefficient_of_its_law() -> None:
    m = microscope()
    f = np.linspace(0, m.cutoff_per_um, 50)
    x = f / m.cutoff_per_um
    rim, near = m.rim_w20_um(7) / 0.6, m.paraxial_w20_um(7) / 0.6
    np.testing.assert_array_equal(transfer("hopkins", m, 7, f), hopkins(x, rim))
    np.testing.assert_array_equal(transfer("stokseth", m, 7, f), stokseth(x, rim))
    np.testing.assert_array_equal(transfer("product", m, 7, f), product(x, near))
    np.testing.assert_array_equal(transfer("geometric", m, 7, f), geometric(x, near))


def test_an_unknown_law_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match="geometric, product, stokseth, hopkins"):
        transfer("airy", microscope(), 0.0, np.zeros(1))


@pytest.mark.parametrize("aperture", [0.05, 0.42, 0.95, 0.999])
@pytest.mark.parametrize("z_um", [0.0, 1e-12, 0.3, 2.5, 10.0, 250.0, 1e4, 1e6])
def test_the_table_errs_by_less_than_it_says(aperture: float, z_um: float) -> None:
    m = replace(microscope(), aperture=aperture)
    # where the band is cut at the latest; a table of all of it would be huge
    x_max = min(1.0, 30 / (1 + m.blur_diameter_um(z_um) * m.cutoff_per_um))
    rng = np.random.default_rng(7)
    x = np.concatenate([rng.random(1500), 10 ** rng.uniform(-9, 0, 500)]) * x_max
    for model in MODELS:
        table = tabulate(model, m, z_um, x_max)
        exact = transfer(model, m, z_um, x * m.cutoff_per_um)
        np.testing.assert_allclose(table.read(x), exact, rtol=0, atol=TABLE_ERROR)
