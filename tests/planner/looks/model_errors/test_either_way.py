"""Unknowns of the world, seen in frames of targets that turn."""

from __future__ import annotations

import math

import numpy as np
import pytest

from microplan.planner.looks.model_errors.answer_shift import Poses
from microplan.planner.looks.model_errors.either_way import either_way, turned

COUNT = 12
RNG = np.random.default_rng(8)
ANGLES = dict(enumerate(RNG.uniform(-math.pi, math.pi, COUNT).tolist()))
AT = {k: RNG.normal(size=3) for k in range(COUNT)}
USUAL = {k: RNG.normal(size=2) for k in range(COUNT)}


def in_world(x: float, y: float) -> Poses:
    """Return a displacement of the world in the frame of each trial's target."""
    return {k: turned(np.array([x, y]), ANGLES, k, -1) for k in range(COUNT)}


def test_what_moves_in_the_world_is_an_interval_at_any_angle() -> None:
    found = either_way([in_world(0.3, 0.0)], [AT], [USUAL], ANGLES)
    np.testing.assert_allclose(found.mean, 0.0)
    np.testing.assert_allclose(found.half_width, 0.3)  # of both axes
    np.testing.assert_allclose(found.interval, 0.3)
    np.testing.assert_allclose(found.sigma, 0.0, atol=1e-12)
    (changes,) = found.changes
    for each in changes.values():
        np.testing.assert_allclose(each.change, 0.0, atol=1e-12)


def test_the_opposite_costs_the_same() -> None:
    one = either_way([in_world(0.3, -0.1)], [AT], [USUAL], ANGLES)
    other = either_way([in_world(-0.3, 0.1)], [AT], [USUAL], ANGLES)
    np.testing.assert_allclose(one.half_width, other.half_width)


def test_components_add_up_as_squares() -> None:
    """(a, b) within a circle: what a x + b y is at most is its radius times the norm"""
    ends = [in_world(0.3, 0.0), in_world(0.4, 0.0)]
    found = either_way(ends, [AT, AT], [USUAL, USUAL], ANGLES)
    turns = 2 * np.pi * np.arange(360) / 360
    most = np.abs(0.3 * np.cos(turns) + 0.4 * np.sin(turns)).max()
    assert found.half_width[0] == pytest.approx(most, rel=1e-3)


def test_what_turns_with_the_target_is_a_standard_deviation() -> None:
    still = {k: np.array([0.3, 0.0]) for k in range(COUNT)}
    found = either_way([still], [AT], [USUAL], ANGLES)
    assert found.interval[0] < 0.2
    assert found.sigma.max() > 0.05


def test_an_angle_has_no_frame() -> None:
    ends = [{k: np.array([0.01]) for k in range(COUNT)}]
    usual = [{k: np.array([0.0]) for k in range(COUNT)}]
    found = either_way(ends, [AT], usual)
    np.testing.assert_allclose(found.half_width, [0.01])


def test_the_half_width_holds_the_mean_as_often_as_it_says() -> None:
    """Student's: of noisy differences about a displacement of .1."""
    rng, held, tries = np.random.default_rng(2), 0, 400
    for _ in range(tries):
        noisy = {
            k: v + rng.normal(scale=0.05, size=2) for k, v in in_world(0.1, 0).items()
        }
        found = either_way([noisy], [AT], [USUAL], ANGLES)
        held += bool(found.half_width[0] >= 0.1)
    assert held / tries >= 0.95
