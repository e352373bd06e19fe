"""Responses from pictures in several lights: what a camera was given comes out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.optics.lens.response import Response
from microplan.planner.calibration.estimates import Refused
from microplan.planner.calibration.response.light_levels import (
    LightLevels,
    LightStep,
    weighted,
)
from microplan.planner.calibration.response.response_curves import (
    LightCurve,
    common_errors,
    power_curve,
    rows_of,
    table_curve,
)
from microplan.planner.calibration.response.response_fit import (
    ResponseFit,
    fit_response,
)
from microplan.planner.calibration.still_frames import StillScene
from tests.planner.calibration.simulated_camera import Camera, patches, power

READINGS = np.geomspace(0.08, 0.95, 10)


def rng_of(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def fitted(steps: Sequence[LightStep], top: int = 4095) -> ResponseFit:
    found = fit_response(steps, top)
    assert isinstance(found, ResponseFit), found
    return found


def refused(steps: Sequence[LightStep], top: int = 255) -> Refused:
    found = fit_response(steps, top)
    assert isinstance(found, Refused)
    assert found.take
    return found


def still(pictures: Sequence[FloatArray], top: int = 255) -> list[LightStep]:
    """Return single frames in lights 1, 2, 3 and so on."""
    return [
        LightStep(light=1.0 + k, scene=StillScene.of(picture, top))
        for k, picture in enumerate(pictures)
    ]


def test_power_and_black_level_come_out_within_their_deviations() -> None:
    """Of 8, 12 and 16 bits, of black levels seen and cut off, of readings that err."""
    pulls = []
    for seed in range(12):
        gamma, black = ((1.0, 0.03), (0.5, -0.08), (0.45, 0.08), (1.6, 0.0))[seed % 4]
        top = (255, 4095, 65535)[seed % 3]
        camera = Camera(
            top=top, white=top, black=black * top, response=power(gamma),
            flicker=0.002, shake_px=0.1,
        )  # fmt: skip
        error = (0.0, 0.004, 0.01)[seed % 3]
        steps = camera.steps(patches(), READINGS, rng_of(seed), reading_error=error)
        found = fitted(steps, top)
        assert found.kind == "power"
        assert (found.rows, found.row_sigmas) == ((), ())
        assert found.gamma.sigma is not None
        assert found.black.sigma is not None
        off = (found.gamma.value - gamma, found.black.value - black * top)
        pulls.append((off[0] / found.gamma.sigma, off[1] / found.black.sigma))
    assert np.max(np.abs(pulls)) < 4
    for square in np.mean(np.square(pulls), axis=0):
        assert 0.4 < square < 2.5


def logarithm(share: FloatArray) -> FloatArray:
    return np.asarray(np.log1p(20 * np.clip(share, 0, None)) / np.log(21))


def bent(share: FloatArray) -> FloatArray:
    root = np.clip(share, 0, 1.3) ** 0.5
    return np.asarray(0.8 * root + 0.2 * root**2 * (3 - 2 * root))


@pytest.mark.parametrize("response", [logarithm, bent])
@pytest.mark.parametrize("reading_error", [0.0, 0.003])
def test_a_table_is_taken_where_it_tells_lights_left_out_better(
    response: object, reading_error: float
) -> None:
    """Up to a factor of the light, where levels were seen; a camera can be made of it.

    Within 1 % of full scale.
    """
    assert callable(response)
    camera = Camera(response=response, black=50)
    lights = np.geomspace(0.05, 0.95, 11)
    steps = camera.steps(patches(), lights, rng_of(5), reading_error=reading_error)
    found = fitted(steps)
    assert found.kind == "table"
    assert found.held_out_table is not None
    assert found.held_out_table < 0.9 * found.held_out_power
    assert found.black.sigma is None
    assert all(sigma is not None for sigma in found.row_sigmas)
    share, level = np.array(found.rows).T
    counts = found.black.value + (found.white - found.black.value) * level
    grid = np.linspace(0, 1, 5000)
    own = np.interp(counts, 50 + 4045 * response(grid), grid)
    inside = (level > found.seen[0]) & (level < found.seen[1])
    factor = np.exp(np.mean(np.log(own[inside] / share[inside])))
    assert factor == pytest.approx(1, abs=0.05)
    true = 50 + 4045 * response(factor * share)
    assert np.abs(counts - true)[inside].max() < 0.01 * 4095
    made = Response.from_levels(found.rows, found.black.value, found.white)
    assert made.counts[-1] == pytest.approx(found.white)


def test_frames_without_light_tell_the_black_level_of_a_table() -> None:
    camera = Camera(response=logarithm, black=300)
    lights = np.concatenate((np.zeros(2), np.geomspace(0.05, 0.95, 11)))
    found = fitted(camera.steps(patches(), lights, rng_of(1)))
    assert found.kind == "table"
    assert found.black.value == pytest.approx(300, abs=2)
    assert found.black.sigma is not None


def test_saturation_is_left_out_and_gives_the_white_level() -> None:
    camera = Camera(top=255, white=240, response=power(0.6), black=10)
    steps = camera.steps(patches(), np.geomspace(0.08, 1.6, 12), rng_of(2))
    found = fitted(steps, 255)
    assert (found.white, found.white_is_seen) == (240, True)
    assert found.gamma.sigma is not None
    assert abs(found.gamma.value - 0.6) < 4 * found.gamma.sigma
    dim = fitted(camera.steps(patches(), 0.8 * READINGS, rng_of(2)), 255)
    assert (dim.white, dim.white_is_seen) == (255, False)


def test_five_lights_tell_a_response_without_a_deviation() -> None:
    camera = Camera(response=power(0.7))
    found = fitted(camera.steps(patches(), np.linspace(0.1, 0.9, 5), rng_of(0)))
    assert found.gamma.value == pytest.approx(0.7, abs=0.02)
    assert (found.gamma.sigma, found.black.sigma, found.lights) == (None, None, 5)


def test_noise_of_the_darkest_pixels_is_no_bound_to_the_black_level() -> None:
    """Their means are below it by chance."""
    camera = Camera(top=255, white=255, black=8, full_well_e=20_000, read_e=80)
    light = patches()
    light[:32] *= 0.01
    for seed in range(4):
        found = fitted(camera.steps(light, READINGS, rng_of(seed)), 255)
        assert found.gamma.sigma is not None
        assert found.black.sigma is not None
        assert abs(found.gamma.value - 1) < 4 * found.gamma.sigma
        assert abs(found.black.value - 8) < 4 * found.black.sigma


def test_order_and_unit_of_readings_do_not_matter() -> None:
    camera = Camera(response=power(0.7))
    steps = camera.steps(patches(), READINGS, rng_of(0))
    other = [LightStep(light=255 * step.light, scene=step.scene) for step in steps]
    found, again = fitted(steps), fitted(other[::-1])
    assert again.gamma.value == pytest.approx(found.gamma.value, rel=1e-5)
    assert again.gamma.sigma == pytest.approx(found.gamma.sigma, rel=1e-2)


def test_pixels_that_moved_or_are_defective_are_left_out() -> None:
    camera = Camera(response=power(0.7))
    rng = rng_of(3)
    steps = []
    for light in READINGS.tolist():
        scene = StillScene.of(camera.frame(patches() * light, rng), 4095)
        for frame in camera.frames(patches() * light, 3, rng):
            scene.add(frame)
        scene.total[:6] = scene.frames * rng.uniform(500, 2500)  # a strip that moves
        steps.append(LightStep(light=light, scene=scene))
    found = fitted(steps)
    assert found.pixels < 1200
    assert found.gamma.value == pytest.approx(0.7, abs=0.02)


def test_fewer_than_five_lights_are_refused() -> None:
    camera = Camera()
    few = READINGS[:4]
    for readings in (few, np.repeat(few, 3), np.zeros(9), few[:0]):
        steps = camera.steps(patches(), readings, rng_of(0), count=1)
        assert "different lights, 5 are needed" in refused(steps, 4095).why
    assert "10 different lights" in refused([], 4095).take


def test_readings_that_are_no_light_are_refused() -> None:
    scene = StillScene.of(np.full((8, 8), 90.0), 255)
    for wrong in (-1.0, float("nan"), float("inf")):
        steps = [LightStep(light=light, scene=scene) for light in (1, 2, 3, 4, wrong)]
        assert "must be 0 or more" in refused(steps).why


def test_pictures_of_several_sizes_are_refused() -> None:
    steps = still([np.full((8, 8 + k), 90.0) for k in range(6)])
    assert "not of one size" in refused(steps).why


@pytest.mark.parametrize("shape", [(16, 16), (2, 2), (1, 1), (1, 40)])
def test_pictures_of_one_level_are_refused(shape: tuple[int, int]) -> None:
    """Where all counts end at one level they look saturated there."""
    for level in (0.0, 255.0, 90.0):
        why = refused(still([np.full(shape, level)] * 7)).why
        assert "no pixel is clear" in why or "do not rise" in why


def test_light_that_does_not_reach_the_scene_is_refused() -> None:
    camera = Camera(top=255, white=255, read_e=100)
    steps = camera.steps(0.3 * patches(), np.full(8, 1.0), rng_of(0))
    still_lit = [
        LightStep(light=1.0 + k, scene=step.scene) for k, step in enumerate(steps)
    ]
    assert "do not rise" in refused(still_lit).why


def test_too_little_light_between_the_lights_is_refused() -> None:
    steps = Camera().steps(patches(), np.linspace(0.6, 0.9, 8), rng_of(0))
    assert "of the brightest" in refused(steps, 4095).why


def test_counts_that_fall_with_the_readings_are_refused() -> None:
    steps = Camera(black=0).steps(patches(), READINGS, rng_of(0))
    scenes = [step.scene for step in steps[::-1]]
    wrong = [
        LightStep(light=light, scene=scene)
        for light, scene in zip(READINGS.tolist(), scenes, strict=True)
    ]
    assert "do not follow" in refused(wrong, 4095).why


def test_small_pictures_tell_a_response() -> None:
    camera = Camera(response=power(0.7))
    light = np.array([[0.2, 0.5], [0.7, 1.0]])
    found = fitted(camera.steps(light, READINGS, rng_of(0), count=30))
    assert found.gamma.sigma is not None
    assert abs(found.gamma.value - 0.7) < 4 * found.gamma.sigma


def test_levels_of_no_span_are_no_table() -> None:
    """No bend can be told from one level: the power stays as it is."""
    level = np.full((3, 5), 90.0)
    lights = np.linspace(0.2, 1, 5)
    levels = LightLevels(
        lights=lights, means=level, sigmas=level / 90, weights=level / 90,
        frames=np.ones(5),
    )  # fmt: skip
    none = np.zeros(1)
    straight = LightCurve(black=0.0, gamma=1.0, knots=none, bends=none)
    np.testing.assert_array_equal(table_curve(levels, straight).bends, none)


def test_a_curve_whose_light_falls_with_the_level_is_no_table() -> None:
    """However far it falls."""
    knots = np.array([10.0, 100.0, 250.0])
    for fall in (5.0, 1e4):
        curve = LightCurve(black=0.0, gamma=1.0, knots=knots, bends=-fall * knots)
        assert rows_of(curve, 255.0) is None


def test_whatever_pictures_show_there_is_an_answer() -> None:
    """Noise, single bright pixels, halves that are cut off, of 8 and 16 bits."""
    for seed in range(40):
        rng = rng_of(seed)
        top = (1, 255, 65535)[seed % 3]
        shape = tuple(rng.integers(1, 9, 2).tolist())
        pictures = []
        for _ in range(7):
            picture = rng.integers(0, top + 1, shape).astype(float)
            picture[rng.random(shape) < 0.3 * (seed % 4)] = rng.choice([0, top])
            pictures.append(picture)
        steps = still(pictures, top)
        if seed % 2:
            for step in steps:
                step.scene.add(rng.permutation(step.scene.total.ravel()).reshape(shape))
        assert isinstance(fit_response(steps, top), ResponseFit | Refused)


def test_readings_that_err_alike_are_known_to_do_so() -> None:
    """Of five lights, three numbers are fitted: gamma, black and the exposure.

    The mean variance of 40 fits is that of their numbers to a quarter or so.
    """
    lights, found, stated = np.geomspace(0.1, 1.0, 5), [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        true = lights * (1 + rng.normal(0, 0.01, lights.size))
        means = 100 + 3500 * rng.uniform(0.2, 0.9, 60)[:, None] * true
        levels = LightLevels(
            lights=lights, means=means, sigmas=np.full(means.shape, 10.0),
            weights=np.zeros(means.shape), frames=np.full(lights.size, 8.0),
        )  # fmt: skip
        levels = weighted(levels, np.ones(means.shape, dtype=np.bool_))
        power = power_curve(levels)
        found.append([power.gamma, power.black])
        stated.append(common_errors(levels, power))
    ratio = np.mean(stated, axis=0) / np.var(found, axis=0, ddof=1)
    assert (ratio > 0.9).all()
    assert (ratio < 2).all()
