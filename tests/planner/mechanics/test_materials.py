"""What parts are made of: weights of solid bodies, and charge."""

from __future__ import annotations

import math

import pytest

from microplan.planner.mechanics.adhesion import (
    CONDUCTORS,
    DENSITY,
    conducts,
    in_liquid,
    volume_um3,
    weight_un,
)
from tests.planner.examples import EXAMPLE, read


def test_weights_are_those_of_solid_bodies() -> None:
    # a nickel annulus of 100 um over 50 um, 100 um thick: 51.5 nN
    volume = math.pi * (50.0**2 - 25.0**2) * 100.0
    low, high = weight_un(" Nickel", volume)
    assert low == high == pytest.approx(51.5e-3, rel=3e-3)
    for unknown in ("unobtainium", ""):
        low, high = weight_un(unknown, volume)
        assert low < 51.5e-3 < high
    assert weight_un("nickel", 0.0) == (0.0, 0.0)


def test_posts_weigh_too() -> None:
    plate = read(EXAMPLE / "task.yaml").parts["shaft_plate"]
    (post,) = plate.posts.values()
    assert plate.thickness_um == 0.0
    # a cylinder of 44 um, 250 um high
    assert volume_um3(plate) == pytest.approx(math.pi * 22.0**2 * 250.0, rel=1e-6)
    assert post.height_um == 250.0


def test_a_liquid_may_carry_a_part() -> None:
    assert not in_liquid(1.0003)  # air
    assert in_liquid(1.33)
    low, high = weight_un("nickel", 1e6, medium_index=1.33)
    assert low == 0.0
    assert high == weight_un("nickel", 1e6)[1]


def test_only_what_is_known_to_conduct_does() -> None:
    assert set(DENSITY) >= CONDUCTORS
    assert conducts("Gallium Arsenide")
    assert not any(conducts(name) for name in ("", "su-8", "glass", "unobtainium"))
