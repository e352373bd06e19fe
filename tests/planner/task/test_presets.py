"""Presets: what they spend, and who may overrule their image error."""

from __future__ import annotations

import pytest

from microplan.planner.task.presets import PRESETS, Preset
from microplan.planner.task.task import Optimise


@pytest.mark.parametrize("preset", PRESETS)
def test_a_stated_image_error_overrules_any_preset(preset: Preset) -> None:
    assert Optimise(max_image_error=0.03).image_error(preset) == 0.03
    assert Optimise().image_error(preset) == PRESETS[preset].image_error
    assert Optimise(prefer=preset).image_error() == PRESETS[preset].image_error


def test_more_effort_asks_for_less_error() -> None:
    fast, balanced, accurate = (
        PRESETS[name] for name in ("fast", "balanced", "accurate")
    )
    assert fast.image_error > balanced.image_error > accurate.image_error > 0
    assert fast.trials < balanced.trials < accurate.trials
