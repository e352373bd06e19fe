"""Images of trials: what they are perturbed by, and what they share."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.featuresel.look.design import design
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.perturb import (
    image,
    noisier,
    sampling_at,
    shifted,
    still,
    turned,
)
from microplan.featuresel.look.scenario import LookCase, UnknownRotation, scene
from microplan.featuresel.look.unknown_surfaces import (
    UnknownSurface,
    drawn_surfaces,
)
from microplan.optics.lens.lens import LensErrors
from microplan.optics.lens.sensor import Sensor
from microplan.optics.render.render import render
from microplan.optics.render.scene import Illumination
from tests.featuresel.sharing import FINE, SHARED

Look = Callable[[str], LookCase]


def test_an_image_is_rebuilt_bit_for_bit(look: Look) -> None:
    case = look("bore")
    trial = design(case, 12, 5)[11]
    again = design(pickle.loads(pickle.dumps(case)), 40, 5)[11]
    np.testing.assert_array_equal(image(case, trial), image(case, again))
    assert not np.array_equal(image(case, trial), image(case, design(case, 12, 6)[11]))


def test_trials_that_differ_in_pose_share_what_stands_still(look: Look) -> None:
    case = look("between")
    trial = design(case, 3, 5)[2]
    assert still(case, trial)
    beside = replace(trial, dx_um=trial.dx_um + 1)
    np.testing.assert_array_equal(
        image(case, trial, still(case, beside)), image(case, trial)
    )


def test_an_image_is_the_perturbed_scene_with_noise(look: Look) -> None:
    case = look("post")
    trial = design(case, 1, 5)[0]
    calm = replace(
        trial, dz_um=0.0, magnification=1.0, gain=1.0, gradient_x=0.0, gradient_y=0.0,
        model=case.model,
    )  # fmt: skip
    place = {"dx_um": trial.dx_um, "dy_um": trial.dy_um, "theta_rad": trial.dtheta_rad}
    clean = nominal_render(case)(**place)
    noise = image(case, calm) - clean
    # shot, read and rounding noise; the bright disc is a tenth of the region
    variance = clean / 10_000 + 1e-6 + 1 / 255**2 / 12
    assert np.mean(noise**2 / variance) == pytest.approx(1.0, abs=0.05)


def test_zoom_scales_about_the_axis(look: Look) -> None:
    case = replace(look("post"), x_um=40.0)
    trial = replace(
        design(case, 1, 5)[0], dx_um=0.0, dy_um=0.0, magnification=1.02, gain=1.0,
        gradient_x=0.0, gradient_y=0.0, dz_um=0.0,
    )  # fmt: skip
    seen = image(case, trial)
    bright = np.clip(seen - 0.4, 0, None)
    columns = np.arange(seen.shape[1])
    column = (bright.sum(axis=0) * columns).sum() / bright.sum()
    x_um, _ = case.frame.to_world(float(column), 0.0)
    assert x_um == pytest.approx(1.02 * 40.0, abs=0.1)


def test_nominal_render_is_the_renderers_image(look: Look) -> None:
    case = replace(look("post"), light=Illumination(gain=0.8))
    expected = render(
        scene(case, 1.0, 2.0, 0.3),
        case.microscope,
        focus_um=0.0,
        model=case.model,
        window=case.window,
        light=case.light,
        sampling=case.sampling,
    )
    np.testing.assert_array_equal(
        nominal_render(case)(dx_um=1.0, dy_um=2.0, theta_rad=0.3),
        np.clip(expected, 0, 1),
    )


def test_an_occluder_moves_and_the_target_stays(look: Look) -> None:
    # so many electrons that noise is below a count
    quiet = Sensor(full_well_e=1e13, read_noise_e=0.0, bits=16)
    case = replace(look("between"), sensor=quiet, sampling=FINE)
    trial = replace(design(case, 1, 5)[0], occluder_um=(2.5, -1.0))
    moved = replace(case, static=shifted(case.static, "part", (2.5, -1.0)))
    expected = image(moved, replace(trial, occluder_um=(0.0, 0.0)))
    counts = 2 / quiet.top_count  # both are rounded
    np.testing.assert_allclose(
        image(case, trial), expected, rtol=0, atol=SHARED + counts
    )
    assert (
        np.abs(image(case, replace(trial, occluder_um=(0.0, 0.0))) - expected).max()
        > 100 * SHARED
    )
    assert shifted(case.static, "fingers", (2.5, -1.0)) == case.static


def test_what_lies_at_any_angle_turns_in_the_trials(look: Look) -> None:
    case = look("over_shaft")
    gear = UnknownRotation(owner="gear", x_um=3.0, y_um=1.0, sigma_theta_rad=math.pi)
    known = replace(gear, sigma_theta_rad=0.1)
    spread = replace(case.spread, turning=(gear, known))
    loose = replace(case, spread=spread)
    trials = design(loose, 256, 7)
    assert [replace(t, turns_rad=()) for t in trials] == list(design(case, 256, 7))
    anywhere, near = np.array([t.turns_rad for t in trials]).T
    # a uniform angle has the mean cosine 0, a normal one cut at 4 sigma its sigma
    assert abs(np.exp(1j * anywhere).mean()) < 4 / math.sqrt(256)
    assert np.std(near) == pytest.approx(0.0987, rel=4 / math.sqrt(2 * 256))
    assert np.abs(near).max() <= 0.3
    quiet = Sensor(full_well_e=1e13, read_noise_e=0.0, bits=16)
    case = replace(case, sensor=quiet, sampling=FINE)
    one = replace(case, spread=replace(spread, turning=(gear,)))
    trial = replace(trials[0], turns_rad=(0.5,))
    there = replace(case, static=turned(case.static, gear, 0.5))
    expected = image(there, replace(trial, turns_rad=()))
    counts = 2 / quiet.top_count  # both are rounded
    off = np.abs(image(one, trial) - expected).max()
    assert off <= SHARED + counts
    unturned = image(one, replace(trial, turns_rad=(0.0,)))
    assert np.abs(unturned - expected).max() > 10 * SHARED
    # about its own point: what is there stays there
    x0, y0, x1, y1 = case.static[0].outline.bounds_um
    box = turned(case.static, gear, math.pi)[0].outline.bounds_um
    np.testing.assert_allclose(box, (6 - x1, 2 - y1, 6 - x0, 2 - y0), atol=1e-9)


def test_the_true_lens_shifts_the_image_by_the_defocus(look: Look) -> None:
    case = look("post")
    trial = replace(design(case, 1, 5)[0], dz_um=5.0, noise=1e-6, gain=1.0)
    lens = LensErrors(lateral_x=0.2, lateral_y=-0.1)
    # the target lies 5 um below the plane in focus: its image is shifted by
    # -5 x (.2, -.1) um
    seen = image(case, replace(trial, lens=lens))
    moved = replace(trial, dx_um=trial.dx_um - 1.0, dy_um=trial.dy_um + 0.5)
    expected = image(case, moved)
    # noise of a millionth leaves rounding to 255 levels, which may fall either way
    np.testing.assert_allclose(seen, expected, atol=1.01 / 255)


def test_noise_is_multiplied_in_the_light_and_in_the_dark(look: Look) -> None:
    sensor = look("post").sensor
    loud = noisier(sensor, 3.0)
    for mean in (0.0, 0.5, 1.0):
        quiet_share = math.hypot(
            math.sqrt(mean / sensor.full_well_e),
            sensor.read_noise_e / sensor.full_well_e,
        )
        loud_share = math.hypot(
            math.sqrt(mean / loud.full_well_e), loud.read_noise_e / loud.full_well_e
        )
        assert loud_share == pytest.approx(3 * quiet_share)


def test_a_trial_has_the_walls_and_faces_that_it_drew(look: Look) -> None:
    """As a look that is stated to have them, whose trials draw none."""
    case = replace(look("bore"), lamp_aperture=0.3)
    names = [layer.name for layer in (*case.static, *case.moving)]
    surfaces = tuple(
        UnknownSurface(
            layer=name, body=name, underside_um=min(0.0, case.focus_um - 50.0),
            wall=(0.1, 0.9), finish=(0.0, 0.5),
        )
        for name in names
    )  # fmt: skip
    (trial,) = design(replace(case, surfaces=surfaces), 1, 5)
    shares = dict(zip(names, trial.surfaces, strict=True))
    still, moving = (
        drawn_surfaces(layers, surfaces, shares)
        for layers in (case.static, case.moving)
    )
    top = moving[0]
    wall, finish = trial.surfaces[names.index(top.name)]
    assert top.wall_reflectance == pytest.approx(0.1 + 0.8 * wall)
    assert top.finish == pytest.approx(0.5 * finish)
    stated = replace(case, static=still, moving=moving)
    bare = replace(trial, surfaces=())
    shown = image(replace(case, surfaces=surfaces), trial)
    np.testing.assert_array_equal(shown, image(stated, bare))
    assert np.abs(shown - image(case, bare)).max() > 0.02


def thick(found: LookCase, depth_um: float) -> LookCase:
    """Return a look with coaxial light whose target's bodies reach so far down."""
    moving = tuple(
        replace(layer, underside_um=layer.z_um - depth_um, wall_reflectance=0.8)
        for layer in found.moving
    )
    return replace(found, moving=moving, lamp_aperture=0.3)


def test_in_the_targets_body_points_about_walls_are_close(look: Look) -> None:
    """Two depths of field below its top, until its underside; else nowhere."""
    case = thick(look("bore"), 20.0)
    top_um = max(layer.z_um for layer in case.moving)
    below_um = 2 * case.microscope.wave_depth_um
    close = {
        z_um: sampling_at(case, top_um + z_um, 0.5).walls
        for z_um in (12.0, 0.0, -below_um + 0.1, -below_um - 0.1, -19.9, -20.1)
    }
    within = [z_um for z_um, walls in close.items() if walls]
    assert within == [-below_um - 0.1, -19.9]
    still = replace(case, static=case.moving, moving=look("bore").moving)
    assert sampling_at(still, top_um - 10.0, 0.5).walls is None
    assert sampling_at(case, top_um - 10.0, 1.0).walls is None


def test_planes_are_read_in_trials_alone(look: Look) -> None:
    """Not in pairs of images of all rays or none: what they differ by is small."""
    case, shares = look("bore"), (0.0, 0.5, 1.0)
    read = [sampling_at(case, case.focus_um, share).planes for share in shares]
    assert read == [False, True, False]


def test_close_points_show_what_walls_in_focus_hide(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With few rays as well as all of them from usual points, and better."""
    found = look("bore")
    window = found.window.part(slice(0, 100), slice(0, 100))
    case = thick(replace(found, window=window), 20.0)
    (trial,) = design(case, 1, 5)
    trial = replace(trial, dz_um=-3 * case.microscope.wave_depth_um, noise=1e-6)

    def seen(rays: float, walls: float) -> FloatArray:
        monkeypatch.setattr("microplan.featuresel.look.perturb.RAYS", rays)
        monkeypatch.setattr("microplan.featuresel.look.perturb._CLOSE", walls)
        return image(case, trial)

    shown, best = image(case, trial), seen(0.99, 3.5)
    off = [
        float(np.sqrt(np.mean((each - best) ** 2)))
        for each in (shown, seen(1.0, 1.0), seen(0.5, 0.5))
    ]
    assert off[0] < off[1]
    assert off[0] < off[2] / 3
