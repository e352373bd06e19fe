"""What real pictures show besides images: its sizes, lengths and draws."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage, special

from microplan.arrays import FloatArray
from microplan.featuresel.look.design import design
from microplan.featuresel.look.discrepancy import (
    Discrepancy,
    contrast,
    drawn,
    edge_steps,
    smooth_field,
)
from microplan.featuresel.look.nominal import nominal_render, target_contrast
from microplan.featuresel.look.perturb import exposed
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.repeatability import from_stops

Look = Callable[[str], LookCase]
SIZE = Discrepancy(edge=0.03, flat=0.01, pixel=0.002, fine_um=4.0, size_um=60.0)
NONE = replace(SIZE, edge=0.0, flat=0.0, pixel=0.0)
DRAWS = 400


def blurred_step(sigma_px: float, shape: tuple[int, int] = (24, 161)) -> FloatArray:
    """Return an edge between .1 and .4 of full scale, in the middle column."""
    across = np.arange(shape[1]) - shape[1] // 2
    share = 0.5 * (1 + special.erf(across / (math.sqrt(2) * sigma_px)))
    return np.tile(0.1 + 0.3 * share, (shape[0], 1))


def draws(image: FloatArray, size: Discrepancy, count: int = DRAWS) -> FloatArray:
    return np.array(
        [drawn(image, size, 1.0, 12.0, np.random.default_rng(k)) for k in range(count)]
    )


@pytest.mark.parametrize("length_px", [2.0, 6.0, 30.0])
def test_a_field_has_its_variance_and_its_length(length_px: float) -> None:
    """Values a field apart are one draw; a covariance errs by 1 / sqrt(draws)."""
    rng, at = np.random.default_rng(4), round(length_px)
    fields = [smooth_field((5, at + 1), length_px, rng) for _ in range(4 * DRAWS)]
    first, last = np.array(fields)[:, 2, [0, -1]].T
    error = 4 / math.sqrt(4 * DRAWS)
    assert np.mean(first**2) == pytest.approx(1.0, abs=error * math.sqrt(2))
    expected = math.exp(-((at / length_px) ** 2) / 2)
    assert np.mean(first * last) == pytest.approx(expected, abs=error * math.sqrt(2))


def test_a_field_of_any_length_has_unit_variance_everywhere() -> None:
    rng = np.random.default_rng(5)
    for length in (0.4, 3.0, 1e4):
        fields = np.array([smooth_field((3, 40), length, rng) for _ in range(DRAWS)])
        found = (fields**2).mean(axis=0)
        np.testing.assert_allclose(found, 1.0, atol=6 * math.sqrt(2 / DRAWS))


@pytest.mark.parametrize("sigma_px", [0.5, 1.5, 3.0])
def test_an_edge_has_its_step_in_the_middle_whatever_its_blur(sigma_px: float) -> None:
    steps = edge_steps(blurred_step(sigma_px), 12.0)
    middle = steps.shape[1] // 2
    assert steps[:, middle] == pytest.approx(0.3, rel=2e-4)  # 12 px: 4 sigma and more
    assert steps[:, [0, middle - 30, middle + 30, -1]].max() < 1e-4
    assert steps.min() >= 0


def test_an_even_picture_has_no_edges() -> None:
    assert not edge_steps(np.full((9, 9), 0.3), 2.0).any()


@pytest.mark.parametrize("name", ["edge", "flat", "pixel"])
def test_each_kind_is_as_large_as_it_says(name: str) -> None:
    image = blurred_step(2.0)
    found = draws(image, replace(NONE, **{name: getattr(SIZE, name)}))
    middle, far = image.shape[1] // 2, 5
    expected = {"edge": 0.03 * 0.3, "flat": 0.01 * 0.25, "pixel": 0.002}[name]
    error = 5 * math.sqrt(1 / (2 * DRAWS))
    # rows of one draw are alike as long as its field is: one row counts
    assert found[:, 3, middle].std() == pytest.approx(expected, rel=error)
    away = {"edge": 0.0, "flat": 0.01 * 0.1, "pixel": 0.002}[name]
    assert found[:, 3, far].std() == pytest.approx(away, rel=error, abs=1e-9)


def test_lengths_along_edges_lie_between_their_ends() -> None:
    """By the slope of fields: rms slope is 1 over the length of each draw."""
    image = blurred_step(2.0, (200, 61))
    edges = draws(image, replace(NONE, edge=1.0), 100)[:, :, 30] / 0.3
    rms = np.sqrt((np.diff(edges, axis=1) ** 2).mean(axis=1))
    lengths = edges.std(axis=1) / rms  # of a draw shorter than the picture
    assert lengths.min() > 2.5  # 4, by 50 periods along 200 px
    assert np.quantile(lengths, 0.9) > 15
    assert np.median(lengths) == pytest.approx(math.sqrt(4 * 60), rel=0.5)


def test_contrast_is_the_step_at_the_target(look: Look) -> None:
    case = look("post")
    image = nominal_render(case)()
    far = ndimage.maximum_filter(image, 31), ndimage.minimum_filter(image, 31)
    row, column = round(case.target.row), round(case.target.column)
    inside = image[row, column]
    found = contrast(image, case.target, case.reach_um * case.target.px_per_um)
    assert found == target_contrast(case)
    sides = [abs(inside - side[row, column]) for side in far]
    assert found <= max(sides) + 0.02
    assert found > 0.5 * max(sides)


def test_a_target_out_of_view_has_the_contrast_of_the_picture(look: Look) -> None:
    case = look("post")
    away = replace(case.target, column=-1e4)
    assert contrast(blurred_step(1.0), away, 3.0) == pytest.approx(0.3)


def test_one_draw_stays_with_a_trial_and_another_height_has_another(look: Look) -> None:
    case = replace(look("post"), discrepancy=SIZE)
    trial = design(case, 1, 3)[0]
    there, elsewhere = from_stops(trial, (0.0,))
    counts, more = exposed(case, there)
    np.testing.assert_array_equal(exposed(case, trial)[1], more)
    other = exposed(case, elsewhere)[1]
    assert abs(np.corrcoef(more.ravel(), other.ravel())[0, 1]) < 0.5
    plain, nothing = exposed(replace(case, discrepancy=None), trial)
    assert not nothing.any()
    assert np.abs(counts.astype(float) - plain).mean() > 0


@pytest.mark.parametrize(
    ("key", "value"), [("edge", -0.1), ("pixel", math.nan), ("fine_um", 0.0),
                       ("size_um", 1.0), ("flat", math.inf)]
)  # fmt: skip
def test_impossible_sizes_are_refused(key: str, value: float) -> None:
    with pytest.raises(ValueError, match="must be"):
        replace(SIZE, **{key: value})
