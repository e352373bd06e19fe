"""What an objective's halo may be, by what is stated of it, and what it costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from microplan.featuresel.trials.trials import prepare
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer
from microplan.planner.looks.model_errors.better_models import better_models
from microplan.planner.looks.model_errors.halo_ends import (
    HALO,
    MOST_SHARE,
    halo_ends,
    halo_row,
)
from microplan.planner.looks.model_errors.image_pairs import image_pairs
from microplan.planner.looks.model_errors.model_cost import (
    EffectDifference,
    effect_difference,
)
from microplan.planner.looks.model_errors.used_poses import LEAST, used_poses
from microplan.planner.task.workcell import HaloSpec, WavefrontSpec
from tests.featuresel.conftest import disc, make_case
from tests.optics.shapes import microscope

LIMIT = 0.002


def test_what_is_not_stated_lies_between_none_and_most() -> None:
    none, most = halo_ends(microscope(6.9))
    assert none is None
    assert most is not None
    assert most[1] == MOST_SHARE
    row = halo_row(None, LIMIT)
    assert row.level == "not modelled"
    assert "state `halo`" in row.reason


def test_what_is_stated_is_in_the_images() -> None:
    stated = HaloSpec(radius_um=2.5, share=0.06)
    assert stated.known == (2.5, 0.06)
    row = halo_row(stated, LIMIT)
    assert (row.level, row.predicted_error) == ("imaged", 0.0)
    assert "0.06" in row.reason


def test_none_stated_costs_nothing() -> None:
    row = halo_row(HaloSpec(radius_um=2.5, share=0.0), LIMIT)
    assert (row.level, row.predicted_error) == ("off", 0.0)


def pulled_um(*beside: Layer) -> float:
    """Return half of what the ends of an unknown halo move a disc's answer by, um."""
    part = Layer(
        name="part", outline=Outline(rings=(disc(9.0),)), z_um=0.0, reflectance=0.75
    )
    found = make_case("circle", {"radius_um": 9.0}, (part,), half_px=(24, 24))
    spread = replace(found.spread, focus_sigma_um=0.2, pose_sigma_xy_um=0.5,
                     light_gain=(1.0, 1.0), light_gradient=(0.0, 0.0),
                     search_um=3.0)  # fmt: skip
    case = replace(found, spread=spread, static=beside, model="exact")
    ready = prepare(case, (("ncc",),))
    (model,) = better_models(case, (HALO,), (), WavefrontSpec())
    trials = used_poses(case, 0.5, count=LEAST, root_seed=3)
    cost = effect_difference(model, image_pairs(case, ready, (model,), trials))
    assert isinstance(cost, EffectDifference), cost
    return float(np.abs(cost.place.interval).max())


def test_it_costs_what_lies_beside_the_target() -> None:
    """Around a disc alone its light is even; a bright body beside it pulls."""
    ring = disc(9.0, 19.2, 0.0)
    other = Layer(
        name="other.it", outline=Outline(rings=(ring,)), z_um=0.0, reflectance=0.75
    )
    alone, beside = pulled_um(), pulled_um(other)
    assert beside > 5 * alone
    assert 1e-3 < beside < 0.1
