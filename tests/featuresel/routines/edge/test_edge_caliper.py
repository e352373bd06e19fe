"""Straight calipers on rendered jaws."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Artifact, Failure, Guess, Measurement
from microplan.featuresel.routines.edge import edge_caliper

Look = Callable[[str], LookCase]


def prepared(case: LookCase) -> Artifact:
    artifact = edge_caliper.prepare(nominal_render(case), case.target)
    assert isinstance(artifact, Artifact)
    return artifact


def start(case: LookCase) -> Guess:
    return Guess(column=case.target.column, row=case.target.row)


def test_the_grip_is_found_within_the_pixel_locking_of_straight_edges(
    look: Look, measured: Callable[..., Any]
) -> None:
    sample = measured(look("jaws"), "edge_caliper", draws=15)
    assert sample.failures == ()
    # edges along pixel rows sample one phase only: no more than .05 px
    assert np.abs(sample.errors_um).max() < 0.05 / 0.92
    # 100 px of two faces, .05 px each
    assert np.abs(sample.turns_rad).max() < 0.05 * 2 / 100


@pytest.mark.parametrize("turn_deg", [-10, -4, 2, 7, 12])
def test_turned_jaws_are_found_far_out_of_focus(turn_deg: float, look: Look) -> None:
    case = look("jaws")
    turn = math.radians(turn_deg)
    blurred = replace(case, focus_um=20.0)
    image = nominal_render(blurred)(dx_um=3.0, dy_um=-4.0, theta_rad=turn)
    found = edge_caliper.measure(image, prepared(blurred), start(case))
    assert isinstance(found, Measurement)
    assert found.theta_rad == pytest.approx(turn, abs=1e-3)
    x, y = case.frame.to_world(found.column, found.row)
    assert math.hypot(x - case.x_um - 3, y - case.y_um + 4) < 0.2


def test_zoom_errors_do_not_move_the_tips_lever(look: Look) -> None:
    case = look("jaws")
    scope = replace(case.microscope, magnification=case.microscope.magnification * 1.01)
    image = nominal_render(replace(case, microscope=scope))()
    found = edge_caliper.measure(image, prepared(case), start(case))
    assert isinstance(found, Measurement)
    _, y = case.frame.to_world(found.column, found.row)
    # the tips are 60 um from the grip: without the widths it would be .6 um off
    assert y == pytest.approx(1.01 * case.y_um, abs=0.06)


def test_no_fingers_are_noticed(look: Look, expose_image: Callable[..., Any]) -> None:
    case, rng = look("jaws"), np.random.default_rng(3)
    artifact = prepared(case)
    empty = expose_image(case, np.full((240, 380), 0.1), rng)
    gear = nominal_render(replace(case, moving=look("find_gear").moving))()
    for image in (empty, expose_image(case, gear, rng)):
        found = edge_caliper.measure(image, artifact, start(case))
        assert isinstance(found, Failure)
        assert found.code == "no_edge"


def test_another_opening_is_noticed(look: Look) -> None:
    case = look("jaws")
    image = nominal_render(case)()
    gap = slice(int(case.target.column) - 12, int(case.target.column) + 13)
    narrower = np.delete(image, gap, axis=1)  # 25 px less between the fingers
    wide = np.pad(narrower, ((0, 0), (12, 13)), mode="edge")
    found = edge_caliper.measure(wide, prepared(case), start(case))
    assert isinstance(found, Failure)
    assert found.code in {"opening_off", "no_edge"}


@pytest.mark.parametrize("seed", range(5))
def test_noise_has_no_jaws(look: Look, seed: int) -> None:
    case = look("jaws")
    artifact = prepared(case)
    shape = (case.window.rows, case.window.columns)
    image = np.random.default_rng(seed).random(shape)
    assert isinstance(edge_caliper.measure(image, artifact, start(case)), Failure)
