"""Planned sweeps: their formula against other roads, and their limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import integrate

from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase, scene
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.focus.measures import tenengrad
from microplan.featuresel.routines.focus.peak import FocusPeak, mirror_peak
from microplan.featuresel.routines.focus.sweep import (
    FocusCurve,
    Sweep,
    focus_curve,
    plan_sweep,
    sweep_sigma_um,
)
from microplan.optics.render.render import render_stack

Look = Callable[[str], LookCase]
CURVE = FocusCurve(width_um=5.0, noise=0.002)


def plan(sigma_um: float, **changes: Any) -> Sweep:
    found = plan_sweep(
        CURVE, expected_um=100.0, within_um=10.0, sigma_um=sigma_um, **changes
    )
    assert isinstance(found, Sweep)
    return found


def test_the_formula_is_the_mirrors_own_variance() -> None:
    # pairs at x and -x of s = 1 / (1 + x^2): u' = 2 x of u = -1/s, weight 1/u, noise of
    # u = u^2; half height at 1, so that the width is 1 / sqrt(2 ln 2)
    def slope(x: float) -> float:
        return (2 * x / (1 + x * x)) ** 2

    def noise(x: float) -> float:
        return slope(x) * ((1 + x * x) ** 2 / (1 + x * x)) ** 2

    both = 2 * integrate.quad(slope, 0, 1)[0]
    variance = 2 * integrate.quad(noise, 0, 1)[0] / both**2
    step = 0.5  # so fine that nothing is undrawn
    scale = CURVE.width_um * math.sqrt(2 * math.log(2))  # um to x
    expected = CURVE.noise * math.sqrt(variance * step * scale)
    # the factor is rounded to four digits, and stops leave 1e-6 undrawn
    assert sweep_sigma_um(CURVE, step, 1) == pytest.approx(expected, rel=2e-4)
    assert sweep_sigma_um(CURVE, step, 4) == pytest.approx(expected / 2, rel=2e-4)


@pytest.mark.parametrize("sigma_um", [0.04, 0.01])
def test_what_is_predicted_is_met(sigma_um: float) -> None:
    found = plan(sigma_um, move_frames=0.0)
    z, rng, errors = np.array(found.focus_um), np.random.default_rng(2), []
    half = math.sqrt(2 * math.log(2)) * CURVE.width_um
    noise = CURVE.noise / math.sqrt(found.frames)
    for _ in range(400):
        at = 100 + rng.uniform(-10, 10)
        s = 0.1 + 1 / (1 + ((z - at) / half) ** 2)  # as squared gradients are
        peak = mirror_peak(z, s + noise * rng.standard_normal(len(z)))
        assert isinstance(peak, FocusPeak)
        errors.append(peak.z_um - at)
    # not above: the part left undrawn is stated for the worst curve; 10 % for chance
    # (sqrt(1 / 800) is 3.5 %) and for what the mirror leaves of the information
    assert 0.3 < np.std(errors) / found.sigma_um < 1.1


def test_a_plan_keeps_what_is_wanted_and_covers_the_range() -> None:
    for sigma_um in (0.1, 0.03, 0.01, 0.003, 0.001):
        found = plan(sigma_um)
        assert found.sigma_um <= sigma_um
        assert found.focus_um[0] == pytest.approx(100 - 10 - 2 * 5)
        assert found.focus_um[-1] == pytest.approx(100 + 10 + 2 * 5)
        steps = np.diff(found.focus_um)
        np.testing.assert_allclose(steps, steps[0], rtol=1e-9)
        assert steps[0] <= CURVE.width_um
        assert found.images == len(found.focus_um) * found.frames


def test_surer_costs_more() -> None:
    images = [plan(s).images for s in (0.1, 0.03, 0.01, 0.003)]
    assert images == sorted(images)
    assert images[0] < images[-1]


def test_dear_moves_make_fewer_stops_of_more_frames() -> None:
    cheap, dear = plan(0.003, move_frames=0.0), plan(0.003, move_frames=50.0)
    assert len(dear.focus_um) < len(cheap.focus_um)
    assert dear.frames > cheap.frames


def test_no_cheaper_sweep_would_do() -> None:
    found = plan(0.01)
    for gaps in range(4, 200):
        step = 40 / gaps
        for frames in range(1, found.frames + 3):
            if (
                step <= CURVE.width_um
                and sweep_sigma_um(CURVE, step, frames) <= 0.01
                and step >= 0.5
            ):
                cost = (gaps + 1) * (1 + frames)
                assert cost >= len(found.focus_um) * (1 + found.frames)


def test_what_no_camera_can_do_is_refused() -> None:
    curve = FocusCurve(width_um=5.0, noise=1.0)
    found = plan_sweep(curve, expected_um=0.0, within_um=1.0, sigma_um=1e-4)
    assert isinstance(found, Failure)
    assert found.code == "too_noisy"


@pytest.mark.parametrize(
    "changes", [{"sigma_um": 0.0}, {"within_um": -1.0}, {"move_frames": -1.0}]
)
def test_nonsense_is_an_error(changes: dict[str, float]) -> None:
    numbers = {"expected_um": 0.0, "within_um": 1.0, "sigma_um": 0.1} | changes
    with pytest.raises(ValueError, match="must"):
        plan_sweep(CURVE, **numbers)


def test_a_looks_curve_has_the_cameras_noise(
    look: Look, expose_image: Callable[..., Any]
) -> None:
    case, z = look("post"), np.arange(-24.0, 24.1, 3.0)
    images = render_stack(
        scene(case, 0, 0, 0), case.microscope, focus_um=tuple(z), window=case.window
    )
    rng = np.random.default_rng(4)
    camera = nominal_render(case).camera
    found = focus_curve(tuple(z), images, tenengrad, camera, rng, draws=40)
    assert isinstance(found, FocusCurve)
    clean = np.array([tenengrad(image) for image in images])
    # the other road: real exposures, shot by shot
    upper = images[clean >= (clean.min() + clean.max()) / 2]
    draws = [[tenengrad(expose_image(case, i, rng)) for _ in range(40)] for i in upper]
    noise = np.sqrt(np.mean(np.var(draws, axis=1, ddof=1))) / np.ptp(clean)
    # each is known to 1 / sqrt(2 * 39 * 3) = 6.5 %; 3 of both
    assert found.noise == pytest.approx(noise, rel=0.28)


def test_a_look_without_a_peak_has_no_curve(look: Look) -> None:
    camera = nominal_render(look("post")).camera
    images = np.full((6, 16, 16), 0.5)
    found = focus_curve(
        tuple(range(6)), images, tenengrad, camera, np.random.default_rng(0)
    )
    assert isinstance(found, Failure)
    assert found.code == "flat"
