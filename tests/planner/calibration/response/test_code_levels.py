"""Ends of counts, steps between them and darkness, of cameras that are stated."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.arrays import IntArray
from microplan.planner.calibration.count_levels import count_levels
from microplan.planner.calibration.estimates import BlockEstimate, Refused
from microplan.planner.calibration.response.code_levels import (
    CodeUse,
    black_level,
    code_use,
)
from microplan.planner.calibration.still_frames import StillScene
from tests.planner.calibration.simulated_camera import Camera, patches

DARK = np.zeros((48, 48))


def counted(values: IntArray, size: int = 65536) -> IntArray:
    return np.bincount(values.ravel(), minlength=size)


def levels_12() -> IntArray:
    """Return many counts of a camera of 12 bits."""
    rng = np.random.default_rng(0)
    return rng.integers(200, 1200, 100_000)


def test_shares_at_both_ends_and_the_count_of_saturation() -> None:
    light = patches()
    light[:32] = 0.0
    light[56:] = 2.0
    camera = Camera(top=255, white=240, black=-40)
    codes = camera.scene(light, 8, np.random.default_rng(1)).codes
    found = count_levels(codes, 255)
    assert found.dark_share == pytest.approx(0.5, abs=0.06)
    assert (found.highest, found.white_level) == (240, 240)
    assert found.white_share == pytest.approx(1 / 8, abs=0.02)


def test_without_saturation_no_white_level_is_made_up() -> None:
    camera = Camera(top=4095, white=4095)
    codes = camera.scene(0.5 * patches(), 8, np.random.default_rng(1)).codes
    found = count_levels(codes, 4095)
    assert found.white_level is None
    assert found.dark_share == 0
    black = count_levels(counted(np.zeros(50, dtype=int)), 255)
    assert (black.dark_share, black.highest, black.white_level) == (1.0, 0, None)
    white = count_levels(counted(np.full(50, 255)), 255)
    assert (white.dark_share, white.white_share, white.white_level) == (0, 1.0, 255)


@pytest.mark.parametrize(
    ("values", "step"),
    [
        (levels_12() * 16, 16),
        (levels_12() << 4 | levels_12() >> 8, 16),
        (np.rint(levels_12() * 65535 / 4095).astype(int), 16),
    ],
)
def test_fewer_bits_in_a_file_of_more_are_told(values: IntArray, step: int) -> None:
    """Shifted, with the high bits repeated below, or scaled."""
    found = code_use(counted(values), 16)
    assert isinstance(found, CodeUse)
    assert (found.step, found.true_bits) == (step, 12)
    assert found.missing == 0


def test_counts_that_a_table_leaves_out_are_missing() -> None:
    values = levels_12()
    gone = np.isin(values, [300, 450, 451, 700])
    found = code_use(counted(values[~gone], 4096), 12)
    assert found == CodeUse(step=1, true_bits=12, missing=4)


def test_gaps_of_the_scene_are_not_missing_counts() -> None:
    rng = np.random.default_rng(0)
    values = np.rint(rng.choice([100, 900], 4000) + rng.normal(0, 3, 4000))
    found = code_use(counted(values.astype(int), 4096), 12)
    assert found == CodeUse(step=1, true_bits=12, missing=0)


@pytest.mark.parametrize(
    "values",
    [
        np.zeros(5000, dtype=int),
        np.full(5000, 255),
        np.repeat([10, 50, 90], 1000),  # without noise: gaps are the scene's
        np.repeat(np.arange(3, 15) ** 3, 50),
        np.arange(4),
    ],
)
def test_too_few_counts_tell_no_step(values: IntArray) -> None:
    found = code_use(counted(values), 16)
    assert isinstance(found, Refused)
    assert "many levels" in found.take


def test_no_counts_are_refused() -> None:
    assert isinstance(code_use(np.zeros(256, dtype=int), 8), Refused)


def test_the_count_of_darkness_comes_out_within_its_deviation() -> None:
    """Of 8 to 16 bits; hot pixels do not move it."""
    pulls = []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        top = (255, 4095, 65535)[seed % 3]
        noise = top / 400
        frames = rng.normal(top / 20, noise, (3, 48, 48))
        frames[:, 5, 7] = top
        scene = StillScene.of(np.rint(frames[0]), top)
        for frame in frames[1:]:
            scene.add(np.clip(np.rint(frame), 0, top))
        found = black_level(scene)
        assert isinstance(found, BlockEstimate)
        assert found.sigma is not None
        pulls.append((found.value - top / 20) / found.sigma)
    assert np.max(np.abs(pulls)) < 4
    assert 0.4 < np.mean(np.square(pulls)) < 2.5


def test_darkness_that_is_cut_off_tells_no_level() -> None:
    rng = np.random.default_rng(0)
    found = black_level(Camera(black=3).scene(DARK, 4, rng))
    assert isinstance(found, Refused)
    assert "offset raised" in found.take
    white = black_level(StillScene.of(np.full((4, 4), 255.0), 255))
    assert isinstance(white, Refused)
    assert "saturated" in white.why
    few = black_level(StillScene.of(np.full((2, 2), 20.0), 255))
    assert isinstance(few, BlockEstimate)
    assert (few.value, few.sigma, few.blocks) == (20.0, None, 4)
