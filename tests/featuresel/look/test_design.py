"""The perturbation design and its seeds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from microplan.featuresel.look.design import Trial, design, random_design, rebuild
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.unknown_surfaces import UnknownSurface
from microplan.optics.lens.lens import MAX_DISTORTION, LensErrors

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
    trials = [t for t in design(case, 1024, 3) if not t.corner]
    n = len(trials)
    spread = case.spread
    # a normal cut at 4 sigma keeps all but .05 % of its deviation; Sobol points are
    # far more even than random ones, for which 4 standard errors would be .1
    for name, sigma in (
        ("dx_um", spread.pose_sigma_xy_um),
        ("dy_um", spread.pose_sigma_xy_um),
        ("dtheta_rad", spread.pose_sigma_theta_rad),
        ("dz_um", spread.focus_sigma_um),
    ):
        values = np.array([getattr(t, name) for t in trials])
        assert np.std(values) == pytest.approx(sigma, rel=4 / math.sqrt(2 * n))
        assert np.abs(values).max() <= 4 * sigma
        assert abs(values.mean()) < 4 * sigma / math.sqrt(n)
    gains = np.array([t.gain for t in trials])
    assert 0.7 <= gains.min() < 0.71
    assert 1.29 < gains.max() <= 1.3
    steep = np.array([math.hypot(t.gradient_x, t.gradient_y) for t in trials])
    assert steep.max() <= 0.3 * (1 + 1e-12)


def stated(case: LookCase) -> LookCase:
    """Return the look in a workcell that states less than what is tried."""
    spread = replace(case.spread, focus_sigma_um=0.5, light_gain=(1.0, 1.0))
    return replace(case, stated=replace(spread, magnification_sigma=0.001))


def test_random_trials_follow_the_workcell_and_corners_what_is_tried(
    look: Look,
) -> None:
    case = stated(look("post"))
    trials = list(design(case, 1024, 3))
    inside = [t for t in trials if not t.corner]
    mixed = [k % 4 == 3 for k in range(32)]
    assert [t.corner for t in trials] == (mixed + 8 * [True] + 24 * [False]) * 16
    tried = list(design(look("post"), 1024, 3))
    assert [t for t in trials if t.corner] == [t for t in tried if t.corner]
    rel = 4 / math.sqrt(2 * len(inside))
    assert np.std([t.dz_um for t in inside]) == pytest.approx(0.5, rel=rel)
    assert np.std([t.magnification for t in inside]) == pytest.approx(0.001, rel=rel)
    assert {t.gain for t in inside} == {1.0}


def test_fresh_random_trials_are_drawn_alike_but_others(look: Look) -> None:
    case = stated(look("post"))
    fresh = list(random_design(case, 768, 3))
    assert [t.index for t in fresh] == list(range(768))
    assert not any(t.corner for t in fresh)
    seen = {t.seed for t in design(case, 1024, 3)} | {
        t.seed for t in random_design(case, 768, 4)
    }
    assert not seen & {t.seed for t in fresh}
    assert list(random_design(case, 900, 3))[:768] == fresh
    rel = 4 / math.sqrt(2 * len(fresh))
    for name, sigma in (("dx_um", case.spread.pose_sigma_xy_um), ("dz_um", 0.5)):
        values = [getattr(t, name) for t in fresh]
        assert np.std(values) == pytest.approx(sigma, rel=rel)
    with pytest.raises(ValueError, match="must"):
        random_design(case, 0, 3)


def test_a_quarter_of_the_trials_are_extremes(look: Look) -> None:
    case = look("post")
    extremes = [t for t in design(case, 128, 3) if t.corner]
    assert len(extremes) == 32
    far = [math.hypot(t.dx_um, t.dy_um) for t in extremes]
    assert 9.0 <= min(far) <= max(far) <= 10.0
    assert {round(abs(t.dz_um), 9) for t in extremes} == {8.0}
    assert {t.gain for t in extremes} == {0.7, 1.3}
    # 32 runs are the two-level design and its mirror image: every factor is balanced
    assert sum(t.dz_um > 0 for t in extremes) == 16
    assert sum(t.magnification > 1 for t in extremes) == 16


def test_both_blur_laws_meet_interior_and_extremes(look: Look) -> None:
    trials = design(look("post"), 64, 3)
    for part in (False, True):
        laws = [t.model for t in trials if t.corner is part]
        assert laws.count("hopkins") == laws.count("stokseth") == len(laws) / 2
    rough = design(replace(look("post"), model="product"), 8, 3)
    assert {t.model for t in rough} == {"product", "exact"}


def test_any_angle_means_the_whole_circle(look: Look) -> None:
    turns = [t.dtheta_rad for t in design(look("find_gear"), 256, 1)]
    counts, _ = np.histogram(turns, bins=8, range=(-math.pi, math.pi))
    assert counts.sum() == 256
    assert counts.min() > 16  # 32 expected; even random draws stay above 11


@pytest.mark.parametrize(("count", "root"), [(0, 1), (-1, 1), (4, -1)])
def test_nonsense_is_an_error(count: int, root: int, look: Look) -> None:
    with pytest.raises(ValueError, match="must"):
        design(look("post"), count, root)


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
    inside = [t for t in trials if not t.corner]
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
        # as for the other axes: cut at 4 sigma, more even than random
        rel = 4 / math.sqrt(2 * n)
        assert np.std(values) == pytest.approx(sigma, rel=rel), name
        assert abs(np.mean(values)) < 4 * sigma / math.sqrt(n), name
    noises = [t.noise for t in trials]
    assert 0.5 <= min(noises) < 0.51
    assert 1.99 < max(noises) <= 2.0
    corners = [t for t in trials if t.corner]
    assert {t.noise for t in corners} == {0.5, 2.0}
    assert {round(abs(_lens(t).edge_offset_um), 12) for t in corners} == {0.2}
    assert max(abs(t.occluder_um[0]) for t in corners) <= 6.0


def _lens(trial: Trial) -> LensErrors:
    assert trial.lens is not None
    return trial.lens


def test_a_height_that_is_hardly_known_is_promised_for_not_chosen_by(
    look: Look,
) -> None:
    """A chain is chosen by what is tried; its sigma is of the whole height."""
    plain = look("between")
    wide = replace(plain.spread, focus_sigma_um=5 * plain.spread.focus_sigma_um)
    case = replace(plain, stated=wide)
    chosen_by = [t.dz_um for t in design(case, 400, 3) if not t.corner]
    promised = [t.dz_um for t in random_design(case, 400, 3)]
    for drawn, sigma in ((chosen_by, 1), (promised, 5)):
        # 4 standard errors of a sigma, as for the other axes
        assert np.std(drawn) == pytest.approx(
            sigma * plain.spread.focus_sigma_um, rel=4 / math.sqrt(2 * len(drawn))
        )


def test_what_goes_along_lies_off_together(look: Look) -> None:
    """By as much for the target and for all else, uniformly to either side."""
    plain = look("between")
    along = replace(plain, spread=replace(plain.spread, together_um=0.5))
    pairs = list(zip(design(plain, 400, 3), design(along, 400, 3), strict=True))
    target = np.array([(b.dx_um - a.dx_um, b.dy_um - a.dy_um) for a, b in pairs])
    others = [np.subtract(b.occluder_um, a.occluder_um) for a, b in pairs]
    np.testing.assert_allclose(target, others, atol=1e-12)
    starts = [trial.together_um for _, trial in pairs]
    np.testing.assert_allclose(target, starts, atol=1e-12)
    assert np.abs(target).max() <= 0.5
    for sigma in target.std(axis=0):  # 4 standard errors of 400 uniform numbers
        assert sigma == pytest.approx(1 / math.sqrt(12), rel=4 * 0.0224)


def test_what_is_known_of_the_lens_stays_known(look: Look) -> None:
    case = replace(wider(look("post")), lens=LensErrors(distortion=0.249))
    found = [_lens(t).distortion for t in design(case, 64, 1)]
    assert max(found) == MAX_DISTORTION
    assert np.median(found) == pytest.approx(0.249, abs=0.01)


def test_a_trial_is_rebuilt_by_its_number(look: Look) -> None:
    case = wider(look("bore"))
    trials = design(case, 70, 5)
    assert [rebuild(case, 5, k) for k in (0, 3, 69)] == [trials[k] for k in (0, 3, 69)]


def test_every_body_has_walls_and_a_face_of_its_own(look: Look) -> None:
    """Uniform in their intervals, at an end of each in corners; all else stays."""
    case = look("between")
    surfaces = tuple(
        UnknownSurface(
            layer=layer, body=body, underside_um=0.0, wall=(0.0, 0.9), finish=(0.0, 1.0)
        )
        for layer, body in (("part", "part"), ("mark", "part"), ("jaw", "tool"))
    )
    unsure = replace(case, surfaces=surfaces)
    known, drawn = design(case, 512, 3), design(unsure, 512, 3)
    for one, other in zip(known, drawn, strict=True):
        assert one.surfaces == ()
        assert replace(other, surfaces=()) == one
    inner = np.array([t.surfaces for t in drawn if not t.corner]).reshape(-1, 4)
    ends = np.array([t.surfaces for t in drawn if t.corner]).reshape(-1, 4)
    n = len(inner)
    assert inner.mean(axis=0) == pytest.approx(0.5, abs=4 / math.sqrt(12 * n))
    assert inner.var(axis=0) == pytest.approx(1 / 12, abs=4 * 0.075 / math.sqrt(n))
    apart = np.corrcoef(inner.T)[~np.eye(4, dtype=bool)]
    assert np.abs(apart).max() < 4 / math.sqrt(n)
    assert set(ends.ravel()) == {0.0, 1.0}
    assert np.abs(ends.mean(axis=0) - 0.5).max() < 4 * 0.5 / math.sqrt(len(ends))
    assert all(len(t.surfaces) == 2 for t in random_design(unsure, 8, 3))
