"""What bodies hide, against closed forms and rays followed one by one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.executor.simulated.imaging.rays.beams import beams_from, pass_up
from microplan.executor.simulated.imaging.rays.marching import Solids, fan_through
from microplan.executor.simulated.imaging.rays.pupil_rays import (
    beam_spread,
    pupil_slopes,
)
from microplan.executor.simulated.imaging.solids.solid_scene import SolidBody, mapped
from tests.executor.simulated.imaging.bodies import APERTURE, body, box, circle, view

RAYS = 400


def sky_share(
    x: FloatArray, y: FloatArray, *bodies: SolidBody, turn_rad: float = 0.0
) -> FloatArray:
    """Return the share of the pupil's cone that leaves from points of the stage."""
    found = view(6.9, 0.0)
    slopes = pupil_slopes(found, RAYS, turn_rad=turn_rad)
    spread = beam_spread(found, RAYS)
    solids = Solids(tuple(mapped(b, (0.0, 0.0)) for b in bodies), 0.0)
    start = beams_from(fan_through(x, y, slopes), 0.0, spread)
    beams, bent = pass_up(solids, start, 0.0, spread)
    total = np.zeros(len(x))
    for sky in (beams.rays, bent):
        total += np.bincount(sky.owner // RAYS, weights=sky.weight, minlength=len(x))
    return total / RAYS


def share_beside(x_um: float, height_um: float) -> float:
    """Return the share of the sines' disc that passes beside a half plane."""
    slope = x_um / height_um
    y = APERTURE * (np.arange(20000) + 0.5) / 10000 - APERTURE
    reach = slope * np.sqrt((1 - y**2) / (1 + slope**2))  # of the sine along x
    half = np.sqrt(APERTURE**2 - y**2)
    wide = np.clip(np.minimum(reach, half) + half, 0, None)
    return float(wide.mean() * 2 * APERTURE / (math.pi * APERTURE**2))


def test_a_thin_half_plane_hides_what_lies_beyond_its_edge() -> None:
    plane = body([box(0, -250, 300, 250)], 99.9, 100.0)
    away = np.array([-60.0, -40, -25, -10, 0, 10, 25, 40, 60])
    exact = [share_beside(-x, 100.0) for x in away]
    found = sky_share(away, np.zeros(9), plane)
    # of 400 cells about 23 are cut; the ramp follows a straight cut to a few percent
    np.testing.assert_allclose(found, exact, atol=0.002)


@pytest.mark.parametrize("depth_um", [60.0, 100.0, 200.0])
def test_a_bore_leaves_the_cone_that_its_rim_subtends(depth_um: float) -> None:
    radius = 25.0
    bore = body([circle(0, 0, 200), circle(0, 0, radius)], 0.0, depth_um)
    sine = min(APERTURE, radius / math.hypot(radius, depth_um))
    found = sky_share(np.zeros(1), np.zeros(1), bore)[0]
    # all beams of a ring of the pattern lie on the rim alike: sqrt(pi / 400) / 2 of a
    # cell's width in the radius, averaged over 23 cells
    assert found == pytest.approx((sine / APERTURE) ** 2, abs=0.004)


def test_walls_hide_as_much_as_rims() -> None:
    """A thick slab hides what its underside's or its top's edge does."""
    slab = body([box(0, -250, 300, 250)], 50.0, 100.0)
    away = np.array([-40.0, -20, -5, 5, 20, 40])
    # to the left the lower edge is the steeper one; above the slab the upper one
    exact = [share_beside(-x, 50.0 if x > 0 else 100.0) for x in away]
    exact = [min(share_beside(-x, 50.0), share_beside(-x, 100.0)) for x in away]
    found = sky_share(away, np.zeros(6), slab)
    np.testing.assert_allclose(found, exact, atol=0.003)


def test_walls_that_mirror_everything_lose_nothing() -> None:
    bore = body([circle(0, 0, 60), circle(0, 0, 25)], 0.0, 100.0, wall=1.0)
    x = np.array([0.0, 10.0, 20.0, 24.0])
    # what neither ends on a wall nor is lost: all of it, but for beams cut by a rim
    np.testing.assert_allclose(sky_share(x, 0 * x, bore), 1.0, atol=0.01)


def test_half_of_what_walls_mirror_is_lost_at_a_half() -> None:
    dark, half = (
        body([circle(0, 0, 60), circle(0, 0, 25)], 0.0, 60.0, wall=w)
        for w in (0.0, 0.5)
    )
    at = np.zeros(1), np.zeros(1)
    straight = sky_share(*at, dark)[0]
    # from the axis rays go in planes through it: slopes to .463 reach 60 um up one
    # bounce at most (25 um to the wall, 50 um across)
    expected = straight + 0.5 * (1 - straight)
    assert sky_share(*at, half)[0] == pytest.approx(expected, abs=0.006)
