"""A camera's response: there and back, its ends, and the noise seen through it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.executor.simulated.imaging.electrons import Chip, counted
from microplan.optics.lens.response import Response, power_rows
from microplan.optics.lens.sensor import Sensor, ends, expose, linear, noise_rows

N = 200_000
GAMMA = Response.from_levels(power_rows(0.45), black=-6.0, white=247.0)
FALLING = ((8.0, 25.0), (90.0, 17.6), (149.0, 10.2), (207.0, 4.4), (237.0, 1.7))
BENT = Sensor(full_well_e=10_000, read_noise_e=10, bits=8, response=GAMMA)
STATED = Sensor(
    full_well_e=1, read_noise_e=0, bits=8, response=GAMMA, noise=FALLING
)  # fmt: skip
UNEVEN = Sensor(
    full_well_e=1e6, read_noise_e=0, bits=12, pattern_gain=0.01, pattern_counts=8.0
)


@given(st.floats(0.3, 2.5), st.floats(-20, 40), st.floats(120, 255))
def test_light_comes_back_from_counts(gamma: float, black: float, white: float) -> None:
    response = Response.from_levels(power_rows(gamma), black=black, white=white)
    light = np.linspace(-0.01, 1.0, 400)
    back = response.share_of(response.counts_of(light))
    np.testing.assert_allclose(back, light, atol=1e-9)


@pytest.mark.parametrize("gamma", [0.3, 0.45, 0.7, 1.4, 2.2])
def test_pieces_follow_a_power(gamma: float) -> None:
    response = Response.from_levels(power_rows(gamma), black=0.0, white=1.0)
    light = np.linspace(1e-3, 1.0, 5000)
    assert np.abs(response.counts_of(light) - light**gamma).max() < 1e-3


def test_counts_are_the_response_rounded_between_its_ends() -> None:
    quiet = Sensor(full_well_e=1e13, read_noise_e=0, bits=8, response=GAMMA)
    light = np.array([0.0, 1e-4, 0.2, 0.5, 1.0, 1.9])
    counts = expose(light, quiet, np.random.default_rng(0)).tolist()
    level = [-6 + 253 * min(v, 1.0) ** 0.45 for v in light]
    assert counts[0] == 0  # cut off
    assert counts[-1] == counts[-2] == 247
    for count, wanted in zip(counts[1:], level[1:], strict=True):
        assert abs(count - max(wanted, 0.0)) <= 0.5 + 253e-3


def test_the_ends_are_where_counts_stop() -> None:
    low, high = ends(BENT)
    assert -6 + 253 * low**0.45 == pytest.approx(0.5, abs=0.26)
    assert -6 + 253 * high**0.45 == pytest.approx(246.5, abs=0.26)
    assert ends(UNEVEN) == (0.0, 1.0)


@pytest.mark.parametrize("sensor", [BENT, STATED, UNEVEN])
@pytest.mark.parametrize("light", [0.05, 0.15, 0.4, 0.7, 0.9])
def test_the_noise_of_light_is_that_of_frames(sensor: Sensor, light: float) -> None:
    """Within what the response bends over one standard deviation."""
    frame = expose(np.full(N, light), sensor, np.random.default_rng(5))
    seen = linear(frame, sensor)
    stated = float(np.interp(light, *np.transpose(noise_rows(sensor))))
    assert seen.var() == pytest.approx(stated, rel=0.06)
    assert seen.mean() == pytest.approx(light, abs=0.05 * math.sqrt(stated))


def test_a_plain_camera_is_as_its_electrons() -> None:
    """Stated as a table, its own noise is the same."""
    plain = Sensor(full_well_e=10_000, read_noise_e=10, bits=8)
    levels = np.arange(0.0, 256.0, 5.0)
    step = 10_000 / 255
    rows = [(c, c / step + (10 / step) ** 2 + 1 / 12) for c in levels.tolist()]
    table = Sensor(full_well_e=1, read_noise_e=0, bits=8, noise=tuple(rows))
    light = np.full(N, 0.6)
    a, b = (
        linear(expose(light, each, np.random.default_rng(1)), each)
        for each in (plain, table)
    )
    assert a.var() == pytest.approx(b.var(), rel=5 * (2 * 2 / N) ** 0.5)
    assert a.mean() == pytest.approx(b.mean(), abs=5 * (2 * a.var() / N) ** 0.5)


@pytest.mark.parametrize(
    ("shares", "counts"),
    [
        ((0.0, 1.0), (5.0, 5.0)),
        ((0.0, 0.5, 0.5, 1.0), (0.0, 1.0, 2.0, 3.0)),
        ((0.1, 1.0), (0.0, 255.0)),
        ((0.0, 1.0), (0.0, math.nan)),
        ((0.0, 0.5, 1.0), (0.0, 255.0)),
        ((0.0,), (0.0,)),
    ],
)
def test_no_response_stands_still_or_runs_back(
    shares: tuple[float, ...], counts: tuple[float, ...]
) -> None:
    with pytest.raises(ValueError, match=r"shares|counts"):
        Response(shares=shares, counts=counts)


@pytest.mark.parametrize("gamma", [0.0, -1.0, math.nan, math.inf])
def test_a_power_is_positive(gamma: float) -> None:
    with pytest.raises(ValueError, match="gamma"):
        power_rows(gamma)


@pytest.mark.parametrize("noise", [((5.0, 1.0), (5.0, 2.0)), ((1.0, -1.0),)])
def test_stated_noise_rises_and_is_no_less_than_none(
    noise: tuple[tuple[float, float], ...],
) -> None:
    with pytest.raises(ValueError, match="noise"):
        Sensor(full_well_e=1, read_noise_e=0, bits=8, noise=noise)


@pytest.mark.parametrize("gamma", [0.45, 1.4, 2.2, 5.0])
def test_noise_below_darkness_is_no_large_light(gamma: float) -> None:
    """A power above 1 begins flat: counts below black are not divided by that."""
    response = Response.from_levels(power_rows(gamma), black=10.0, white=250.0)
    below = response.share_of(np.arange(0.0, 10.0))
    assert (below <= 0).all()
    assert below.min() >= -10 / 240
    np.testing.assert_allclose(response.counts_of(below), np.arange(0.0, 10.0))


@pytest.mark.parametrize("light", [0.0, 0.02, 0.04, 0.1, 0.5, 0.95])
@pytest.mark.parametrize("black", [-5.0, 0.0, 10.0])
@pytest.mark.parametrize("gamma", [1.4, 2.2])
def test_noise_of_a_response_that_begins_flat_is_that_of_frames(
    gamma: float, black: float, light: float
) -> None:
    response = Response.from_levels(power_rows(gamma), black=black, white=250.0)
    sensor = Sensor(
        full_well_e=1,
        read_noise_e=0,
        bits=8,
        response=response,
        noise=((0, 4), (250, 9)),
    )
    light = max(light, ends(sensor)[0])  # below it nothing is told
    frame = expose(np.full(N, light), sensor, np.random.default_rng(7))
    stated = float(np.interp(light, *np.transpose(noise_rows(sensor))))
    assert linear(frame, sensor).std() == pytest.approx(math.sqrt(stated), rel=0.2)


def test_one_pixel_is_exposed_as_many_are() -> None:
    for light in (0.3, 1.2):
        count = expose(np.array(light), STATED, np.random.default_rng(0))
        assert count.shape == ()
        assert 0 < int(count) <= 247


def test_no_noise_is_less_than_rounding() -> None:
    sensor = Sensor(full_well_e=1, read_noise_e=0, bits=8, noise=((0, 0), (255, 0)))
    stated = np.array(noise_rows(sensor))[:, 1]
    assert stated.min() >= 0.9 / 12 / 255**2
    seen = linear(expose(np.full(N, 0.5), sensor, np.random.default_rng(0)), sensor)
    assert np.ptp(seen) <= 1 / 255


@pytest.mark.parametrize("noise", [(), ((0.0, 9.0), (250.0, 2.0))])
@pytest.mark.parametrize("response", [None, GAMMA])
def test_the_cells_chip_and_the_compilers_sensor_mean_the_same(
    noise: tuple[tuple[float, float], ...], response: Response | None
) -> None:
    """Written apart; by light up to beyond saturation."""
    light = np.repeat(np.linspace(0.0, 1.5, 31), 4000)
    sensor = Sensor(
        full_well_e=9e3, read_noise_e=8, bits=8, response=response, noise=noise
    )
    rows = () if response is None else response.rows
    chip = Chip(full_well_e=9e3, read_noise_e=8, bits=8, noise=noise, response=rows)
    one, other = (
        np.asarray(frame, dtype=float).reshape(31, -1)
        for frame in (
            expose(light, sensor, np.random.default_rng(1)),
            counted(light[None], chip, np.random.default_rng(2)),
        )
    )
    sigma = np.sqrt(one.var(axis=1) + other.var(axis=1)).max()
    apart = np.abs(one.mean(axis=1) - other.mean(axis=1))
    assert apart.max() <= 5 * sigma / math.sqrt(4000)
    assert (one[-1] == other[-1]).all()  # saturated, without noise
