"""Noise as a line over the level, and successive frames that are refused."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.planner.calibration.count_levels import count_levels
from microplan.planner.calibration.estimates import Refused
from microplan.planner.calibration.noise_line import NoiseLine, noise_line
from microplan.planner.calibration.photon_transfer import NoiseRow, noise_rows
from microplan.planner.calibration.still_frames import StillScene
from tests.planner.calibration.simulated_camera import Camera, patches
from tests.planner.calibration.test_photon_transfer import FALLING, steps

NONE = Camera()


def told_by(frames: Iterable[FloatArray], top: int) -> tuple[NoiseRow, ...]:
    """Return the noise by level of frames, added up one by one."""
    scene: StillScene | None = None
    for frame in frames:
        if scene is None:
            scene = StillScene.of(frame, top)
        else:
            scene.add(frame)
    assert scene is not None
    return noise_rows(scene, count_levels(scene.codes, top))


def rows_of(camera: Camera, seed: int, light: FloatArray) -> tuple[NoiseRow, ...]:
    rng = np.random.default_rng(seed)
    found = told_by(camera.frames(light, 12, rng), camera.top)
    assert found
    return found


def line_of(rows: tuple[NoiseRow, ...]) -> NoiseLine:
    found = noise_line(rows)
    assert isinstance(found, NoiseLine)
    return found


def test_photons_and_read_noise_come_out_within_their_deviations() -> None:
    """Of 8 to 16 bits, in light that flickers."""
    pulls, reads = [], []
    for seed in range(24):
        top = (255, 4095, 65535)[seed % 3]
        camera = Camera(
            top=top, white=top, black=top / 20, flicker=0.01,
            full_well_e=(2000.0, 10_000.0)[seed % 2], read_e=20.0,
        )  # fmt: skip
        line = line_of(rows_of(camera, seed, 0.9 * patches(96)))
        assert line.suffices
        well = line.full_well_e(camera.black, camera.white)
        assert well.sigma is not None
        pulls.append((well.value - camera.full_well_e) / well.sigma)
        reads.append(line.read_noise_e(camera.black))
    assert np.max(np.abs(pulls)) < 4
    assert 0.4 < np.mean(np.square(pulls)) < 2.5
    # the line's end in darkness is known to some 10 % of a variance of 400
    assert np.mean(reads) == pytest.approx(20, rel=0.1)


def test_noise_that_falls_with_the_light_needs_a_table() -> None:
    """More than half of the pixels are at 0; the rest tells the noise."""
    rng = np.random.default_rng(0)
    light = steps()
    light[:144] = -0.2
    levels, sigmas = np.array(FALLING).T

    def frames() -> Iterator[FloatArray]:
        for _ in range(24):
            noise = np.interp(255 * light, levels, sigmas)
            counts = 255 * light + rng.normal(0, 1, light.shape) * noise
            yield np.clip(np.rint(counts), 0, 255)

    found = told_by(frames(), 255)
    assert found
    for row in found:
        true = float(np.interp(row.level, levels, sigmas)) ** 2 + 1 / 12
        assert row.variance == pytest.approx(true, rel=0.15)
    assert max(row.level for row in found) > 220
    line = line_of(found)
    assert not line.suffices
    assert line.gain.value < 0
    with pytest.raises(ValueError, match="must rise"):
        line.full_well_e(0, 255)
    with pytest.raises(ValueError, match="must rise"):
        line.read_noise_e(0)


def test_a_curve_of_noise_needs_a_table() -> None:
    """A camera that takes roots of the light has the same noise at all levels."""
    rows = tuple(
        NoiseRow(level=x, variance=2 + (x / 40) ** 2, sigma=0.05, pixels=900)
        for x in np.linspace(10, 240, 20).tolist()
    )
    assert not line_of(rows).suffices


def test_rows_on_a_line_give_its_numbers() -> None:
    rows = tuple(
        NoiseRow(level=x, variance=3 + 0.2 * x, sigma=0.01 * (3 + 0.2 * x), pixels=500)
        for x in np.linspace(10, 240, 9).tolist()
    )
    line = line_of(rows)
    assert line.suffices
    assert line.departure < 1e-9
    assert line.gain.value == pytest.approx(0.2)
    assert line.at_zero.value == pytest.approx(3)
    assert line.full_well_e(10, 250).value == pytest.approx(1200)
    assert line.read_noise_e(10) == pytest.approx((5 - 1 / 12) ** 0.5 / 0.2)
    assert line.read_noise_e(-15) == 0
    with pytest.raises(ValueError, match="white be above black"):
        line.full_well_e(250, 250)


def test_too_few_levels_tell_no_line() -> None:
    row = NoiseRow(level=10, variance=2, sigma=0.1, pixels=300)
    bare = NoiseRow(level=10, variance=2, sigma=None, pixels=300)
    for rows in ((), (row,) * 4, (bare,) * 20):
        found = noise_line(rows)
        assert isinstance(found, Refused)
        assert "even patches" in found.take


@pytest.mark.parametrize("level", [0, 255, 90])
def test_frames_of_one_level_tell_no_noise(level: int) -> None:
    """Cut off at either end, or too few pixels of one row."""
    size = (2, 2) if level == 90 else (40, 40)
    assert told_by([np.full(size, float(level))] * 3, 255) == ()


def test_pictures_without_noise_have_none() -> None:
    still = np.rint(200 * np.tile(np.linspace(0.1, 1, 40), (40, 1)))
    found = told_by([still] * 4, 255)
    assert found
    assert [row.variance for row in found] == [0.0] * len(found)
    assert isinstance(noise_line(found), Refused)


def test_two_frames_tell_the_noise() -> None:
    rng = np.random.default_rng(0)
    frames = NONE.frames(0.5 * patches(128), 2, rng)
    found = told_by(frames, NONE.top)
    assert found
    gain = 3995 / 10_000
    for row in found:
        true = gain * (row.level - 100) + (8 * gain) ** 2
        # four standard deviations of a variance of so many differences
        chance = 4 * (2 / row.pixels) ** 0.5
        assert row.variance == pytest.approx(true, rel=chance)


def test_frames_are_taken_one_by_one() -> None:
    """300 of them, none kept: each overwrites the one before."""
    rng = np.random.default_rng(0)
    page = np.zeros((48, 48))

    def frames() -> Iterator[FloatArray]:
        for _ in range(300):
            page[:] = NONE.frame(0.5 * patches(48), rng)
            yield page.copy()

    found = told_by(frames(), NONE.top)
    assert found
    assert sum(row.pixels for row in found) > 200


def test_a_vibrating_edge_is_left_out() -> None:
    """An edge alone, between two even fields, has more variance than all noise."""
    light = np.full((64, 64), 0.2)
    light[:, 32:] = 0.7
    camera = Camera(shake_px=0.3)
    rng = np.random.default_rng(1)
    found = told_by(camera.frames(light, 16, rng), camera.top)
    assert found
    gain = 3995 / 10_000
    for row in found:
        true = gain * (row.level - 100) + (8 * gain) ** 2
        # by chance, and what vibration is allowed to add
        limit = 4 * (3 / (row.pixels * 15)) ** 0.5 + 0.02
        assert row.variance == pytest.approx(true, rel=limit)
