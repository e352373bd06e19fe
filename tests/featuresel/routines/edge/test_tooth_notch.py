"""The gear's angle by its teeth and notch."""

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
from microplan.featuresel.routines.edge import tooth_notch
from microplan.optics.outline.outline import Arc, Outline

Look = Callable[[str], LookCase]


def prepared(case: LookCase) -> Artifact:
    artifact = tooth_notch.prepare(nominal_render(case), case.target)
    assert isinstance(artifact, Artifact)
    return artifact


def start(case: LookCase) -> Guess:
    return Guess(column=case.target.column, row=case.target.row)


def without_notch(case: LookCase) -> LookCase:
    gear = case.moving[0]
    teeth, bore = gear.outline.rings
    (arc,) = (edge for edge in bore.edges if isinstance(edge, Arc))
    full = replace(arc, start_rad=0.0, sweep_rad=-math.tau)
    plain = Outline(rings=(teeth, replace(bore, edges=(full,))))
    return replace(case, moving=(replace(gear, outline=plain),))


def test_any_angle_is_found_whole(look: Look, measured: Callable[..., Any]) -> None:
    sample = measured(look("find_gear"), "tooth_notch")
    assert sample.failures == ()
    # the limit is 1.3 mdeg for this gear; the teeth's first harmonic of one ring keeps
    # more than a tenth of that information
    assert np.sqrt((sample.turns_rad**2).mean()) < math.radians(1.3e-3) * math.sqrt(10)


def test_the_notch_decides_among_the_teeth(look: Look) -> None:
    case = look("find_gear")
    artifact = prepared(case)
    for tooth in range(18):
        turn = 2 * math.pi * tooth / 18
        found = tooth_notch.measure(
            nominal_render(case)(theta_rad=turn), artifact, start(case)
        )
        assert isinstance(found, Measurement)
        assert found.theta_rad is not None
        off = math.remainder(found.theta_rad - case.theta_rad - turn, math.tau)
        assert abs(off) < 1e-3


def test_without_its_notch_the_gear_has_no_angle(look: Look) -> None:
    case = look("find_gear")
    image = nominal_render(without_notch(case))()
    found = tooth_notch.measure(image, prepared(case), start(case))
    assert isinstance(found, Failure)
    assert found.code == "no_notch"


def test_two_notches_are_ambiguous(look: Look) -> None:
    case = look("find_gear")
    render = nominal_render(case)
    # twice the dark of two turned gears: each notch at half depth in both is whole in
    # their minimum
    both = np.minimum(render(), render(theta_rad=2 * math.pi / 3))
    found = tooth_notch.measure(both, prepared(case), start(case))
    assert isinstance(found, Failure)
    assert found.code == "ambiguous"


def test_a_contrast_reversal_is_not_half_a_tooth(look: Look) -> None:
    case = look("find_gear")
    artifact = prepared(case)
    # beyond 20.6 um the teeth of this gear turn dark for bright
    for focus_um in (12.0, 18.0, 24.0, 30.0):
        image = nominal_render(replace(case, focus_um=focus_um))()
        found = tooth_notch.measure(image, artifact, start(case))
        if isinstance(found, Measurement):
            assert found.theta_rad is not None
            assert abs(found.theta_rad - case.theta_rad) < math.radians(2)


def test_no_gear_has_no_teeth(look: Look, expose_image: Callable[..., Any]) -> None:
    case = look("find_gear")
    blank = expose_image(case, np.full((200, 200), 0.5), np.random.default_rng(1))
    for image in (blank, nominal_render(look("post"))()):
        found = tooth_notch.measure(image, prepared(case), start(case))
        assert isinstance(found, Failure)
        assert found.code in {"no_teeth", "no_notch"}


def test_a_gear_half_out_of_view_is_refused(look: Look) -> None:
    case = look("find_gear")
    image = nominal_render(case)()[:, : int(case.target.column)]
    found = tooth_notch.measure(image, prepared(case), start(case))
    assert isinstance(found, Failure)
    assert found.code == "outside"


def test_a_part_without_a_notch_cannot_be_prepared(look: Look) -> None:
    case = without_notch(look("find_gear"))
    found = tooth_notch.prepare(nominal_render(case), case.target)
    assert isinstance(found, Failure)
    assert found.code == "no_notch"


@pytest.mark.parametrize("turn", [0.05, -0.05])
def test_a_known_angle_bounds_the_answer(turn: float, look: Look) -> None:
    case = look("between")
    artifact = prepared(case)
    guess = replace(start(case), theta_rad=case.theta_rad)
    near = tooth_notch.measure(nominal_render(case)(theta_rad=turn), artifact, guess)
    assert isinstance(near, Measurement)
    far = tooth_notch.measure(
        nominal_render(case)(theta_rad=turn + 1.0), artifact, guess
    )
    assert isinstance(far, Failure)
    assert far.code == "outside"
