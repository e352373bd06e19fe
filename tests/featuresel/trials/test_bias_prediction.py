"""The bias at the look's focus: predicted without noise, met with noise."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from microplan.featuresel.look.design import design
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.bias_prediction import predict_bias
from microplan.featuresel.trials.trials import PreparedRoutines, prepare, run
from microplan.optics.outline.outline import Outline, Ring, Segment
from microplan.optics.render.scene import Layer

Look = Callable[[str], LookCase]
NCC = ("ncc",)


def bar() -> Layer:
    """Return a bright bar 4 um beside the post, whose light leaks into its blur."""
    ends = [(26.0, -30.0), (40.0, -30.0), (40.0, 30.0), (26.0, 30.0)]
    edges = tuple(
        Segment(start=a, end=b) for a, b in zip(ends, ends[1:] + ends[:1], strict=True)
    )
    return Layer(
        name="bar", outline=Outline(rings=(Ring(edges=edges),)), z_um=0.0,
        reflectance=0.75,
    )  # fmt: skip


@pytest.fixture
def beside(look: Look) -> LookCase:
    """Return the post with a neighbour, in steady light."""
    case = look("post")
    spread = replace(
        case.spread, light_gain=(1.0, 1.0), light_gradient=(0.0, 0.0),
        magnification_sigma=0.0, pose_sigma_xy_um=0.5, search_um=2.0,
    )  # fmt: skip
    return replace(case, static=(bar(),), spread=spread, key="beside")


def test_the_prediction_is_what_noisy_trials_show_on_average(beside: LookCase) -> None:
    ready = prepare(beside, [NCC])  # in focus
    beside = replace(beside, focus_um=beside.focus_um + 9.0)
    x_um, y_um, theta_rad = predict_bias(beside, ready, poses=8)[NCC]
    assert x_um < -0.05  # the neighbour's light pulls it, out of focus
    assert theta_rad == 0.0  # none is measured
    trials = [
        replace(trial, dz_um=0.0, model=beside.model)
        for trial in design(beside, 52, 3)
        if not trial.corner
    ]
    errors = np.array([o.target_um for o in run(beside, ready, trials)])
    # 4 standard errors of 36 trials, and of the prediction's own 8 poses
    unsure = 4 * errors.std(axis=0, ddof=1) * math.sqrt(1 / 36 + 1 / 8)
    assert (np.abs(errors.mean(axis=0) - (x_um, y_um)) < unsure).all()


def test_a_chain_that_is_wrong_somewhere_has_no_bias(beside: LookCase) -> None:
    far = replace(beside, focus_um=beside.focus_um + 60.0)
    ready = prepare(beside, [("otsu",), NCC])
    assert ("otsu",) not in predict_bias(far, ready, poses=1)  # blurred, or gone
    blind = PreparedRoutines(
        chains=(("tooth_notch",),),
        artifacts=prepare(beside, [("tooth_notch",)]).artifacts,
    )
    assert predict_bias(beside, blind, poses=1) == {}
    with pytest.raises(ValueError, match="poses"):
        predict_bias(beside, ready, poses=0)
