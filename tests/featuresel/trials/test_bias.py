"""The bias through focus: predicted without noise, met with noise, taken off."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from microplan.featuresel.look.design import design
from microplan.featuresel.look.perturb import image
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.templates import Located
from microplan.featuresel.trials.bias import BiasCurve, unbiased
from microplan.featuresel.trials.bias_prediction import default_heights, predict_bias
from microplan.featuresel.trials.trials import (
    PreparedRoutines,
    measure_picture,
    prepare,
    run,
)
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


def curve(**changes: tuple[float, ...] | None) -> BiasCurve:
    form: dict[str, tuple[float, ...] | None] = {
        "dz_um": (-10.0, 0.0, 20.0),
        "x_um": (0.3, 0.1, 0.5),
        "y_um": (0.0, 0.0, -1.0),
        "theta_rad": None,
        "scatter_um": (0.0, 0.0, 0.0),
    }
    return BiasCurve(**(form | changes))  # type: ignore[arg-type]


def test_a_curve_is_linear_between_its_heights_and_level_beyond() -> None:
    found = curve()
    assert found.at(-5.0) == pytest.approx((0.2, 0.0, 0.0))
    assert found.at(10.0) == pytest.approx((0.3, -0.5, 0.0))
    assert found.at(99.0) == (0.5, -1.0, 0.0)
    assert found.at_depth(10.0) == pytest.approx((0.3, -0.25, 0.0))


@pytest.mark.parametrize(
    "bad", [{"dz_um": (0.0, 0.0, 1.0)}, {"dz_um": ()}, {"x_um": (0.0,)}]
)
def test_a_curve_needs_rising_heights_and_a_value_at_each(
    bad: dict[str, tuple[float, ...]],
) -> None:
    with pytest.raises(ValueError, match=r"height|rise"):
        curve(**bad)


def test_the_bias_turns_with_the_target(look: Look) -> None:
    case = look("post")
    place = Located(x_um=5.0, y_um=7.0, theta_rad=1.1, axis_rad=None)
    found = unbiased(case, place, curve(theta_rad=(0.0, 0.02, 0.0)), depth_um=0.0)
    off = complex(0.1, 0.0) * complex(math.cos(1.1), math.sin(1.1))
    assert (found.x_um, found.y_um) == pytest.approx((5 - off.real, 7 - off.imag))
    assert found.theta_rad == pytest.approx(1.08)
    lost = replace(place, theta_rad=None)
    assert unbiased(replace(case, theta_any=True), lost, curve()) == lost


def test_the_prediction_is_what_noisy_trials_show_on_average(beside: LookCase) -> None:
    ready = prepare(beside, [NCC])
    predicted = predict_bias(beside, ready, dz_um=(0.0, 9.0), poses=8)[NCC]
    assert predicted.x_um[1] < -0.05  # the neighbour's light pulls it, out of focus
    for place, dz in enumerate((0.0, 9.0)):
        trials = [
            replace(trial, dz_um=dz, model=beside.model)
            for trial in design(beside, 48, 3)
            if trial.index % 4 != 3
        ]
        errors = np.array([o.target_um for o in run(beside, ready, trials)])
        # 4 standard errors of 36 trials, and of the prediction's own 8 poses
        unsure = 4 * np.hypot(
            errors.std(axis=0, ddof=1) / 6, predicted.scatter_um[place] / math.sqrt(8)
        )
        expected = (predicted.x_um[place], predicted.y_um[place])
        assert (np.abs(errors.mean(axis=0) - expected) < unsure).all()


def test_trials_with_the_curve_are_those_without_less_the_bias(
    beside: LookCase,
) -> None:
    ready, trials = prepare(beside, [NCC]), design(beside, 4, 1)
    known = curve(dz_um=(0.0,), x_um=(0.3,), y_um=(-0.2,), scatter_um=(0.0,))
    for trial, before in zip(trials, run(beside, ready, trials), strict=True):
        picture = image(beside, trial)
        (after,) = measure_picture(beside, ready, trial, picture, {NCC: known})
        assert before.world_um is not None
        assert after.world_um is not None
        # no angle is measured: the nominal one, .1 rad, turns the bias
        turned = complex(0.3, -0.2) * complex(math.cos(0.1), math.sin(0.1))
        off = np.subtract(before.world_um, after.world_um)
        assert off == pytest.approx((turned.real, turned.imag))


def test_heights_without_an_answer_are_left_out(beside: LookCase) -> None:
    ready = prepare(beside, [("otsu",), NCC])
    found = predict_bias(beside, ready, dz_um=(0.0, 60.0), poses=1)
    assert found["otsu",].dz_um == (0.0,)  # blurred into the neighbour, or gone
    blind = PreparedRoutines(
        chains=(("tooth_notch",),),
        artifacts=prepare(beside, [("tooth_notch",)]).artifacts,
    )
    assert predict_bias(beside, blind, dz_um=(0.0,), poses=1) == {}
    with pytest.raises(ValueError, match="poses"):
        predict_bias(beside, ready, poses=0)


def test_heights_span_the_focus_spread(look: Look) -> None:
    case = look("post")
    assert default_heights(case) == pytest.approx(np.linspace(-12, 12, 9))
    still = replace(case, spread=replace(case.spread, focus_sigma_um=0.0))
    assert default_heights(still) == (0.0,)
