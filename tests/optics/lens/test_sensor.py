"""Noise statistics, quantisation and saturation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.optics.lens.sensor import Sensor, expose, to_unit

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


@pytest.mark.parametrize("gain", [0.5, 1.0, 4.0])
def test_the_photon_transfer_curve_gives_the_gain_and_the_noise(gain: float) -> None:
    """The way a camera is measured: variance over mean, a line in counts."""
    sensor = Sensor(full_well_e=10_000, read_noise_e=10, bits=12, gain=gain)
    count, levels = 40_000, np.linspace(0.02, 0.85, 12) / max(gain, 1.0)
    rng = np.random.default_rng(12)
    frames = [expose(_flat(level, count), sensor, rng) for level in levels]
    mean = np.array([frame.mean() for frame in frames])
    variance = np.array([frame.var(ddof=1) for frame in frames])
    k = gain * 4095 / 10_000
    expected = k**2 * (levels * 10_000 + 10**2) + 1 / 12
    # four standard errors of a mean and of a variance, which is nearly Gaussian here
    assert (np.abs(mean - k * levels * 10_000) < 4 * np.sqrt(expected / count)).all()
    spread = expected * math.sqrt(2 / count)
    assert (np.abs(variance - expected) < 4 * spread).all()
    (slope, offset), covariance = np.polyfit(
        mean, variance, 1, w=1 / spread, cov="unscaled"
    )
    error = 4 * np.sqrt(np.diag(covariance))
    assert slope == pytest.approx(k, abs=error[0])
    assert offset == pytest.approx(k**2 * 10**2 + 1 / 12, abs=error[1])
    assert error[0] < 0.02 * k  # the curve does measure the gain


@pytest.mark.parametrize(
    ("gain", "level", "count"),
    [
        (1.0, 1.5, 255),
        (2.0, 0.6, 255),  # the converter's top at half of full well
        (2.0, 0.25, 127),  # or 128: 127.5 and shot noise
        (0.4, 1.5, 102),  # full well at .4 of the top
        (0.4, 1e9, 102),
        (1e9, 1e-3, 255),
        (1e-9, 1.0, 0),
        (3.0, 0.0, 0),
    ],
)
def test_gain_says_where_counts_end(gain: float, level: float, count: int) -> None:
    sensor = Sensor(full_well_e=1e12, read_noise_e=0, bits=8, gain=gain)
    counts = expose(np.full(20, level), sensor, np.random.default_rng(4))
    # shot noise is 1e-6 of full well, far below a count
    assert np.abs(counts.astype(int) - count).max() <= (count == 127)


def test_a_gain_of_one_changes_nothing() -> None:
    image = np.random.default_rng(2).uniform(-0.2, 1.4, 5000)
    sensor = Sensor(full_well_e=7_000, read_noise_e=12, bits=10)
    frame = expose(image, sensor, np.random.default_rng(9))
    rng = np.random.default_rng(9)
    electrons = rng.poisson(np.clip(image, 0, 2) * 7_000) + 12 * rng.standard_normal(
        5000
    )
    plain = np.clip(np.rint(electrons / 7_000 * 1023), 0, 1023)
    np.testing.assert_array_equal(frame, plain)


@pytest.mark.parametrize("bits", [8, 12])
def test_shot_noise_is_white_and_that_of_its_seed(bits: int) -> None:
    sensor = Sensor(full_well_e=10_000, read_noise_e=10, bits=bits)
    frame = expose(np.full((300, 300), 0.5), sensor, np.random.default_rng(21))
    noise = frame - frame.mean()
    neighbours = [
        (noise[1:] * noise[:-1]).mean(),
        (noise[:, 1:] * noise[:, :-1]).mean(),
    ]
    # four standard errors of a correlation of 300 x 299 pairs
    assert np.abs(neighbours).max() < 4 * noise.var() / math.sqrt(300 * 299)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_gain_that_cannot_be_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="gain must be positive"):
        Sensor(full_well_e=1000, read_noise_e=1, bits=8, gain=value)


@given(
    st.floats(-10, 10),
    st.integers(1, 16),
    st.floats(0, 1e4),
    st.floats(1e-6, 1e6),
)
def test_counts_stay_in_range(
    level: float, bits: int, read_noise_e: float, gain: float
) -> None:
    sensor = Sensor(full_well_e=1000, read_noise_e=read_noise_e, bits=bits, gain=gain)
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
