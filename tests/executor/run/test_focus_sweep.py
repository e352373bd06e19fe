"""Heights by focus: the curve is kept, false peaks are refused, each by its name."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.focus.heights import answers
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.run.focus_sweep import (
    LEAST_HEIGHT,
    Height,
    SharpnessCurve,
    peak_of,
    unbiased,
)
from microplan.schemas.codec import from_data
from microplan.schemas.plan import HeightSearch

STOPS = np.linspace(70.0, 130.0, 19)


def hill(middle_um: float, width_um: float = 8.0, height: float = 1.0) -> np.ndarray:
    """Return what a squared gradient looks like over the stops."""
    return np.asarray(0.1 + height / (1 + ((STOPS - middle_um) / width_um) ** 2))


def curve(scores: np.ndarray, noise: float = 1e-3) -> SharpnessCurve:
    return SharpnessCurve(
        focus_um=tuple(STOPS.tolist()), scores=tuple(scores.tolist()), noise=noise
    )


@pytest.mark.parametrize("middle_um", [88.0, 100.0, 101.3, 112.9])
def test_a_peak_is_found_between_its_stops(middle_um: float) -> None:
    found = peak_of(curve(hill(middle_um)), "gear")
    # what stops 3.3 um apart leave undrawn of a peak 6.8 um wide, and it says so
    assert abs(found.z_um - middle_um) < 4 * found.sigma_um
    assert found.sigma_um < 0.05


RNG = np.random.default_rng(4)


@pytest.mark.parametrize(
    ("cause", "scores", "noise"),
    [
        ("border", hill(71.0), 1e-3),
        ("border", hill(129.0), 1e-3),
        ("several_peaks", hill(85.0) + hill(115.0), 1e-3),
        ("several_peaks", hill(85.0) + hill(115.0, height=0.7), 1e-3),
        ("flat", np.full(19, 0.4), 0.0),
        ("flat", hill(100.0, height=0.01), 1e-3),
        ("flat", hill(100.0, height=0.01), 1e-2),
        ("flat", 0.4 + 0.1 * RNG.standard_normal(19), 0.1),
        ("coarse", hill(100.0, width_um=1.0), 1e-3),
    ],
)
def test_a_false_peak_is_refused_by_its_name(
    cause: str, scores: np.ndarray, noise: float
) -> None:
    with pytest.raises(ExecutorError) as refused:
        peak_of(curve(scores, noise), "gear")
    assert (refused.value.code, refused.value.cause) == ("MP853", cause)


def test_noise_alone_hardly_ever_stands_out_of_itself() -> None:
    draws = np.random.default_rng(1).standard_normal((20_000, 19))
    spans = np.ptp(draws, axis=1)
    assert (spans > LEAST_HEIGHT).sum() == 0  # chance 3e-6 each


@pytest.mark.parametrize(
    ("way", "seeds"),
    [("sweep", 2), pytest.param("two_pairs", 1, marks=pytest.mark.slow)],
)
def test_heights_on_the_cell_are_as_good_as_its_focus_repeats(
    way: str, seeds: int
) -> None:
    # .5 um at each stop; another blur law, a wider aperture, noise
    found = answers(way, seeds)
    for each in found:
        assert each.error_um is not None
        assert abs(each.error_um) < 4 * 0.5


@pytest.mark.parametrize(
    ("more", "height_um", "sigma_um"),
    [
        ({}, 101.0, 0.3),  # of a plan before 2.8
        ({"bias_um": -0.5, "bias_half_width_um": 0.784}, 101.5, 0.5),  # .784 = 1.96 .4
    ],
)
def test_what_the_plan_states_is_off_the_peak_and_in_its_sigma(
    more: dict[str, float], height_um: float, sigma_um: float
) -> None:
    data = {
        "look": "x", "expected_um": 100.0, "within_um": 10.0, "focus_um": [90.0, 110.0],
        "ring_radius_um": 0.0, **more,
    }  # fmt: skip
    peak = Height(z_um=101.0, sigma_um=0.3, seconds=1.0)
    found = unbiased(peak, from_data(HeightSearch, data))
    assert found.z_um == pytest.approx(height_um)
    assert found.sigma_um == pytest.approx(sigma_um)


def test_a_sweep_tells_its_height_without_the_plans_bias() -> None:
    (plain,), (moved,) = answers("sweep", 1), answers("sweep", 1, bias_um=0.75)
    assert plain.error_um is not None
    assert moved.error_um is not None
    assert moved.error_um == pytest.approx(plain.error_um - 0.75, abs=1e-9)
