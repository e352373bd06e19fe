"""How the cell's pictures differ from images: by spectra and draws of its own."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import ndimage

from microplan.arrays import FloatArray
from microplan.executor.simulated.imaging.picture_errors import PictureErrors, waves

BLUR_PX = 8.0  # wavelength over aperture
SHAPE = (48, 400)
MIDDLE = SHAPE[0] // 2
SETTING = (6.9, 100.0)
NONE = PictureErrors(edge=0.0, flat=0.0, pixel=0.0, seed=0)
DRAWS = 150
ALL_OVER = 30  # draws of errors that thousands of places of a picture have


def band_in_focus() -> FloatArray:
    """Return a wide band of .4 on .1, by the transfer function of a round pupil."""
    band = (np.abs(np.arange(SHAPE[1]) - 200) < 100).astype(float)
    share = np.minimum(np.abs(np.fft.fftfreq(SHAPE[1])) * BLUR_PX / 2, 1.0)
    transfer = 2 / math.pi * (np.arccos(share) - share * np.sqrt(1 - share**2))
    profile = np.fft.ifft(np.fft.fft(band) * transfer).real
    return np.tile(0.1 + 0.3 * profile, (SHAPE[0], 1))


def draws(errors: PictureErrors, image: FloatArray, count: int = DRAWS) -> FloatArray:
    return np.array(
        [replace(errors, seed=k).of(image, BLUR_PX, SETTING) for k in range(count)]
    )


@pytest.mark.parametrize("length_px", [3.0, 25.0])
def test_waves_have_their_variance_and_their_length(length_px: float) -> None:
    rng = np.random.default_rng(3)
    fields = [waves((2, round(length_px) + 1), length_px, rng) for _ in range(3000)]
    first, last = np.array(fields)[:, 0, [0, -1]].T
    error = 5 / math.sqrt(3000)
    assert np.mean(first**2) == pytest.approx(1.0, abs=error * math.sqrt(2))
    assert np.mean(first * last) == pytest.approx(math.exp(-0.5), abs=2 * error)


def test_an_edge_errs_by_a_share_of_its_step_in_its_middle() -> None:
    """In focus, where the middle lies between two pixels, and twice as wide."""
    error = 5 / math.sqrt(2 * DRAWS)
    wide = ndimage.gaussian_filter1d(band_in_focus(), 3.0, axis=1)
    for image in (band_in_focus(), wide):
        found = draws(replace(NONE, edge=0.03), image)
        rms = math.sqrt((found[:, MIDDLE, [100, 101, 299, 300]] ** 2).mean())
        assert rms == pytest.approx(0.03 * 0.3, rel=0.05 + error / math.sqrt(2))
        assert np.abs(found[:, :, [0, 200]]).max() < 0.03 * 0.3 * 0.1


@cache
def over_the_edge(wide: int) -> float:
    """Return the error over an edge's width, of pixels so many times as wide."""
    errors, edge = replace(NONE, edge=0.03), slice(60, 140)
    image = band_in_focus()[:, :396]
    pixels = image.reshape(SHAPE[0] // wide, wide, 396 // wide, wide)
    found = [
        replace(errors, seed=k).of(pixels.mean((1, 3)), BLUR_PX / wide, SETTING)
        for k in range(DRAWS)
    ]
    rms = np.sqrt((np.array(found) ** 2).mean(axis=(0, 1)))
    return float(rms[edge.start // wide : edge.stop // wide].sum() * wide)


@pytest.mark.parametrize("binned", [2, 6])
def test_an_edge_errs_as_much_in_wider_pixels(binned: int) -> None:
    """Over its width: a pixel of .75 of the blur makes no other edge of it."""
    assert over_the_edge(binned) == pytest.approx(over_the_edge(1), rel=0.2)


def test_an_edge_faces_and_pixels_err_by_their_shares() -> None:
    image, error = band_in_focus(), 5 / math.sqrt(2 * DRAWS)
    flat = draws(replace(NONE, flat=0.01), image)[:, MIDDLE, [0, 200]].std(axis=0)
    np.testing.assert_allclose(flat, [0.01 * 0.1, 0.01 * 0.4], rtol=0.02 + error)
    pixel = draws(replace(NONE, pixel=0.03), image, ALL_OVER)
    assert pixel.std() == pytest.approx(0.03 * 0.3, rel=0.05)  # light rings at edges


def test_a_small_part_has_the_same_errors_as_one_that_fills_the_picture() -> None:
    """A share of the picture's own spread would be three times less."""
    image = band_in_focus()
    image[:, 104:297] = 0.4
    narrow = np.where(np.arange(SHAPE[1]) < 130, image, 0.1)
    errors = replace(NONE, pixel=0.03)
    sizes = [draws(errors, each, ALL_OVER).std() for each in (image, narrow)]
    assert sizes[1] == pytest.approx(sizes[0], rel=0.1)


def test_errors_stay_and_change_with_the_lens_and_the_look() -> None:
    image, errors = band_in_focus(), replace(NONE, edge=0.03, pixel=0.001)
    first = errors.of(image, BLUR_PX, SETTING)
    np.testing.assert_array_equal(errors.of(image, BLUR_PX, SETTING), first)
    for setting in ((6.9, 101.0), (7.0, 100.0)):
        other = errors.of(image, BLUR_PX, setting)
        assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 0.6
    part = errors.of(image[:40], BLUR_PX, SETTING)
    same = first[:40]
    assert abs(np.corrcoef(part.ravel(), same.ravel())[0, 1]) < 0.6


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1)])
def test_the_smallest_pictures_have_errors(shape: tuple[int, int]) -> None:
    errors = replace(NONE, edge=0.03, flat=0.01, pixel=0.03)
    found = errors.of(np.full(shape, 0.3), BLUR_PX, SETTING)
    assert np.isfinite(found).all()
    assert np.abs(found).max() < 0.3 * 0.01 * 6
