"""Noise by level from still frames: what a camera was given comes out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from microplan.arrays import FloatArray
from microplan.planner.calibration.count_levels import count_levels
from microplan.planner.calibration.estimates import jackknife_sigma
from microplan.planner.calibration.photon_transfer import NoiseRow, noise_rows
from microplan.planner.calibration.still_frames import StillScene

# of a machine-vision camera whose noise falls with the light: level, counts of noise
FALLING = ((10.0, 5.0), (90.0, 4.2), (149.0, 3.2), (207.0, 2.1), (237.0, 1.3))


def steps(size: int = 256) -> FloatArray:
    """Return a chart of smooth patches between black and white, 0..1."""
    patches = np.random.default_rng(4).uniform(0.02, 0.98, (16, 16))
    return gaussian_filter(np.kron(patches, np.ones((size // 16, size // 16))), 1.0)


def seen(
    light: FloatArray,
    frames: int,
    *,
    top: int = 255,
    seed: int = 0,
    shake_px: float = 0.0,
    flicker: float = 0.0,
    table: tuple[tuple[float, float], ...] = FALLING,
) -> StillScene:
    """Return frames of a chart as a camera with a table of noise sees them."""
    rng = np.random.default_rng(seed)
    levels, sigmas = np.array(table).T
    found = None
    for _ in range(frames):
        moved = shift(light, rng.normal(0, shake_px, 2), order=3, mode="nearest")
        counts = moved * top * (1 + rng.normal(0, flicker))
        noisy = counts + rng.normal(0, 1, light.shape) * np.interp(
            counts, levels * top / 255, sigmas * top / 255
        )
        frame = np.clip(np.rint(noisy), 0, top)
        if found is None:
            found = StillScene.of(frame, top)
        else:
            found.add(frame)
    assert found is not None
    return found


def rows_of(scene: StillScene, top: int = 255) -> tuple[NoiseRow, ...]:
    return noise_rows(scene, count_levels(scene.codes, top))


def true_variance(level: float, top: int = 255) -> float:
    levels, sigmas = np.array(FALLING).T * (top / 255)
    return float(np.interp(level, levels, sigmas)) ** 2 + 1 / 12


def test_the_noise_of_each_level_comes_out_within_its_standard_deviation() -> None:
    """Of cameras of 8, 12 and 16 bits; blocks are few, so that pulls are Student's."""
    pulls = []
    for top in (255, 4095, 65535):
        found = rows_of(seen(steps(), 24, top=top, seed=top), top)
        assert len(found) == 24
        levels = [row.level for row in found]
        assert levels == sorted(levels)
        for row in found:
            assert row.sigma is not None
            off = row.variance - true_variance(row.level, top)
            # the variance of 24 frames by successive differences: 3 / 23 of its square
            chance = row.variance * math.sqrt(3 / (row.pixels * 23))
            assert abs(off) < 4 * chance
            pulls.append(off / row.sigma)
    assert 0.5 < np.mean(np.square(pulls)) < 2


def test_flicker_and_vibration_are_not_taken_for_noise() -> None:
    """Vibration alone adds more to the mean variance than all noise."""
    still, shaken = seen(steps(), 24), seen(steps(), 24, shake_px=0.3)
    inside = _inside(shaken)
    assert shaken.variance[inside].mean() > 2 * still.variance[inside].mean()
    for scene in (shaken, seen(steps(), 24, flicker=0.05)):
        found = rows_of(scene)
        assert len(found) > 16
        for row in found:
            assert row.variance == pytest.approx(true_variance(row.level), rel=0.15)


@pytest.mark.parametrize("flicker", [0.0, 0.01])
def test_one_edge_that_vibrates_is_not_taken_for_flicker(flicker: float) -> None:
    """It changes the sum of all light, and most the noise of what is bright."""
    light = np.full((64, 64), 0.25)
    light[:, 32:] = 0.75
    light = gaussian_filter(light, 1.5)
    bright = [
        row
        for seed in range(3)
        for row in rows_of(seen(light, 24, seed=seed, shake_px=0.3, flicker=flicker))
        if row.level > 150
    ]
    pixels = sum(row.pixels for row in bright)
    ratios = [row.pixels * row.variance / true_variance(row.level) for row in bright]
    chance = math.sqrt(3 / (pixels * 23))
    assert sum(ratios) / pixels == pytest.approx(1, abs=4 * chance)


def _inside(scene: StillScene) -> FloatArray:
    return np.asarray((scene.lowest > 0) & (scene.highest < 255))


def test_what_is_cut_off_has_no_noise() -> None:
    """Half of the chart at the black level, a quarter saturated."""
    light = steps()
    light[:128] = -0.002
    light[192:] = 1.05
    scene = seen(light, 12)
    found = count_levels(scene.codes, 255)
    assert found.dark_share == pytest.approx(0.29, abs=0.06)
    assert (found.white_level, found.step) == (255, 1)
    assert found.white_share > 0.24
    rows = noise_rows(scene, found)
    assert rows
    assert min(row.level for row in rows) > 15
    for row in rows:
        assert row.variance == pytest.approx(true_variance(row.level), rel=0.25)


def test_counts_of_few_bits_in_many_are_told_by_their_step() -> None:
    codes = np.bincount(np.arange(0, 65536, 16), minlength=1 << 16)
    found = count_levels(codes, 65535)
    assert (found.step, found.highest, found.white_level) == (16, 65520, None)


def test_saturation_below_full_scale_is_seen() -> None:
    codes = np.bincount(np.repeat([200, 201, 202, 240], [50, 60, 40, 900]))
    assert count_levels(codes, 255).white_level == 240
    assert count_levels(np.bincount([0, 0, 0]), 255).white_level is None


@pytest.mark.parametrize(
    "frame",
    [
        np.zeros((16, 16)),
        np.full((16, 16), 255.0),
        np.full((2, 2), 90.0),
        np.full((1, 40), 90.0),
    ],
)
def test_pictures_that_tell_no_noise_give_no_row(frame: FloatArray) -> None:
    scene = StillScene.of(frame, 255)
    scene.add(frame)
    assert rows_of(scene) == ()


def test_memory_does_not_grow_with_frames() -> None:
    light = steps(32)
    few, many = seen(light, 3), seen(light, 300)
    for name in ("total", "squares", "codes", "highest"):
        assert getattr(few, name).nbytes == getattr(many, name).nbytes
    assert many.frames == 300


def test_a_mean_over_blocks_has_the_spread_of_repeats() -> None:
    """Blocks of unequal size; fewer than six have none."""
    rng = np.random.default_rng(9)
    counts = np.array([40.0, 60, 80, 100, 50, 70, 90, 110, 30, 120])
    found = []
    for _ in range(400):
        means = 5 + rng.normal(0, 1, counts.size)  # blocks err, not their values
        sums = means * counts
        found.append((sums.sum() / counts.sum(), jackknife_sigma(sums, counts)))
    means, sigmas = np.array(found, dtype=float).T
    assert np.sqrt(np.mean(sigmas**2)) == pytest.approx(means.std(), rel=0.12)
    assert jackknife_sigma(counts[:5], counts[:5]) is None
    assert jackknife_sigma(counts, np.where(counts > 60, 0, counts)) is None
