"""What is not known of the lens is part of how true answers in pictures are."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.featuresel.trials.trials import prepare
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer
from microplan.planner.measure.lens_trueness import lens_trueness_um
from microplan.planner.task.workcell import HaloSpec, WavefrontSpec, ZernikeTerm
from tests.featuresel.conftest import disc, make_case
from tests.planner.placed import read

NO_HALO = HaloSpec(radius_um=2.0, share=0.0)


def trueness_um(wavefront: WavefrontSpec, *, turned: bool = False) -> float:
    """Return that of a round post in focus, which may lie at any angle, um."""
    part = Layer(
        name="part", outline=Outline(rings=(disc(9.0),)), z_um=0.0, reflectance=0.75
    )
    found = make_case("circle", {"radius_um": 9.0}, (part,), half_px=(24, 24))
    spread = replace(found.spread, focus_sigma_um=0.2, pose_sigma_xy_um=0.5,
                     light_gain=(1.0, 1.0), light_gradient=(0.0, 0.0),
                     search_um=3.0)  # fmt: skip
    case = replace(found, spread=spread, model="exact", theta_any=turned)
    lens = replace(
        read().workcell.optics,
        wavefront=wavefront,
        halo=NO_HALO,
    )
    ready = prepare(case, (("ncc",),))
    answer = lens_trueness_um(case, ready, lens, root_seed=3)
    assert answer is not None
    return answer


def test_a_perfect_lens_moves_no_answer() -> None:
    assert trueness_um(WavefrontSpec(rms_waves=0.0)) == pytest.approx(0.0, abs=1e-4)


def test_what_moves_answers_grows_with_what_is_not_known() -> None:
    little, much = (trueness_um(WavefrontSpec(rms_waves=w)) for w in (0.03, None))
    assert 1e-3 < little < much < 0.1
    assert much == pytest.approx(little / 0.03 / 14, rel=0.2)


def test_what_is_stated_is_in_the_images_as_far_as_it_is_known() -> None:
    """And is as large at any angle: it stays where the camera is."""
    sure, doubtful = (
        WavefrontSpec(terms=(ZernikeTerm(noll=8, waves=0.05, sigma_waves=sigma),))
        for sigma in (0.0, 0.02)
    )
    assert trueness_um(sure) == 0.0
    still, turned = trueness_um(doubtful), trueness_um(doubtful, turned=True)
    assert still > 2e-3
    assert 0.5 * still < turned < 1.2 * still
