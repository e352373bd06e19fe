"""Peaks of sweeps: exact ones, noisy ones, and what is none."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.focus.measures import FITS, gaussian_peak
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.focus.peak import (
    FocusPeak,
    mirror_error_um,
    mirror_peak,
)

Fit = Callable[..., FocusPeak | Failure]
BOTH = pytest.mark.parametrize("fit", list(FITS.values()), ids=list(FITS))


def gaussian(z: np.ndarray, at: float, width: float) -> np.ndarray:
    return np.exp(-((z - at) ** 2) / (2 * width**2))


def lorentz(z: np.ndarray, at: float, half: float) -> np.ndarray:
    """Return what squared gradients look like: -1/s is a parabola."""
    return 1 / (1 + ((z - at) / half) ** 2)


def parabola(z: np.ndarray, s: np.ndarray) -> float:
    """Return the top through the highest three: the control."""
    i = int(np.argmax(s))
    a, b, c = s[i - 1 : i + 2]
    return float(z[i] + (z[1] - z[0]) * (a - c) / (2 * (a - 2 * b + c)))


def test_a_gaussian_is_found_exactly_where_nothing_lies_below_it() -> None:
    z = np.arange(-60.0, 60.1, 4.0)
    found = gaussian_peak(z, gaussian(z, 1.3, 7.0))
    assert isinstance(found, FocusPeak)
    assert found.z_um == pytest.approx(1.3, abs=1e-6)
    assert found.width_um == pytest.approx(7.0, rel=1e-6)
    assert found.sigma_um < 1e-5


@given(at=st.floats(-4, 4), level=st.floats(0, 5), gain=st.floats(1e-6, 1e6))
@settings(max_examples=25, deadline=None)
def test_a_mirror_image_is_found_whatever_its_level(
    at: float, level: float, gain: float
) -> None:
    z = np.arange(-40.0, 40.1, 2.0)
    found = mirror_peak(z, gain * (level + lorentz(z, at, 6.0)))
    assert isinstance(found, FocusPeak)
    # stops a third of a width apart: what they leave undrawn, three of it
    assert abs(found.z_um - at) < 3 * mirror_error_um(2.0, 5.1)


@given(shift=st.floats(-1e3, 1e3), turned=st.booleans())
@settings(max_examples=25, deadline=None)
def test_peaks_move_and_turn_with_the_stops(shift: float, turned: bool) -> None:
    z = np.arange(-30.0, 30.1, 3.0)
    s = 0.1 + lorentz(z, 0.8, 7.0)
    for fit in FITS.values():
        plain = fit(z, s)
        moved = fit(-(z + shift)[::-1], s[::-1]) if turned else fit(z + shift, s)
        assert isinstance(plain, FocusPeak)
        assert isinstance(moved, FocusPeak)
        expected = -(plain.z_um + shift) if turned else plain.z_um + shift
        assert moved.z_um == pytest.approx(expected, abs=1e-6)
        assert moved.width_um == pytest.approx(plain.width_um, rel=1e-6)


def test_the_width_is_that_of_a_gaussian() -> None:
    z = np.arange(-40.0, 40.1, 2.0)
    found = mirror_peak(z, 0.2 + gaussian(z, 0.4, 6.0))
    assert isinstance(found, FocusPeak)
    # straight between stops h = w/3 apart: off by h^2/8 times the curvature of -1/s
    # over its slope, which is near 1/w at half height: .02 w
    assert found.width_um == pytest.approx(6.0, rel=0.02)


def test_a_parabola_is_worse_on_coarse_stops() -> None:
    z = np.arange(-30.0, 30.1, 5.0)
    worst = {"mirror": 0.0, "gaussian": 0.0, "parabola": 0.0}
    for at in np.linspace(-2.5, 2.5, 11):
        s = 0.08 + lorentz(z, at, 6.0)
        found = {"parabola": parabola(z, s)}
        for name, fit in FITS.items():
            peak = fit(z, s)
            assert isinstance(peak, FocusPeak)
            found[name] = peak.z_um
        for name, top in found.items():
            worst[name] = max(worst[name], abs(top - at))
    assert worst["parabola"] > 0.15  # um, the least that is reported of it
    assert worst["mirror"] < worst["gaussian"] < worst["parabola"]


def noisy_ratio(fit: Fit, *, spread: float, **known: float) -> tuple[float, float]:
    """Return rms sigma over rms error, and the mean squared ratio of error to sigma."""
    z, rng = np.arange(-40.0, 40.1, 2.5), np.random.default_rng(7)
    errors, sigmas = [], []
    for _ in range(300):
        at = rng.uniform(-2, 2)
        s = 0.2 + lorentz(z, at, 9) + spread * rng.standard_normal(len(z))
        found = fit(z, s, **known)
        assert isinstance(found, FocusPeak)
        errors.append(found.z_um - at)
        sigmas.append(found.sigma_um)
    e, s = np.array(errors), np.array(sigmas)
    return float(np.sqrt(np.mean(s**2) / np.mean(e**2))), float(np.mean((e / s) ** 2))


@BOTH
def test_its_error_estimate_is_honest(fit: Fit) -> None:
    # few stops, so the estimate scatters; on average it is within a factor of two
    assert 0.5 < noisy_ratio(fit, spread=0.02)[0] < 2


def test_known_noise_makes_the_estimate_exact() -> None:
    _, squared = noisy_ratio(mirror_peak, spread=0.02, noise=0.02)
    # 300 normal errors: the mean square scatters by sqrt(2 / 300) = .08; 3 of them
    assert squared == pytest.approx(1, abs=0.25)


def test_known_noise_is_not_believed_where_the_curve_is_no_mirror() -> None:
    z = np.arange(-40.0, 40.1, 2.5)
    tilted = lorentz(z, 0.0, 9.0) * (1 + 0.02 * z)
    blind = mirror_peak(z, tilted, noise=1e-6)
    assert isinstance(blind, FocusPeak)
    assert blind.sigma_um > 0.05


@BOTH
@pytest.mark.parametrize(
    ("scores", "code"),
    [
        ([1.0, 1.01, 1.02, 1.01, 1.0, 1.0], "flat"),
        ([0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "flat"),
        ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "border"),
        ([6.0, 5.0, 3.0, 1.0, 1.0, 1.0], "border"),
        ([0.0, 5.0, 1.0, 5.0, 5.0, 0.0], "several_peaks"),
        ([0.0, 0.0, 0.0, 9.0, 0.0, 0.0], "coarse"),
        ([0.0, 1.0, 2.0, 1.0], "few_stops"),
    ],
)
def test_what_is_no_peak_is_refused(fit: Fit, scores: list[float], code: str) -> None:
    found = fit(np.arange(len(scores), dtype=float), scores)
    assert isinstance(found, Failure)
    assert found.code == code


@BOTH
@given(
    scores=st.lists(st.floats(-1e6, 1e6), min_size=5, max_size=12),
    start=st.floats(-100, 100),
)
@settings(max_examples=60, deadline=None)
def test_any_scores_give_a_peak_in_the_sweep_or_a_failure(
    fit: Fit, scores: list[float], start: float
) -> None:
    z = start + 2.0 * np.arange(len(scores))
    found = fit(z, scores)
    if isinstance(found, FocusPeak):
        assert z[0] < found.z_um < z[-1]
        assert 0 <= found.sigma_um < math.inf
        assert 0 < found.width_um < math.inf
    else:
        assert found.message


def test_stops_at_exactly_half_the_height_are_no_error() -> None:
    rng = np.random.default_rng(0)
    for low, high in np.sort(rng.random((200, 2))):
        half = (low + high) / 2
        for last in (half, np.nextafter(half, low)):
            found = mirror_peak(range(5), [low, half, high, high, last])
            assert isinstance(found, FocusPeak | Failure)


@pytest.mark.parametrize("size", [1e-300, 1e-100, 1e100, 1e300])
def test_the_size_of_scores_does_not_matter(size: float) -> None:
    z = np.arange(0.0, 18.0, 2.0)
    usual, found = (
        mirror_peak(z, scale * (0.1 + lorentz(z, 8.3, 4.0))) for scale in (1.0, size)
    )
    assert isinstance(usual, FocusPeak)
    assert isinstance(found, FocusPeak)
    # scores round by 1e-16 of themselves
    assert found.z_um == pytest.approx(usual.z_um, rel=1e-12)
    assert found.sigma_um == pytest.approx(usual.sigma_um, rel=1e-6)


@BOTH
def test_nonsense_is_an_error(fit: Fit) -> None:
    with pytest.raises(ValueError, match="finite"):
        fit([0, 1, 2, 3, 4], [0, 1, math.nan, 1, 0])
    with pytest.raises(ValueError, match="rise"):
        fit([0, 1, 1, 3, 4], [0, 1, 2, 1, 0])
    with pytest.raises(ValueError, match="as many"):
        fit([0, 1, 2], [0, 1])


def test_noise_is_not_negative() -> None:
    with pytest.raises(ValueError, match="noise"):
        mirror_peak([0, 1, 2, 3, 4], [0, 1, 2, 1, 0], noise=-0.1)
