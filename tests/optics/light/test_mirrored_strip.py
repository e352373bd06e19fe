"""Light of roundings that are no circles against rays mirrored one by one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from microplan.optics.light.lamps import RingLamp
from microplan.optics.light.mirrored_strip import light_range, lit_share

RAYS = 100_000
STEEPNESS = (0.5, 0.6, 0.7, 0.85, 1.0, 1.2, 1.4, 1.7, 2.0)  # height over width
RINGS = ((20, 45), (5, 15), (0, 30), (40, 60), (60, 80))  # degrees above horizontal


def ring(low_deg: float, high_deg: float) -> RingLamp:
    return RingLamp(low_rad=math.radians(low_deg), high_rad=math.radians(high_deg))


def counted(steepness: float, lamp: RingLamp, sine: float) -> tuple[float, float]:
    """Return the light of a rounding of width 1 by single rays, and its error.

    Rays meet a plane above it evenly and go on to the ellipse that the edge is rounded
    by, a cylinder along y; there its gradient mirrors them, as Householder does.
    """
    rng = np.random.default_rng(4)
    lowest, wide = -2.0, 5.0  # rays sideways by .46 of at most 2 down stay within
    part = sine * np.sqrt(rng.random(RAYS))
    angle = rng.uniform(0, 2 * math.pi, RAYS)
    view = np.stack([part * np.cos(angle), part * np.sin(angle), np.sqrt(1 - part**2)])
    start = np.stack([lowest + wide * rng.random(RAYS), np.ones(RAYS)])
    # in units in which the ellipse is a circle round 0: x sideways, z up
    down = -np.stack([view[0], view[2] / steepness])
    a, b, c = (down**2).sum(axis=0), (down * start).sum(axis=0), (start**2).sum(axis=0)
    root = b**2 - a * (c - 1)
    there = start - down * (b + np.sqrt(np.maximum(root, 0))) / a
    normal = np.stack([there[0], np.zeros(RAYS), there[1] / steepness])
    normal /= np.linalg.norm(normal, axis=0)
    light = 2 * (normal * view).sum(axis=0) * normal - view
    elevation = np.arcsin(np.clip(light[2], -1, 1))
    lit = (root > 0) & (there > 0).all(axis=0)
    lit &= (elevation >= lamp.low_rad) & (elevation <= lamp.high_rad)
    share = float(lit.mean())
    return wide * share, wide * math.sqrt(share * (1 - share) / RAYS)


@pytest.mark.parametrize("sine", [0.1, 0.42])
@pytest.mark.parametrize("degrees", RINGS)
def test_single_rays_find_the_least_and_the_most_light(
    degrees: tuple[int, int], sine: float
) -> None:
    lamp = ring(*degrees)
    _, share = lit_share(lamp, sine)
    rays = [counted(steepness, lamp, sine) for steepness in STEEPNESS]
    circle, error = rays[STEEPNESS.index(1.0)]
    # rays see a tilted surface larger or smaller than from above by their slope: even
    # and odd parts cancel but for the mean square of slopes along x, sine**2 / 4
    seen = sine**2 / 4
    assert share.mean() == pytest.approx(circle, rel=seen, abs=4 * error + 0.001)
    for end, choose in zip(light_range(lamp, sine), (min, max), strict=True):
        light, own = choose(rays)
        within = 4 * math.hypot(own / circle, error * light / circle**2)
        assert end == pytest.approx(light / circle, rel=seen, abs=within)


def test_the_low_ring_dims_lines_by_a_third_and_a_high_one_brightens_them() -> None:
    least, most = light_range(ring(20, 45), 0.42)
    assert least == pytest.approx(2 / 3, abs=0.01)
    assert most == pytest.approx(1.06, abs=0.01)
    least, most = light_range(ring(40, 60), 0.42)
    assert least == pytest.approx(0.58, abs=0.01)
    assert most == pytest.approx(1.35, abs=0.01)


@pytest.mark.parametrize("degrees", [(0, 90), (44.99, 45.0)])
def test_a_circle_is_within_the_range(degrees: tuple[float, float]) -> None:
    # all tilts or all but one: by rays along the axis light is the width of the tilts
    least, most = light_range(ring(*degrees), 1e-6)
    assert 0 < least <= 1 <= most
