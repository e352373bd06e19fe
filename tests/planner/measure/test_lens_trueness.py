"""What is not known of the lens is part of how true answers in pictures are."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.featuresel.trials.trials import prepare
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer
from microplan.planner.measure.lens_trueness import lens_trueness_um
from microplan.planner.task.workcell import HaloSpec, WavefrontSpec
from tests.featuresel.conftest import disc, make_case
from tests.planner.placed import read

NO_HALO = HaloSpec(radius_um=2.0, share=0.0)


def trueness_um(rms_waves: float | None) -> float:
    """Return that of a round post in focus, um."""
    part = Layer(
        name="part", outline=Outline(rings=(disc(9.0),)), z_um=0.0, reflectance=0.75
    )
    found = make_case("circle", {"radius_um": 9.0}, (part,), half_px=(24, 24))
    spread = replace(found.spread, focus_sigma_um=0.2, pose_sigma_xy_um=0.5,
                     light_gain=(1.0, 1.0), light_gradient=(0.0, 0.0),
                     search_um=3.0)  # fmt: skip
    case = replace(found, spread=spread, model="exact")
    lens = replace(
        read().workcell.optics,
        wavefront=WavefrontSpec(rms_waves=rms_waves),
        halo=NO_HALO,
    )
    ready = prepare(case, (("ncc",),))
    answer = lens_trueness_um(case, ready, lens, root_seed=3)
    assert answer is not None
    return answer


def test_a_perfect_lens_moves_no_answer() -> None:
    assert trueness_um(0.0) == pytest.approx(0.0, abs=1e-4)


def test_what_moves_answers_grows_with_what_is_not_known() -> None:
    little, much = trueness_um(0.03), trueness_um(None)
    assert 1e-3 < little < much < 0.1
    assert much == pytest.approx(little / 0.03 / 14, rel=0.2)
