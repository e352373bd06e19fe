from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.ndimage import maximum_filter

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import CameraNoise
from microplan.featuresel.routines.likelihood.planes import LOSS, informative
from tests.featuresel.fits import render

CAMERA = CameraNoise(full_well_e=10_000, read_noise_e=10, bits=8, fill_factor=1.0)
NEAR_PX = 4  # OpenCV cuts a Gaussian in 64 bits off at four deviations, here 1 px


def limits(
    mean: FloatArray, slopes: FloatArray, used: npt.NDArray[np.bool_]
) -> FloatArray:
    """Return the bounds of all numbers from some pixels, by a QR decomposition."""
    scores = slopes[:, used] / np.sqrt(CAMERA.variance(mean[used]))
    upper = np.linalg.qr(scores.T, mode="r")
    bounds: FloatArray = np.linalg.norm(np.linalg.inv(upper), axis=1)
    return bounds


def gear() -> tuple[FloatArray, FloatArray]:
    """Return a gear's image and its slopes to place and turn, gain and gradients."""
    look, h = render("find_gear"), 0.05
    mean = look()
    v, u = np.mgrid[: mean.shape[0], : mean.shape[1]] / 200 - 0.5
    slopes = (
        look(dx_um=h) - look(dx_um=-h),
        look(dy_um=h) - look(dy_um=-h),
        look(theta_rad=h / 50) - look(theta_rad=-h / 50),
        *(2 * h * mean, 2 * h * mean * u, 2 * h * mean * v),
    )
    return mean, np.stack(slopes) / (2 * h)


def test_few_pixels_keep_a_gears_limits() -> None:
    mean, slopes = gear()
    used = informative(mean, slopes, CAMERA, wanted=3)
    everything = np.ones_like(used)
    ratio = limits(mean, slopes, used) / limits(mean, slopes, everything)
    assert (ratio[:3] <= LOSS * (1 + 1e-9)).all()
    assert ratio[3:].max() > LOSS  # the light is not wanted
    assert used.mean() < 0.05


@pytest.mark.parametrize("wanted", [1, 2, 5])
def test_random_pixels_keep_the_limits_of_what_is_wanted(wanted: int) -> None:
    rng = np.random.default_rng(wanted)
    slopes = rng.normal(size=(5, 40, 30)) ** 3
    mean = rng.uniform(0.0, 1.0, (40, 30))
    used = informative(mean, slopes, CAMERA, wanted=wanted)
    ratio = limits(mean, slopes, used) / limits(mean, slopes, np.ones_like(used))
    assert (ratio[:wanted] <= LOSS * (1 + 1e-9)).all()
    assert used.sum() < 0.9 * used.size


def test_pixels_that_tell_nothing_are_taken_only_beside_ones_that_do() -> None:
    rng = np.random.default_rng(7)
    slopes = np.zeros((3, 60, 80))
    slopes[:, 20:30, 15:25] = rng.normal(size=(3, 10, 10))
    slopes[:, 45:50, 60:70] = rng.normal(size=(3, 5, 10))
    used = informative(np.full((60, 80), 0.5), slopes, CAMERA, wanted=2)
    tells = np.abs(slopes).max(axis=0) > 0
    assert used.any()
    assert not (used & ~maximum_filter(tells, 2 * NEAR_PX + 1)).any()


def test_what_cannot_be_told_asks_for_no_pixels() -> None:
    rng = np.random.default_rng(9)
    slopes = np.stack((rng.normal(size=(20, 20)), np.zeros((20, 20))))
    both = informative(np.full((20, 20), 0.5), slopes, CAMERA, wanted=2)
    one = informative(np.full((20, 20), 0.5), slopes[:1], CAMERA, wanted=1)
    np.testing.assert_array_equal(both, one)
    nothing = informative(np.full((20, 20), 0.5), 0 * slopes, CAMERA, wanted=2)
    assert nothing.sum() <= 1


def test_numbers_that_cannot_be_told_apart_do_not_break_it() -> None:
    slope = np.random.default_rng(1).normal(size=(20, 20))
    used = informative(
        np.full((20, 20), 0.5), np.stack((slope, slope)), CAMERA, wanted=2
    )
    assert 0 < used.sum() < used.size
