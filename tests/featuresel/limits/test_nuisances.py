from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.localisation.depth_of_field import prices
from microplan.arrays import FloatArray
from microplan.featuresel.limits.crlb import camera_of, fisher
from microplan.featuresel.limits.information import Information, limit
from microplan.featuresel.limits.nuisances import choose
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.sensitivity import LIGHT, LookSetting, sensitivities
from microplan.optics.render.scene import Window

Look = Callable[[str], LookCase]


def told(slopes: FloatArray, *names: str) -> Information:
    """Return what rows of slopes tell with noise of 1."""
    return Information(
        names=names, matrix=slopes @ slopes.T, faked=np.zeros(len(slopes))
    )


# x and gain share part of what they do, tilt does something else, blind does nothing
SLOPES = np.array(
    [[1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0], [0.0] * 4]
)
INFORMATION = told(SLOPES, "x", "gain", "tilt", "blind")


def test_price_is_the_ratio_of_limits() -> None:
    found = prices(INFORMATION, ("x",), extra=("gain", "tilt", "blind"))
    # x alone 1, with gain 1 / sqrt(1 - cos(45 deg)**2)
    assert found == pytest.approx({"gain": math.sqrt(2), "tilt": 1.0, "blind": 1.0})


def test_what_is_unknown_anyway_costs_nothing_more() -> None:
    found = prices(INFORMATION, ("x",), free=("gain",), extra=("gain", "tilt"))
    assert found == pytest.approx({"gain": 1.0, "tilt": 1.0})


def test_price_of_what_cannot_be_told_apart_is_infinite() -> None:
    double = told(np.array([[1.0, 2.0], [2.0, 4.0]]), "x", "gain")
    assert prices(double, ("x",), extra=("gain",)) == {"gain": math.inf}


@pytest.mark.parametrize(
    ("spread", "chosen"), [(0.0, ()), (0.9, ()), (1.1, ("gain",)), (100.0, ("gain",))]
)
def test_unknown_is_fitted_where_its_bias_outweighs_its_price(
    spread: float, chosen: tuple[str, ...]
) -> None:
    # not fitted, gain moves x by its spread: 1 + spread**2 against 2
    assert choose(INFORMATION, ("x",), {"tilt": 9.0, "gain": spread}) == chosen


def test_predicted_errors_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(3)
    slopes = rng.standard_normal((4, 12))
    names = ("x", "z", "gain", "tilt")
    spreads = {"gain": 0.6, "tilt": 0.3}
    chosen = choose(told(slopes, *names), ("x", "z"), spreads)
    draws = 40_000
    truth = rng.standard_normal((draws, 2)) * list(spreads.values())
    data = truth @ slopes[2:] + rng.standard_normal((draws, 12))

    def worst(fitted: tuple[str, ...]) -> FloatArray:
        rows = slopes[[0, 1, *(names.index(name) for name in fitted)]]
        off = data @ np.linalg.pinv(rows)
        return np.asarray(np.sqrt((off[:, :2] ** 2).mean(axis=0)))

    subsets: list[tuple[str, ...]] = [(), ("gain",), ("tilt",), ("gain", "tilt")]
    errors = np.stack([worst(subset) for subset in subsets])
    ratios = (errors / errors.min(axis=0)).max(axis=1)
    # a standard deviation of 40 000 draws is good to .35 %
    assert ratios[subsets.index(chosen)] < ratios.min() * 1.01


def test_gradients_are_worth_fitting_only_where_light_has_them(look: Look) -> None:
    window = Window(row=205, column=285, rows=70, columns=70)
    case = replace(look("post"), window=window)
    names = ("x", "y", "z", *LIGHT)
    found = fisher(sensitivities(case, LookSetting(dz_um=10.0), names), camera_of(case))
    wanted = ("x", "y", "z")
    even = {"gain": 0.17, "gradient_x": 0.0, "gradient_y": 0.0, "offset": 0.0}
    assert choose(found, wanted, even) == ("gain",)
    tilted = {**even, "gradient_x": 0.1, "gradient_y": 0.1}
    assert choose(found, wanted, tilted) == ("gain", "gradient_x", "gradient_y")
    cost = prices(found, wanted, free=("gain",), extra=LIGHT)
    assert cost["gain"] == 1.0
    assert cost["gradient_x"] > 1.01
    assert limit(found)["x"] > limit(found.only(("x", "gain")))["x"]


def test_spreads_below_zero_are_refused() -> None:
    with pytest.raises(ValueError, match="gain"):
        choose(INFORMATION, ("x",), {"gain": -1.0})
    with pytest.raises(KeyError, match="offset"):
        choose(INFORMATION, ("x",), {"offset": 1.0})
    with pytest.raises(KeyError, match="offset"):
        prices(INFORMATION, ("x",), extra=("offset",))
