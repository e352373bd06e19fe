"""Focus measures against closed forms, and what all of them must keep to."""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.focus.measures import (
    MEASURES,
    brenner,
    dct_ratio,
    gradient_sum,
    laplacian_energy,
    normalised_variance,
    vollath_f4,
)
from microplan.featuresel.look.scenario import LookCase, scene
from microplan.featuresel.routines.focus.measures import tenengrad
from microplan.optics.render.render import render_stack

Look = Callable[[str], LookCase]
BOTH = pytest.mark.parametrize("name", list(MEASURES))
SIDE = 64
LEVEL, DEPTH = 0.5, 0.2


def wave(cycles: int) -> tuple[np.ndarray, float]:
    """Return a grating with whole cycles along columns, and its angle a pixel."""
    turn = 2 * math.pi * cycles / SIDE
    row = LEVEL + DEPTH * np.cos(turn * np.arange(SIDE))
    return np.tile(row, (SIDE, 1)), turn


def inner() -> np.ndarray:
    """Return all columns of a whole number of cycles, away from the borders."""
    mask = np.zeros((SIDE, SIDE), dtype=bool)
    mask[8:-8, 8:-8] = True
    return mask


# a whole number of cycles is inside the mask: 48 columns hold 3 cycles in 64
CYCLES = 4
SHARE = (DEPTH / LEVEL) ** 2


@pytest.mark.parametrize(
    ("measure", "expected"),
    [
        # of cos: central difference sin(t), its mean square half of it
        (tenengrad, lambda t: SHARE / 2 * math.sin(t) ** 2),
        # cos(a + 2 t) - cos(a) = -2 sin(t) sin(a + t)
        (brenner, lambda t: SHARE / 2 * (2 * math.sin(t)) ** 2),
        # mean of cos(a) cos(a + k t) is cos(k t) / 2; along the rows it is 0
        (vollath_f4, lambda t: SHARE / 2 * (math.cos(t) - math.cos(2 * t))),
        # cos(a + t) - 2 cos(a) + cos(a - t) = 2 (cos(t) - 1) cos(a)
        (laplacian_energy, lambda t: SHARE / 2 * (2 * (math.cos(t) - 1)) ** 2),
        (normalised_variance, lambda t: SHARE / 2),
    ],
)
def test_a_grating_has_its_closed_form(
    measure: Callable[..., float], expected: Callable[[float], float]
) -> None:
    image, turn = wave(CYCLES)
    assert measure(image, inner()) == pytest.approx(expected(turn), rel=1e-12)


def test_the_gradient_of_a_ramp_is_its_slope() -> None:
    column, row = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    image = 0.1 + 0.003 * column + 0.004 * row
    mean = image[inner()].mean()
    assert gradient_sum(image, inner()) == pytest.approx(0.005 / mean, rel=1e-12)
    assert tenengrad(image, inner()) == pytest.approx((0.005 / mean) ** 2, rel=1e-12)


def test_the_cosine_transform_is_that_of_opencv() -> None:
    image = np.random.default_rng(3).uniform(0.2, 0.8, (24, 40))
    ratios = []
    for row in range(0, 24, 8):
        for column in range(0, 40, 8):
            block = cv2.dct(image[row : row + 8, column : column + 8].copy())
            low = (block[0, 1], block[0, 2], block[1, 0], block[2, 0], block[1, 1])
            ratios.append(sum(c**2 for c in low) / block[0, 0] ** 2)
    assert dct_ratio(image) == pytest.approx(np.mean(ratios), rel=1e-12)


@BOTH
@given(gain=st.floats(1e-3, 10), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_the_lights_level_cancels(name: str, gain: float, seed: int) -> None:
    image = np.random.default_rng(seed).uniform(0.1, 0.9, (24, 32))
    measure = MEASURES[name]
    # Vollath's is a difference of means of .25 each: rounding of them stays
    assert measure(gain * image, None) == pytest.approx(
        measure(image, None), rel=1e-9, abs=1e-12
    )


@BOTH
def test_rows_count_like_columns(name: str) -> None:
    image = np.random.default_rng(5).uniform(0.1, 0.9, (32, 32))
    assert MEASURES[name](image.T.copy(), None) == pytest.approx(
        MEASURES[name](image, None), rel=1e-12
    )


@BOTH
def test_an_even_image_scores_nothing(name: str) -> None:
    assert abs(MEASURES[name](np.full((16, 24), 0.3), None)) < 1e-12  # of rounding


@BOTH
def test_what_is_masked_does_not_count(name: str) -> None:
    rng = np.random.default_rng(6)
    image = np.full((48, 48), 0.4)
    image[:, 30:] = rng.uniform(0, 1, (48, 18))
    mask = np.zeros((48, 48), dtype=bool)
    mask[:, :24] = True  # beyond every measure's reach
    assert abs(MEASURES[name](image, mask)) < 1e-12
    image.setflags(write=False)  # nothing is written into it
    assert MEASURES[name](image, None) != 0


@BOTH
def test_a_face_is_sharpest_in_focus(name: str, look: Look) -> None:
    case = look("post")
    scores = [
        MEASURES[name](image, None)
        for image in render_stack(
            scene(case, 0.2, 0.1, 0.0),
            case.microscope,
            focus_um=(-8.0, -4.0, 0.0, 4.0, 8.0),
            window=case.window,
        )
    ]
    assert np.argmax(scores) == 2
    assert scores[0] < scores[1]
    assert scores[4] < scores[3]


@BOTH
def test_what_cannot_be_scored_is_an_error(name: str) -> None:
    measure = MEASURES[name]
    with pytest.raises(ValueError, match="black"):
        measure(np.zeros((9, 9)), None)
    with pytest.raises(ValueError, match="mask"):
        measure(np.ones((9, 9)), np.zeros((9, 9), dtype=bool))


def test_a_region_smaller_than_a_block_has_no_cosines() -> None:
    with pytest.raises(ValueError, match="no block"):
        dct_ratio(np.ones((7, 20)))
