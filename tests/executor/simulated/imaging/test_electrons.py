"""Noise of the camera: its mean and its variance."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.executor.simulated.imaging.electrons import counted


def test_counts_have_the_noise_of_photons_readout_and_rounding() -> None:
    image = np.full((400, 500), 0.5)
    counts = counted(
        image, full_well_e=10000.0, read_noise_e=10.0, bits=8,
        rng=np.random.default_rng(1),
    ).astype(float)  # fmt: skip
    step = 10000 / 255
    variance = (5000 + 10**2) / step**2 + 1 / 12
    assert counts.mean() == pytest.approx(127.5, abs=4 * (variance / 2e5) ** 0.5)
    # relative standard error of a variance of n values: sqrt(2 / n)
    assert counts.var() == pytest.approx(variance, rel=4 * (2 / 2e5) ** 0.5)


def test_counts_end_at_both_ends() -> None:
    image = np.array([[-0.1, 0.0, 2.0]])
    rng = np.random.default_rng(0)
    for bits, kind in ((8, np.uint8), (12, np.uint16)):
        counts = counted(image, full_well_e=1e6, read_noise_e=1.0, bits=bits, rng=rng)
        assert counts.dtype == kind
        assert counts.tolist()[0][2] == 2**bits - 1
        assert counts.max() == 2**bits - 1
    with pytest.raises(ValueError, match="bits"):
        counted(image, full_well_e=1.0, read_noise_e=0.0, bits=17, rng=rng)
