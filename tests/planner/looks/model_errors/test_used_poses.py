"""Poses of pairs lie where answers are used, each with its mirror image."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.planner.looks.model_errors.used_poses import used_poses
from tests.featuresel.conftest import post_alone


@pytest.mark.parametrize("count", [12, 16, 24])
def test_half_of_the_poses_lie_on_the_rim_all_around(count: int) -> None:
    found = used_poses(post_alone(), 1.45, count=count, root_seed=3)
    off = np.array([(t.dx_um, t.dy_um) for t in found])
    far = np.hypot(*off.T)
    rim = np.arange(count) // 2 % 2 == 0
    np.testing.assert_allclose(far[rim], 1.45)
    assert not np.isclose(far[~rim], 1.45).any()
    ways = np.sort(np.arctan2(off[rim, 1], off[rim, 0]))
    gaps = np.diff([*ways, ways[0] + 2 * math.pi])
    assert gaps.max() < math.pi / 3 + 1e-9  # no sixth of the rim is without one
    assert [trial.index for trial in found] == list(range(count))


def test_poses_have_mirror_images_and_noise_of_their_own() -> None:
    found = used_poses(
        replace(post_alone(), theta_any=True), 2.0, count=12, root_seed=3
    )
    for one, other in zip(found[::2], found[1::2], strict=True):
        assert (one.dx_um, one.dy_um) == (-other.dx_um, -other.dy_um)
        assert (one.dtheta_rad, one.dz_um) == (-other.dtheta_rad, -other.dz_um)
        assert one.magnification - 1 == pytest.approx(1 - other.magnification)
    assert len({trial.seed for trial in found}) == len(found)
    assert min(abs(trial.dz_um) for trial in found) > 0
    assert {trial.occluder_um for trial in found} == {(0.0, 0.0)}


def test_more_poses_change_none_of_the_first() -> None:
    case = post_alone()
    few, more = (used_poses(case, 1.0, count=n, root_seed=3) for n in (12, 16))
    assert more[:12] == few


def test_all_but_the_target_is_at_its_planned_place_and_so_is_the_start() -> None:
    case = post_alone()
    spread = replace(case.spread, together_um=20.0, occluder_sigma_um=3.0)
    for stated in (None, spread):
        found = replace(case, spread=spread, stated=stated)
        for pose in used_poses(found, 1.0, count=8, root_seed=3):
            assert pose.occluder_um == pose.together_um == (0.0, 0.0)
            # 4 sigma of each: what all lie off by is in neither
            sigma_um = math.hypot(case.spread.pose_sigma_xy_um, 3.0)
            assert math.hypot(pose.dx_um, pose.dy_um) < 4 * math.sqrt(2) * sigma_um


def test_a_step_that_says_nothing_takes_two_sigma() -> None:
    case = post_alone()
    first = used_poses(case, None, count=2, root_seed=3)[0]
    assert first.dx_um == pytest.approx(2 * case.drawn.pose_sigma_xy_um)
    known = replace(case, spread=replace(case.spread, pose_sigma_xy_um=0.0))
    still = used_poses(known, None, count=4, root_seed=3)
    assert {(trial.dx_um, trial.dy_um) for trial in still} == {(0.0, 0.0)}


@pytest.mark.parametrize("count", [0, 1, 13])
def test_an_odd_number_of_poses_has_no_mirror_images(count: int) -> None:
    with pytest.raises(ValueError, match="count must be even"):
        used_poses(post_alone(), 1.0, count=count, root_seed=3)
