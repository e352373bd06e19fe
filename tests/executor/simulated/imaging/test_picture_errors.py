"""How the cell's pictures differ from images: by spectra and draws of its own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.executor.simulated.imaging.picture_errors import PictureErrors, waves

BLUR_PX = 8.0  # wavelength over aperture
SHAPE = (120, 400)
SETTING = (6.9, 100.0)
NONE = PictureErrors(edge=0.0, flat=0.0, pixel=0.0, shape=SHAPE, seed=0)
DRAWS = 150


def band_in_focus() -> FloatArray:
    """Return a wide band of .4 on .1, by the transfer function of a round pupil."""
    band = (np.abs(np.arange(SHAPE[1]) - 200) < 100).astype(float)
    share = np.minimum(np.abs(np.fft.fftfreq(SHAPE[1])) * BLUR_PX / 2, 1.0)
    transfer = 2 / math.pi * (np.arccos(share) - share * np.sqrt(1 - share**2))
    profile = np.fft.ifft(np.fft.fft(band) * transfer).real
    return np.tile(0.1 + 0.3 * profile, (SHAPE[0], 1))


def draws(errors: PictureErrors, image: FloatArray) -> FloatArray:
    return np.array(
        [
            replace(errors, seed=k).of(image, (0, 0), BLUR_PX, SETTING)
            for k in range(DRAWS)
        ]
    )


@pytest.mark.parametrize("length_px", [3.0, 25.0])
def test_waves_have_their_variance_and_their_length(length_px: float) -> None:
    rng = np.random.default_rng(3)
    fields = [waves((2, round(length_px) + 1), length_px, rng) for _ in range(3000)]
    first, last = np.array(fields)[:, 0, [0, -1]].T
    error = 5 / math.sqrt(3000)
    assert np.mean(first**2) == pytest.approx(1.0, abs=error * math.sqrt(2))
    assert np.mean(first * last) == pytest.approx(math.exp(-0.5), abs=2 * error)


def test_an_edge_in_focus_errs_by_a_share_of_its_step_in_its_middle() -> None:
    """The middle lies between two pixels, where the slope is less by 1 %."""
    found = draws(replace(NONE, edge=0.03), band_in_focus())
    error = 5 / math.sqrt(2 * DRAWS)
    rms = math.sqrt((found[:, 60, [100, 101, 299, 300]] ** 2).mean())
    assert rms == pytest.approx(0.03 * 0.3, rel=0.02 + error / math.sqrt(2))
    assert np.abs(found[:, :, [0, 200]]).max() < 0.03 * 0.3 * 0.1


def test_faces_and_pixels_err_by_their_shares() -> None:
    image, error = band_in_focus(), 5 / math.sqrt(2 * DRAWS)
    flat = draws(replace(NONE, flat=0.01), image)[:, 60, [0, 200]].std(axis=0)
    np.testing.assert_allclose(flat, [0.01 * 0.1, 0.01 * 0.4], rtol=0.02 + error)
    pixel = draws(replace(NONE, pixel=0.03), image)
    assert pixel.std() == pytest.approx(0.03 * 0.3, rel=0.05)  # half white: 2 sigma


def test_errors_stay_on_the_sensor_and_change_with_the_lens() -> None:
    image, errors = band_in_focus(), replace(NONE, edge=0.03, flat=0.02, pixel=0.0)
    whole = errors.of(image, (0, 0), BLUR_PX, SETTING)
    part = errors.of(image[20:70, 80:140], (20, 80), BLUR_PX, SETTING)
    inner = (slice(1, -1), slice(1, -1))  # slopes at a rim are one-sided
    np.testing.assert_allclose(part[inner], whole[20:70, 80:140][inner], atol=1e-12)
    for setting in ((6.9, 101.0), (7.0, 100.0)):
        other = errors.of(image, (0, 0), BLUR_PX, setting)
        assert abs(np.corrcoef(whole.ravel(), other.ravel())[0, 1]) < 0.6
    again = errors.of(image, (0, 0), BLUR_PX, SETTING)
    np.testing.assert_array_equal(again, whole)
