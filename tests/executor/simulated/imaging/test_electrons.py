"""Counts of the cell's camera: mean, variance, response, fixed pattern."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.executor.simulated.imaging.electrons import Chip, PixelPattern, counted

HALF = np.full((400, 500), 0.5)
N = HALF.size
# gamma .5 in steps, black cut off below 4 counts' worth, saturated at 247
ROWS = tuple((k * k / 400, -4 + 251 * k / 20) for k in range(21))


def test_counts_have_the_noise_of_photons_readout_and_rounding() -> None:
    chip = Chip(full_well_e=10000.0, read_noise_e=10.0, bits=8)
    counts = counted(HALF, chip, np.random.default_rng(1)).astype(float)
    step = 10000 / 255
    variance = (5000 + 10**2) / step**2 + 1 / 12
    assert counts.mean() == pytest.approx(127.5, abs=4 * (variance / N) ** 0.5)
    # relative standard error of a variance of n values: sqrt(2 / n)
    assert counts.var() == pytest.approx(variance, rel=4 * (2 / N) ** 0.5)


@pytest.mark.parametrize(("bits", "kind"), [(8, np.uint8), (12, np.uint16)])
def test_counts_end_at_both_ends(bits: int, kind: type) -> None:
    image = np.array([[-0.1, 0.0, 2.0]])
    chip = Chip(full_well_e=1e6, read_noise_e=1.0, bits=bits)
    counts = counted(image, chip, np.random.default_rng(0))
    assert counts.dtype == kind
    assert counts.tolist()[0][2] == 2**bits - 1
    assert counts.max() == 2**bits - 1


def test_no_converter_has_17_bits() -> None:
    with pytest.raises(ValueError, match="bits"):
        Chip(full_well_e=1.0, read_noise_e=0.0, bits=17)


def test_a_response_bends_cuts_darkness_off_and_saturates() -> None:
    chip = Chip(full_well_e=1e12, read_noise_e=0.0, bits=8, response=ROWS)
    light = np.array([[0.0, 2e-4, 0.2025, 1.0, 1.7]])
    counts = counted(light, chip, np.random.default_rng(0)).tolist()[0]
    assert counts == [0, 0, round(-4 + 251 * 0.45), 247, 247]


def test_stated_noise_is_what_frames_vary_by() -> None:
    noise = ((0.0, 25.0), (121.5, 9.0), (247.0, 2.0))
    chip = Chip(full_well_e=1.0, read_noise_e=1e3, bits=8, response=ROWS, noise=noise)
    counts = counted(HALF / 2, chip, np.random.default_rng(2)).astype(float)
    assert counts.mean() == pytest.approx(121.5, abs=4 * 3 / N**0.5)
    assert counts.var() == pytest.approx(9.0, rel=4 * (2 / N) ** 0.5)


def test_a_pattern_stays_from_frame_to_frame() -> None:
    rng = np.random.default_rng(3)
    chip = Chip(full_well_e=1e12, read_noise_e=0.0, bits=16)
    pattern = PixelPattern.drawn((400, 500), 0.02, 300.0, rng)
    first, second = (counted(HALF, chip, rng, pattern).astype(float) for _ in "12")
    assert np.abs(first - second).max() <= 1  # of rounding
    variance = (0.02 * 0.5 * 65535) ** 2 + 300.0**2
    assert first.var() == pytest.approx(variance, rel=4 * (2 / N) ** 0.5)
    window = counted(HALF[:50, :60], chip, rng, pattern.part(20, 30, (50, 60)))
    assert np.abs(window - first[20:70, 30:90]).max() <= 1
