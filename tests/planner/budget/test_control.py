"""How many corrections an angle takes, against draws of the servo."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.planner.assembly.step_states import unfold
from microplan.planner.budget.alignment_residual import angle_correction
from microplan.planner.budget.control import control_of, folded_mean
from microplan.planner.budget.methods import method_of
from microplan.planner.budget.probability.angle_budget import GIVE_UP, AngleCorrection
from microplan.planner.source.diagnostics import Report
from tests.planner.examples import ROOT
from tests.planner.placed import look, read

GEAR = ROOT / "examples" / "gear_on_shaft" / "task.yaml"
DRAWS = 400_000


@pytest.mark.parametrize("sigma_rad", [0.1e-3, 2e-3, 6e-3])
@pytest.mark.parametrize("start_rad", [0.5e-3, 9e-3, 60e-3])
def test_corrections_are_those_of_drawn_starts(
    start_rad: float, sigma_rad: float
) -> None:
    turn = AngleCorrection(within_rad=1.7e-3, start_rad=start_rad, sigma_rad=sigma_rad)
    rng = np.random.default_rng(5)
    left = np.abs(rng.normal(0.0, start_rad, DRAWS))
    counts = np.zeros(DRAWS)
    while (outside := left > turn.within_rad).any():
        counts += outside
        again = np.abs(rng.normal(0.0, sigma_rad, DRAWS))
        left = np.where(outside, again, left)
    mean = float(counts.mean())
    # five standard errors of the mean, and what a draw can tell from nothing
    atol = 5 * float(counts.std()) / math.sqrt(DRAWS) + 1 / DRAWS
    assert turn.expected == pytest.approx(mean, abs=atol)
    assert turn.most == int(counts.max() > 0)


def test_the_example_is_given_the_looks_that_its_turn_takes() -> None:
    """A submount .5 deg off, to be turned within .1 deg: by one correction."""
    task = read()
    align = next(s for s in unfold(task, Report()) if s.step.id == "over_site")
    turn = angle_correction(task, align, None)
    assert turn is not None
    assert turn.start_rad == pytest.approx(math.radians(0.5), rel=1e-3)
    seen = look("submount.mark", "find_submount", 0.12)
    choice = method_of(task, (align,), align, 0.4, {}, Report(), seen)
    control = control_of(task, align, 0.4, choice)
    assert turn.most == 1
    assert control.max_cycles == 3
    assert 1.7 < control.expected_cycles < 2.0
    straight = replace(align, step=replace(align.step, tolerance_theta_rad=None))
    assert control_of(task, straight, 0.4, choice).max_cycles == 2
    assert GIVE_UP == 1e-6


@pytest.mark.parametrize("mean", [0.0, 0.5, -2.0, 40.0])
@pytest.mark.parametrize("sigma", [0.0, 1.0, 30.0])
def test_the_mean_way_of_an_approach_is_that_of_draws(
    mean: float, sigma: float
) -> None:
    drawn = np.abs(np.random.default_rng(6).normal(mean, sigma, DRAWS))
    # five standard errors of the mean
    atol = 5 * float(drawn.std()) / math.sqrt(DRAWS) + 1e-12
    assert folded_mean(mean, sigma) == pytest.approx(float(drawn.mean()), abs=atol)


def test_an_approach_takes_its_nominal_zero_leg_and_the_focus_too() -> None:
    """The gear lies 30 um about its place: a leg of 24 um, and its settling."""
    task = read(GEAR)
    states = unfold(task, Report())
    align = next(s for s in states if s.step.id == "bring_between")
    choice = method_of(task, (align,), align, 3.0, {}, Report())
    plain = control_of(task, align, 3.0, choice)
    # 250 um in y, 30 sqrt(2 / pi) in x at 1000 um/s, .15 s between
    assert plain.approach_s == pytest.approx(0.25 + 0.0239 + 0.15, abs=1e-3)
    later = control_of(task, align, 3.0, choice, setting_s=0.4)
    assert later.approach_s == pytest.approx(plain.approach_s + 0.4)
    assert later.floor_s is not None
    assert plain.floor_s is not None
    assert later.floor_s == pytest.approx(plain.floor_s + 0.4)
