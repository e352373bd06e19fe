"""The third judge against closed forms."""

from __future__ import annotations

import math

import pytest

from benchmarks.truth.waves import wave_scene
from tests.executor.simulated.imaging.bodies import (
    APERTURE,
    STAGE,
    body,
    box,
    circle,
    scene,
    view,
)


def test_a_bare_stage_is_as_bright_as_it_reflects() -> None:
    made = wave_scene(scene(), view(6.9, 0.0), (3.0, -2.0), 2.0)
    assert made.image(4.0, -1.0) == pytest.approx(STAGE, abs=1e-6)


def test_a_face_in_focus_ends_at_half_its_light() -> None:
    """By symmetry; 5 um off it is all or nothing, but for lambda / (2 pi**2 A 5 um)."""
    plate = body([box(0.0, -40.0, 40.0, 40.0)], 0.0, 20.0, 0.8)
    # light of its own: no lamp, no shade; a stage as black as the wall hides it
    made = wave_scene(scene(plate, stage=0.0), view(6.9, 20.0, lamp=0.0), (0.0, 0.0), 6)
    for x, share in ((0.0, 0.5), (5.0, 1.0), (-5.0, 0.0)):
        # cells of .4 um whose border lies on the edge: an eighth of the slope a cell
        assert made.image(x, 0.0) == pytest.approx(0.8 * share, abs=0.8 * 0.025)


def test_a_bore_leaves_the_cone_that_its_rim_subtends() -> None:
    radius, height = 12.0, 60.0
    plate = body([circle(0, 0, 80), circle(0, 0, radius)], height - 0.1, height, 0.0)
    made = wave_scene(scene(plate), view(6.9, 0.0, lamp=0.0), (0.0, 0.0), 1.0)
    sine = radius / math.hypot(radius, height)
    wanted = STAGE * (sine / APERTURE) ** 2
    # a stop 12 um wide is 12**2 / (.6 60) = 4 Fresnel zones: the light that it lets
    # through is that of rays but for its rim's cells, .4 um of 12 um
    assert made.image(0.0, 0.0) == pytest.approx(wanted, rel=0.04)
