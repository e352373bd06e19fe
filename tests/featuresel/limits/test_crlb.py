from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import poisson

from benchmarks.localisation.information import informative, only, together, without
from microplan.arrays import FloatArray
from microplan.featuresel.limits.crlb import camera_of, fisher, weights
from microplan.featuresel.limits.information import limit
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.sensitivity import (
    LIGHT,
    POSE,
    LookSetting,
    Sensitivities,
    sensitivities,
)
from microplan.featuresel.routines.contract import CameraNoise
from microplan.optics.lens.lens import LensErrors
from microplan.optics.lens.sensor import expose, to_unit
from microplan.optics.outline.outline import Outline, Ring, Segment
from microplan.optics.render.scene import Illumination, Layer, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.otf import hopkins

Look = Callable[[str], LookCase]

CAMERA = CameraNoise(full_well_e=10_000, read_noise_e=10, bits=8, fill_factor=1.0)


def made(mean: FloatArray, slopes: FloatArray, *names: str) -> Sensitivities:
    return Sensitivities(
        names=names, mean=mean, slopes=slopes, errors=np.zeros_like(slopes)
    )


def edge(
    look: Look, turn_rad: float = 0.0, sides: tuple[int, int] = (40, 24)
) -> LookCase:
    """Return a look at one straight edge, bright on the left at turn 0."""
    corners = [(-250.0, -250.0), (0.0, -250.0), (0.0, 250.0), (-250.0, 250.0)]
    ring = Ring(
        edges=tuple(
            Segment(start=a, end=b)
            for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
        )
    )
    face = Layer(name="face", outline=Outline(rings=(ring,)), z_um=0.0, reflectance=0.8)
    columns, rows = sides
    window = Window(
        row=240 - rows // 2, column=320 - columns // 2, rows=rows, columns=columns
    )
    case = replace(look("post"), moving=(face,), window=window, background=0.1)
    return replace(case, x_um=0.3, y_um=-0.2, theta_rad=turn_rad)


def edge_profile(
    scope: Microscope, places_um: FloatArray, z_um: float
) -> tuple[FloatArray, FloatArray]:
    """Return light (N,) beyond an edge at 0 of unit contrast, and its slope to it.

    One quadrature over frequency: 1/2 - int T sinc(f p) sin(2 pi f t) / (pi f) df.
    """
    nodes, parts = np.polynomial.legendre.leggauss(400)
    f = (nodes + 1) / 2 * scope.cutoff_per_um
    parts = parts / 2 * scope.cutoff_per_um
    waves = abs(scope.rim_w20_um(z_um)) / scope.wavelength_um
    transfer = hopkins(f / scope.cutoff_per_um, waves) * np.sinc(f * scope.um_per_px)
    angle = 2 * np.pi * np.outer(places_um, f)
    light = 0.5 - np.sin(angle) @ (parts * transfer / (np.pi * f))
    return light, 2 * np.cos(angle) @ (parts * transfer)


@pytest.mark.parametrize("z_um", [0.0, 6.0])
def test_limit_of_a_straight_edge_is_that_of_its_spread_function(
    look: Look, z_um: float
) -> None:
    case = edge(look)
    found = fisher(
        sensitivities(case, LookSetting(dz_um=z_um), ("x", "z")), camera_of(case)
    )
    scope, step = case.microscope, 1e-3
    columns = np.arange(case.window.columns, dtype=float) + case.window.column
    t = (columns - (scope.width_px - 1) / 2) * scope.um_per_px - case.x_um
    light, slope = edge_profile(scope, t, z_um)
    higher, lower = (edge_profile(scope, t, z_um + s)[0] for s in (step, -step))
    slopes = 0.7 * np.stack((slope, (higher - lower) / (2 * step)))
    electrons = 1e4 * (0.1 + 0.7 * light)
    variance = (electrons + 10**2 + (1e4 / 255) ** 2 / 12) / 1e8
    expected = case.window.rows * (slopes / variance) @ slopes.T
    # the sides 250 um away send (wavelength / A) / (250 pi**3) of the contrast, 2e-4,
    # which is 1.3e-3 of the dark side's light and so of its weight
    np.testing.assert_allclose(found.matrix, expected, rtol=1.5e-3, atol=1e-9)


def test_limit_of_a_gaussian_spot_is_the_closed_form() -> None:
    sigma_px, peak, ground = 2.5, 0.02, 0.5
    y, x = np.mgrid[-20:21, -20:21].astype(float)
    spot = np.exp(-(x**2 + y**2) / (2 * sigma_px**2))
    slopes = np.stack((peak * x * spot / sigma_px**2, spot, np.ones_like(spot)))
    flat = np.full_like(spot, ground)  # a faint spot: the noise is the ground's
    found = limit(fisher(made(flat, slopes, "x", "peak", "offset"), CAMERA))
    v = CAMERA.variance(np.array(ground))
    # sums of Gaussians over pixels are their integrals to 1e-9 at 2.5 px
    assert found["x"] == pytest.approx(math.sqrt(2 * v / math.pi) / peak, rel=1e-6)
    gram = np.array([[np.pi * sigma_px**2, 2 * np.pi * sigma_px**2], [0, spot.size]])
    gram[1, 0] = gram[0, 1]
    expected = math.sqrt(v * np.linalg.inv(gram)[0, 0])
    assert found["peak"] == pytest.approx(expected, rel=1e-6)


def test_likelihood_of_an_edge_reaches_the_limit(look: Look) -> None:
    case, z_um, draws = edge(look, sides=(24, 4)), 4.0, 4000
    seen = sensitivities(case, LookSetting(dz_um=z_um), ("x", "gain"))
    sigmas = limit(fisher(seen, camera_of(case)))
    light = np.broadcast_to(seen.mean, (draws, *seen.mean.shape))
    counts = expose(light, case.sensor, np.random.default_rng(5))
    rows = to_unit(counts, case.sensor.bits).mean(axis=1)  # they are alike
    scope = case.microscope
    columns = np.arange(24) + case.window.column - (scope.width_px - 1) / 2
    places = columns * scope.um_per_px - case.x_um
    # the estimator's model is the edge's own spread function, not the renderer
    fine = np.linspace(-16, 16, 3201)
    profile, profile_slope = edge_profile(scope, fine, z_um)
    x, gain = np.full(draws, 0.1), np.ones(draws)
    for _ in range(6):
        t = places - x[:, None]
        even = 0.1 + 0.7 * np.interp(t, fine, profile)
        slopes = 0.7 * gain[:, None] * np.interp(t, fine, profile_slope)
        mean = gain[:, None] * even
        weight = 1 / CAMERA.variance(mean)
        jac = np.stack((slopes, even), axis=1)  # (draws, 2, 24)
        told = np.einsum("dpn,dn,dqn->dpq", jac, weight, jac)
        score = np.einsum("dpn,dn->dp", jac, weight * (rows - mean))
        step = np.linalg.solve(told, score[..., None])[..., 0]
        x, gain = x + step[:, 0], gain + step[:, 1]
    for name, values in (("x", x), ("gain", gain - 1)):
        # four standard errors of a standard deviation, and of a mean
        assert values.std() == pytest.approx(sigmas[name], rel=4 / math.sqrt(2 * draws))
        assert abs(values.mean()) < 4 * sigmas[name] / math.sqrt(draws)


def told_by_counts(mean: float, camera: CameraNoise) -> float:
    """Return the information of a pixel's counts about its mean, by enumeration."""
    top, electrons = 2**camera.bits - 1, mean * camera.full_well_e
    reach = 9 * math.sqrt(electrons) + 20
    n = np.arange(max(0, math.floor(electrons - reach)), math.ceil(electrons + reach))
    chance = poisson.pmf(n, electrons)
    slope = chance * (n / electrons - 1)
    edges = (np.arange(top) + 0.5) * camera.full_well_e / top
    below = ndtr((edges[:, None] - n) / camera.read_noise_e)
    p = np.diff(np.concatenate(([0.0], below @ chance, [1.0])))
    dp = np.diff(np.concatenate(([0.0], below @ slope, [0.0])))
    seen = p > 1e-200
    return float((dp[seen] ** 2 / p[seen]).sum() * camera.full_well_e**2)


@pytest.mark.parametrize("mean", [0.05, 0.3, 0.9, 0.97, 0.99, 1.0, 1.01, 1.03, 1.1])
@pytest.mark.parametrize("well_e", [1_000, 10_000])
def test_information_of_a_pixel_is_that_of_its_counts(mean: float, well_e: int) -> None:
    camera = replace(CAMERA, full_well_e=well_e)
    usual = 1 / camera.variance(np.array(mean))
    found = weights(np.array(mean), camera)
    # a count is skew by 1 / sqrt(electrons), of which a normal density lacks a sixth
    # times third derivatives of order 1; at .05 of 1000 e- rounding is fine too
    skew = 1 / math.sqrt(well_e * mean)
    assert abs(found - told_by_counts(mean, camera)) < 0.4 * skew * usual


def test_saturated_pixels_tell_what_the_page_says() -> None:
    means = np.array([1.0, 1.02, 1.05])
    share = weights(means, CAMERA) * CAMERA.variance(means)
    assert share.round(2).tolist() == [0.76, 0.10, 0.00]


def test_pixels_in_the_dark_tell_less_than_their_counts_do() -> None:
    means = np.array([0.001, 0.002, 0.005, 0.01])
    found = weights(means, CAMERA)
    counted = [told_by_counts(mean, CAMERA) for mean in means]
    assert (found < counted).all()
    assert (found > np.array(counted) / 1.8).all()
    assert (found[2:] > 0.9 * np.array(counted[2:])).all()
    np.testing.assert_array_equal(weights(np.array([0.0, -0.1]), CAMERA), 0)


def test_full_well_below_the_top_count_ends_the_information() -> None:
    camera = replace(CAMERA, full_well_e=20_000)  # a gain of .5
    found = weights(np.array([0.45, 0.5, 0.55, 0.9]), camera, ceiling=0.5)
    usual = 1 / camera.variance(np.array([0.45, 0.5, 0.55, 0.9]))
    assert found[0] == pytest.approx(usual[0], rel=1e-6)
    assert 0.3 * usual[1] < found[1] < 0.9 * usual[1]
    assert (found[2:] < 1e-6 * usual[2:]).all()


BLIND = math.inf


def limits(
    case: LookCase, at: LookSetting | None = None, names: tuple[str, ...] = POSE + LIGHT
) -> dict[str, float]:
    return limit(fisher(sensitivities(case, at, names), camera_of(case)))


def small(look: Look) -> LookCase:
    """Return a look with a small window about its target."""
    window = Window(row=205, column=285, rows=70, columns=70)
    return replace(look("post"), window=window)


def test_one_circle_is_blind_to_theta_and_in_focus_to_z(look: Look) -> None:
    case = small(look)
    found = limits(case)
    assert (found["theta"], found["z"]) == (BLIND, BLIND)
    rest = limits(case, names=("x", "y", "zoom", *LIGHT))
    assert {name: found[name] for name in rest} == pytest.approx(rest)
    assert max(rest.values()) < 0.1
    assert limits(case, LookSetting(dz_um=0.3))["z"] < BLIND


@pytest.mark.parametrize(
    ("noll", "is_told"), [(5, True), (6, True), (8, False), (11, True)]
)
def test_a_lens_that_is_not_round_in_depth_tells_the_side_of_focus(
    look: Look, noll: int, is_told: bool
) -> None:
    """Through astigmatism and spherical aberration both sides look different.

    Coma moves all edges of a disc as much on both, to first order.
    """
    case = small(look)
    scope = replace(case.microscope, wavefront=((noll, 0.05),))
    told = limits(replace(case, microscope=scope), names=("x", "y", "z", "gain"))
    assert limits(case, names=("x", "y", "z", "gain"))["z"] == BLIND
    assert (told["z"] < BLIND) == is_told
    if is_told:
        assert told["z"] < case.microscope.wave_depth_um


@pytest.mark.parametrize("turn_rad", [0.0, 0.4])
def test_one_straight_edge_is_blind_along_itself(look: Look, turn_rad: float) -> None:
    found = limits(edge(look, turn_rad), names=("x", "y", "theta"))
    across = abs(math.cos(turn_rad)), abs(math.sin(turn_rad))
    for name, share in zip(("x", "y"), across, strict=True):
        assert (found[name] < BLIND) == (share > 0.99), name
    assert found["theta"] < 1e-3


def test_nothing_to_see_is_blind_to_all_of_the_pose(look: Look) -> None:
    case = small(look)
    none = replace(case, moving=(replace(case.moving[0], reflectance=case.background),))
    found = limits(none, LookSetting(dz_um=3.0))
    assert all(found[name] == BLIND for name in POSE)
    assert found["gradient_x"] < BLIND  # a flat field still tells the light
    assert found["gain"] == found["offset"] == BLIND  # but not these two apart
    away = limits(case, LookSetting(dx_um=800.0, dz_um=3.0), names=("x", "y", "z"))
    assert set(away.values()) == {BLIND}


def test_saturated_and_black_images_tell_nothing(look: Look) -> None:
    case = replace(small(look), background=0.4)
    for gain in (0.0, 4.0):
        light = replace(case, light=Illumination(gain=gain))
        assert set(limits(light, LookSetting(dz_um=3.0)).values()) == {BLIND}


def test_saturation_costs_what_it_hides(look: Look) -> None:
    case, camera = small(look), camera_of(small(look))
    seen = sensitivities(case, LookSetting(gain=2.0), ("x",))  # the post at 1.5
    hot = limit(fisher(seen, camera))["x"]
    lit = limit(fisher(seen, camera, mask=seen.mean < 1.05))["x"]
    endless = (seen.slopes[0] ** 2 / camera.variance(seen.mean)).sum() ** -0.5
    assert hot > 1.1 * endless
    # above 1.05 there is nothing: 5 % are five standard deviations of the noise
    assert hot == pytest.approx(lit, rel=1e-6)


def test_masked_pixels_tell_nothing(look: Look) -> None:
    case = small(look)
    seen = sensitivities(case, LookSetting(dz_um=3.0), ("x", "y", "z", "gain"))
    camera = camera_of(case)
    left = np.zeros(seen.mean.shape, dtype=np.bool_)
    assert set(limit(fisher(seen, camera, mask=left)).values()) == {BLIND}
    left[:, :33] = True
    whole = fisher(seen, camera)
    halves = together(*(fisher(seen, camera, mask=m) for m in (left, ~left)))
    np.testing.assert_allclose(halves.matrix, whole.matrix, rtol=1e-12, atol=1e-6)
    one = limit(fisher(seen, camera, mask=left))
    assert all(one[name] > limit(whole)[name] for name in seen.names)
    with pytest.raises(ValueError, match="mask must be"):
        fisher(seen, camera, mask=left[:5])


def test_occluders_take_what_they_hide(look: Look) -> None:
    free, held = (limits(look(n), names=("x",)) for n in ("find_gear", "between"))
    assert held["x"] > 1.1 * free["x"]


def test_pair_about_focus_knows_z_from_both_sides(look: Look) -> None:
    case = small(look)
    camera, light = camera_of(case), ("gain", "offset")
    names = ("x", "y", "z", *light)
    near, focus, far = (
        fisher(sensitivities(case, LookSetting(dz_um=z), names), camera)
        for z in (-8.0, 0.0, 8.0)
    )
    assert limit(focus)["z"] == BLIND
    shared = together(near, far)
    own = together(without(near, light), without(far, light))
    # x and z do not mix about a symmetric target: two equal images
    assert limit(own)["z"] == pytest.approx(limit(near)["z"] / math.sqrt(2), rel=1e-3)
    # of one lamp both images' z have opposite signs against gain and offset
    assert limit(shared)["z"] <= limit(own)["z"]
    assert limit(together(own, without(focus, light)))["x"] < limit(own)["x"]


@pytest.mark.parametrize("share", [0.5, 0.98, 1.0])
def test_few_pixels_tell_nearly_all(look: Look, share: float) -> None:
    case, wanted = small(look), ("x", "y", "theta")
    camera = camera_of(case)
    seen = sensitivities(case, names=("x", "y", "theta", "gain", "offset"))
    chosen = informative(seen, camera, wanted, share=share)
    whole = limit(fisher(seen, camera))
    told = limit(fisher(seen, camera, mask=chosen))
    kept = [(whole[name] / told[name]) ** 2 for name in ("x", "y")]
    assert share - 1e-9 < min(kept) < share + 0.01
    assert chosen.mean() < {0.5: 0.02, 0.98: 0.06, 1.0: 1.1}[share]


def test_blind_looks_have_no_informative_pixels(look: Look) -> None:
    case = small(look)
    seen = sensitivities(case, names=("z", "gain"))
    assert not informative(seen, camera_of(case), ("z",)).any()
    with pytest.raises(ValueError, match="share"):
        informative(seen, camera_of(case), ("z",), share=0.0)
    with pytest.raises(KeyError, match="theta"):
        informative(seen, camera_of(case), ("theta",))


def test_lens_that_shifts_with_focus_hides_the_place_until_z_is_known(
    look: Look,
) -> None:
    case = replace(small(look), lens=LensErrors(lateral_x=0.01))
    told = fisher(sensitivities(case, names=("x", "y", "z")), camera_of(case))
    assert limit(told)["x"] == limit(told)["z"] == BLIND
    alone = limit(only(told, ("x", "y")))
    assert limit(told)["y"] == pytest.approx(alone["y"], rel=1e-3)
    # z known to 1 um is x known to .01 um
    known = limit(told.with_prior({"z": 1.0}))["x"]
    assert known == pytest.approx(math.hypot(alone["x"], 0.01), rel=1e-3)
