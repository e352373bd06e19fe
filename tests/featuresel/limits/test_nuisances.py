from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.localisation.depth_of_field import prices
from benchmarks.localisation.information import only
from microplan.arrays import FloatArray
from microplan.featuresel.limits.crlb import camera_of, fisher
from microplan.featuresel.limits.information import Information, limit
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


def test_a_gradient_costs_where_pixels_are_few(look: Look) -> None:
    window = Window(row=205, column=285, rows=70, columns=70)
    case = replace(look("post"), window=window)
    names = ("x", "y", "z", *LIGHT)
    found = fisher(sensitivities(case, LookSetting(dz_um=10.0), names), camera_of(case))
    cost = prices(found, ("x", "y", "z"), free=("gain",), extra=LIGHT)
    assert cost["gain"] == 1.0
    assert cost["gradient_x"] > 1.01
    assert limit(found)["x"] > limit(only(found, ("x", "gain")))["x"]
    with pytest.raises(KeyError, match="offset"):
        prices(INFORMATION, ("x",), extra=("offset",))
