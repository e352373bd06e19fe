"""Errors of pictures, and what is promised of answers."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.truth.comparison import apart, worst
from benchmarks.truth.promised import Promise
from benchmarks.truth.replayed import ReplayedLook, figures


def test_a_picture_passes_by_its_share_its_worst_pixel_and_its_rms() -> None:
    plain = np.zeros((40, 50))
    near, few, all_ = (plain.copy() for _ in range(3))
    near += 0.002
    few[0, :5] = 0.019  # 5 of 2000 pixels
    all_ += 0.004
    assert apart(near, plain).passes
    assert apart(few, plain).passes
    assert not apart(all_, plain).passes  # rms
    few[1, :10] = 0.019  # 15 of 2000
    assert not apart(few, plain).passes  # share
    few[:2] = 0.0
    few[3, 3] = 0.03
    assert not apart(few, plain).passes  # worst pixel
    most = worst([apart(all_, plain), apart(few, plain)])
    assert most.max_error == pytest.approx(0.03)
    assert most.share == pytest.approx(1 - 1 / 2000)


def test_errors_as_promised_have_a_mean_square_of_one() -> None:
    rng = np.random.default_rng(0)
    wide, sigma = np.array([0.2, 0.1]), np.array([0.3, 0.05])  # x errs six times more
    bias = wide * rng.uniform(-1, 1, (4000, 2))
    look = ReplayedLook(
        id="a",
        errors_um=bias + rng.normal(0, 1, (4000, 2)) * sigma,
        failed=3,
        promise=Promise(
            trials=64,
            sigma_um=(0.3, 0.05),
            half_width_um=(0.2, 0.1),
            unseen_bias_um=(0.0, 0.0),
        ),
    )
    # relative standard error of a mean square of 8000 normal values
    assert look.nees == pytest.approx(1.0, abs=4 * (2 / 8000) ** 0.5)
    # y is half a uniform one: its 95 % interval holds a little more than .95
    assert look.coverage == pytest.approx(0.955, abs=0.01)
    least, most, pooled, low, high, failed = figures([look, look], "fast")
    assert least.value == most.value == look.nees
    assert pooled.value == low.value == high.value == look.coverage
    assert "8000 values" in least.unit
    assert "64 trials (fast)" in least.unit
    assert failed.value == 6
