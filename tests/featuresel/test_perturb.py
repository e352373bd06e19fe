"""The perturbation design and its seeds."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from featuresel.case import LookCase, Turning, scene
from featuresel.design import Trial, design, rebuild
from featuresel.disturb import noisier, shifted, turned
from featuresel.nominal import nominal_render
from featuresel.perturb import image, still
from optics.lens import MAX_DISTORTION, LensErrors
from optics.render import render
from optics.scene import Illumination
from optics.sensor import Sensor
from tests.featuresel.sharing import FINE, SHARED

Look = Callable[[str], LookCase]


def test_more_trials_change_none(look: Look) -> None:
    case = look("post")
    many = list(design(case, 200, 7))  # a slice of a design would be the shorter one
    for count in (1, 2, 5, 33, 64):
        assert list(design(case, count, 7)) == many[:count]


def test_a_design_is_cut_like_a_tuple(look: Look) -> None:
    """Across the blocks in which its points are drawn, too."""
    some = design(look("post"), 1500, 7)
    whole = tuple(some)
    assert [t.index for t in whole] == list(range(1500))
    assert (some[1367], some[-1]) == (whole[1367], whole[-1])
    assert tuple(some[1300:1450:7]) == whole[1300:1450:7]
    assert tuple(some[1499:1200:-60][1:3]) == whole[1499:1200:-60][1:3]
    assert list(some[3:3]) == []
    with pytest.raises(IndexError):
        some[1500]


def test_other_keys_and_roots_give_other_trials(look: Look) -> None:
    case = look("post")
    first = design(case, 4, 7)
    for other in (design(replace(case, key="else"), 4, 7), design(case, 4, 8)):
        for a, b in zip(first, other, strict=True):
            assert a.seed != b.seed
            assert (a.dx_um, a.dy_um) != (b.dx_um, b.dy_um)


def test_interior_follows_the_spreads(look: Look) -> None:
    case = look("post")
    trials = [t for t in design(case, 1024, 3) if t.index % 4 != 3]
    n = len(trials)
    spread = case.spread
    # a normal cut at 3 sigma keeps .987 of its standard deviation; Sobol points are
    # far more even than random ones, for which 4 standard errors would be .1
    for name, sigma in (
        ("dx_um", spread.pose_sigma_xy_um),
        ("dy_um", spread.pose_sigma_xy_um),
        ("dtheta_rad", spread.pose_sigma_theta_rad),
        ("dz_um", spread.focus_sigma_um),
    ):
        values = np.array([getattr(t, name) for t in trials])
        assert np.std(values) == pytest.approx(0.987 * sigma, rel=4 / math.sqrt(2 * n))
        assert np.abs(values).max() <= 3 * sigma
        assert abs(values.mean()) < 4 * sigma / math.sqrt(n)
    gains = np.array([t.gain for t in trials])
    assert 0.7 <= gains.min() < 0.71
    assert 1.29 < gains.max() <= 1.3
    steep = np.array([math.hypot(t.gradient_x, t.gradient_y) for t in trials])
    assert steep.max() <= 0.3 * (1 + 1e-12)


def test_each_fourth_trial_is_an_extreme(look: Look) -> None:
    case = look("post")
    extremes = [t for t in design(case, 128, 3) if t.index % 4 == 3]
    far = [math.hypot(t.dx_um, t.dy_um) for t in extremes]
    assert 9.0 <= min(far) <= max(far) <= 10.0
    assert {round(abs(t.dz_um), 9) for t in extremes} == {8.0}
    assert {t.gain for t in extremes} == {0.7, 1.3}
    # 32 runs are the two-level design and its mirror image: every factor is balanced
    assert sum(t.dz_um > 0 for t in extremes) == 16
    assert sum(t.magnification > 1 for t in extremes) == 16


def test_both_blur_laws_meet_interior_and_extremes(look: Look) -> None:
    trials = design(look("post"), 64, 3)
    for part in (0, 3):
        laws = [t.model for t in trials if t.index % 4 == part]
        assert laws.count("hopkins") == laws.count("stokseth") == 8
    rough = design(replace(look("post"), model="product"), 8, 3)
    assert {t.model for t in rough} == {"product", "exact"}


def test_any_angle_means_the_whole_circle(look: Look) -> None:
    turns = [t.dtheta_rad for t in design(look("find_gear"), 256, 1)]
    counts, _ = np.histogram(turns, bins=8, range=(-math.pi, math.pi))
    assert counts.sum() == 256
    assert counts.min() > 16  # 32 expected; even random draws stay above 11


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


@pytest.mark.parametrize(("count", "root"), [(0, 1), (-1, 1), (4, -1)])
def test_nonsense_is_an_error(count: int, root: int, look: Look) -> None:
    with pytest.raises(ValueError, match="must"):
        design(look("post"), count, root)


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


DOUBT = LensErrors(
    distortion_sigma=0.01,
    lateral_sigma=0.02,
    scale_sigma_per_um=1e-4,
    field_curvature_sigma_per_um=1e-5,
    edge_offset_sigma_um=0.1,
)


def wider(case: LookCase) -> LookCase:
    """Return the look with every axis that is at rest by default set free."""
    spread = replace(case.spread, occluder_sigma_um=3.0, noise=(0.5, 2.0), lens=DOUBT)
    return replace(case, spread=spread)


def test_further_axes_move_no_other(look: Look) -> None:
    case = look("between")
    rest = {"occluder_um": (0.0, 0.0), "lens": None, "noise": 1.0}
    calm = design(case, 40, 7)
    freed = design(wider(case), 40, 7)
    assert [replace(t, **rest) for t in freed] == list(calm)  # type: ignore[arg-type]
    assert all(a.lens and a.occluder_um != (0.0, 0.0) for a in freed)
    alone = replace(case, spread=replace(case.spread, occluder_sigma_um=3.0))
    for a, b in zip(design(alone, 40, 7), freed, strict=True):
        assert a.occluder_um == b.occluder_um


def test_occluder_lens_and_noise_follow_their_spreads(look: Look) -> None:
    trials = design(wider(look("between")), 1024, 3)
    inside = [t for t in trials if t.index % 4 != 3]
    n = len(inside)
    drawn = {
        "x": ([t.occluder_um[0] for t in inside], 3.0),
        "y": ([t.occluder_um[1] for t in inside], 3.0),
        "distortion": ([_lens(t).distortion for t in inside], 0.01),
        "lateral": ([_lens(t).lateral_y for t in inside], 0.02),
        "scale": ([_lens(t).scale_per_um for t in inside], 1e-4),
        "curvature": ([_lens(t).field_curvature_per_um for t in inside], 1e-5),
        "edges": ([_lens(t).edge_offset_um for t in inside], 0.1),
    }
    for name, (values, sigma) in drawn.items():
        # as for the other axes: cut at 3 sigma, more even than random
        rel = 4 / math.sqrt(2 * n)
        assert np.std(values) == pytest.approx(0.987 * sigma, rel=rel), name
        assert abs(np.mean(values)) < 4 * sigma / math.sqrt(n), name
    noises = [t.noise for t in trials]
    assert 0.5 <= min(noises) < 0.51
    assert 1.99 < max(noises) <= 2.0
    corners = [t for t in trials if t.index % 4 == 3]
    assert {t.noise for t in corners} == {0.5, 2.0}
    assert {round(abs(_lens(t).edge_offset_um), 12) for t in corners} == {0.2}
    assert max(abs(t.occluder_um[0]) for t in corners) <= 6.0


def _lens(trial: Trial) -> LensErrors:
    assert trial.lens is not None
    return trial.lens


def test_what_is_known_of_the_lens_stays_known(look: Look) -> None:
    case = replace(wider(look("post")), lens=LensErrors(distortion=0.249))
    found = [_lens(t).distortion for t in design(case, 64, 1)]
    assert max(found) == MAX_DISTORTION
    assert np.median(found) == pytest.approx(0.249, abs=0.01)


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
    gear = Turning(owner="gear", x_um=3.0, y_um=1.0, sigma_theta_rad=math.pi)
    known = replace(gear, sigma_theta_rad=0.1)
    spread = replace(case.spread, turning=(gear, known))
    loose = replace(case, spread=spread)
    trials = design(loose, 256, 7)
    assert [replace(t, turns_rad=()) for t in trials] == list(design(case, 256, 7))
    anywhere, near = np.array([t.turns_rad for t in trials]).T
    # a uniform angle has the mean cosine 0, a normal one cut at 3 sigma .987 sigma
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


def test_a_trial_is_rebuilt_by_its_number(look: Look) -> None:
    case = wider(look("bore"))
    trials = design(case, 70, 5)
    assert [rebuild(case, 5, k) for k in (0, 3, 69)] == [trials[k] for k in (0, 3, 69)]
