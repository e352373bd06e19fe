"""The judge of sigmas against draws whose sigma is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.selection.kept_sigmas import nees, own_bias_um
from microplan.schemas.plan import Repeatability, parse_plan
from tests.golden.__main__ import GOLDEN

COUNT = 20_000
KNOWN = Repeatability(
    trials=64, answered=64, undetected=0, sigma_um=(0.1, 0.4), kurtosis=3.0,
    half_width_um=(0.06, 0.3),
)  # fmt: skip


def test_honest_sigmas_and_half_widths_give_one() -> None:
    """A bias anywhere within its half-width, uniform: a third of its square."""
    rng = np.random.default_rng(3)
    errors = rng.normal(size=(COUNT, 2)) * KNOWN.sigma_um
    errors += rng.uniform(-1, 1, (COUNT, 2)) * KNOWN.half_width_um
    # the fourth moment of normal values is the largest of such sums: 4 standard errors
    assert nees(errors, KNOWN) == pytest.approx(1, abs=4 * math.sqrt(1 / COUNT))
    assert nees(2 * errors, KNOWN) == pytest.approx(4, rel=0.05)


def test_axes_are_judged_by_their_own_sigma() -> None:
    rng = np.random.default_rng(4)
    errors = rng.normal(size=(COUNT, 2)) * [0.1, 0.1]
    assert nees(errors, KNOWN) < 0.6


def test_trials_are_judged_without_what_better_images_add() -> None:
    plan = parse_plan(GOLDEN.read_text(encoding="utf-8"))
    measures = [look.measure for step in plan.steps for look in step.looks]
    charged = [m for m in measures if m.model_cost is not None]
    assert charged
    for measure in charged:
        assert measure.model_cost is not None
        paid = np.array(measure.model_cost.bias_um)
        assert own_bias_um(measure) + paid == pytest.approx(measure.bias_um)
    free = replace(charged[0], model_cost=None)
    assert own_bias_um(free) == free.bias_um
