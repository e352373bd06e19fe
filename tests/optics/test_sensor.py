"""Noise statistics, quantisation and saturation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optics.sensor import Sensor, expose, to_unit

SENSOR = Sensor(full_well_e=10_000, read_noise_e=10, bits=8)


def _flat(
    level: float, count: int = 200_000
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.full(count, level)


@pytest.mark.parametrize("level", [0.1, 0.5, 0.9])
def test_variance_is_shot_read_and_quantisation(level: float) -> None:
    counts = expose(_flat(level), SENSOR, np.random.default_rng(1))
    electrons = to_unit(counts, 8) * 10_000
    step = 10_000 / 255
    expected = level * 10_000 + 10**2 + step**2 / 12
    # 200 000 samples: 1 % is three standard errors of a variance
    assert np.var(electrons) == pytest.approx(expected, rel=0.01)
    assert np.mean(electrons) == pytest.approx(level * 10_000, abs=3 * 0.25)


def test_a_16_bit_sensor_counts_in_uint16() -> None:
    sensor = Sensor(full_well_e=30_000, read_noise_e=5, bits=12)
    counts = expose(_flat(0.5, 1000), sensor, np.random.default_rng(1))
    assert counts.dtype == np.uint16
    assert to_unit(counts, 12).mean() == pytest.approx(0.5, abs=0.001)
    assert expose(_flat(0.5, 3), SENSOR, np.random.default_rng(1)).dtype == np.uint8


def test_light_beyond_full_well_saturates_and_below_zero_is_dark() -> None:
    sensor = Sensor(full_well_e=10_000, read_noise_e=0, bits=8)
    image = np.array([1.2, 1e6, 0.0, -0.3])
    counts = expose(image, sensor, np.random.default_rng(1))
    np.testing.assert_array_equal(counts, np.array([255, 255, 0, 0], dtype=np.uint8))


def test_the_same_seed_gives_the_same_frame() -> None:
    one, other = (
        expose(_flat(0.3, 500), SENSOR, np.random.default_rng(5)) for _ in range(2)
    )
    np.testing.assert_array_equal(one, other)
    third = expose(_flat(0.3, 500), SENSOR, np.random.default_rng(6))
    assert (one != third).any()


@given(st.floats(-10, 10), st.integers(1, 16), st.floats(0, 1e4))
def test_counts_stay_in_range(level: float, bits: int, read_noise_e: float) -> None:
    sensor = Sensor(full_well_e=1000, read_noise_e=read_noise_e, bits=bits)
    counts = expose(_flat(level, 50), sensor, np.random.default_rng(0))
    assert counts.max() <= sensor.top_count
    unit = to_unit(counts, bits)
    assert unit.min() >= 0
    assert unit.max() <= 1


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_numbers_that_cannot_be_are_refused(value: float) -> None:
    with pytest.raises(ValueError, match="image must be finite"):
        expose(np.array([value]), SENSOR, np.random.default_rng(0))
    with pytest.raises(ValueError, match="full_well_e"):
        Sensor(full_well_e=value, read_noise_e=1, bits=8)
    with pytest.raises(ValueError, match="read_noise_e"):
        Sensor(full_well_e=1, read_noise_e=value, bits=8)


@pytest.mark.parametrize("bits", [0, 17])
def test_bits_out_of_range_are_refused(bits: int) -> None:
    with pytest.raises(ValueError, match=r"bits must be in 1\.\.16"):
        Sensor(full_well_e=1000, read_noise_e=1, bits=bits)
    with pytest.raises(ValueError, match=r"bits must be in 1\.\.16"):
        to_unit(np.zeros(1, dtype=np.uint8), bits)
