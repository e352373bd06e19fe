"""A wavefront error is paid as far as it moves a chain, in pictures of another author.

The judge is a twin of a camera, whose lens and bodies share no code with ours.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import Point

from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.perturb import still
from microplan.featuresel.look.scenario import LookCase, moved_layers, render_look
from microplan.featuresel.trials.trials import (
    PreparedRoutines,
    measure_picture,
    prepare,
)
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.microscope import Terms
from microplan.optics.transfer.wavefront import disc_shift_um
from microplan.planner.looks.model_errors.better_models import better_models
from microplan.planner.looks.model_errors.image_pairs import image_pairs
from microplan.planner.looks.model_errors.model_cost import (
    EffectDifference,
    effect_difference,
)
from microplan.planner.looks.model_errors.used_poses import LEAST, used_poses
from microplan.planner.looks.model_errors.wavefront_ends import (
    LIMITED,
    UNKNOWN,
    total_share,
)
from microplan.planner.task.workcell import WavefrontSpec
from tests.featuresel.conftest import disc, make_case, on_target
from validation.twins import optics, scenes

CHAIN, RADIUS_UM, HALF_PX = ("circle_caliper",), 9.0, 24
COMA = ((8, 0.05),)
PLACES = ((0.15, 0.3), (-0.35, -0.2))  # in a pixel


def look(off_um: float) -> LookCase:
    """Return a look at a round post, so far out of focus."""
    layer = Layer(
        name="part", outline=Outline(rings=(disc(RADIUS_UM),)), z_um=off_um,
        reflectance=0.75,
    )  # fmt: skip
    found = make_case(
        "circle", {"radius_um": RADIUS_UM}, (layer,), half_px=(HALF_PX, HALF_PX)
    )
    spread = replace(found.spread, focus_sigma_um=0.2, pose_sigma_xy_um=0.5,
                     light_gain=(1.0, 1.0), light_gradient=(0.0, 0.0),
                     search_um=3.0)  # fmt: skip
    case = replace(found, spread=spread, theta_rad=0.0, model="exact")
    return on_target(replace(case, x_um=0.0, y_um=0.0))


def paid(
    case: LookCase, effect: str, stated: WavefrontSpec, ready: PreparedRoutines
) -> EffectDifference:
    models = better_models(case, (effect,), (), stated)
    trials = used_poses(case, 0.5, count=LEAST, root_seed=3)
    found = effect_difference(models[0], image_pairs(case, ready, models, trials))
    assert isinstance(found, EffectDifference), found
    return found


def answer_um(case: LookCase, ready: PreparedRoutines, terms: Terms) -> np.ndarray:
    """Return what the chain says of twins' pictures, the mean over places in a pixel.

    From where the lens shows the middle of a large disc in focus.
    """
    scope, (layer,) = case.microscope, case.moving
    lens = optics.Optics(
        aperture=scope.aperture, wavelength_um=scope.wavelength_um, zernike=dict(terms)
    )
    side, found = scope.um_per_px, []
    # the window's middle is half a pixel off the axis, right and up of it in the frame
    for x, y in PLACES:
        at_um = (x * side, y * side)
        column, row = case.frame.to_pixel(*at_um)
        place = (column - HALF_PX + 0.5) * side, (HALF_PX - 0.5 - row) * side
        shape = Point(place).buffer(RADIUS_UM, quad_segs=64)
        body = scenes.Body(shape=shape, reflectance=0.75, z_um=layer.z_um)
        scene = scenes.Scene(bodies=(body,), background=0.10)
        picture = optics.image(scene, lens, (2 * HALF_PX, 2 * HALF_PX), side)
        trial = Trial(index=0, dx_um=at_um[0], dy_um=at_um[1], dtheta_rad=0.0,
                      model="exact", seed=(0,))  # fmt: skip
        (outcome,) = measure_picture(case, ready, trial, picture)
        assert outcome.target_um is not None, outcome
        found.append(outcome.target_um)
    shift = disc_shift_um(replace(scope, wavefront=terms))
    return np.asarray(np.mean(found, axis=0) - shift)


def imaged_um(case: LookCase, ready: PreparedRoutines, terms: Terms) -> np.ndarray:
    """Return the same of images that trials have through such a lens."""
    seen = replace(case, microscope=replace(case.microscope, wavefront=terms))
    side, found = case.microscope.um_per_px, []
    for x, y in PLACES:
        trial = Trial(index=0, dx_um=x * side, dy_um=y * side, dtheta_rad=0.0,
                      model="exact", seed=(0,))  # fmt: skip
        moved = moved_layers(seen, trial.dx_um, trial.dy_um, 0.0)
        picture = render_look(seen, moved, still(seen, trial))
        (outcome,) = measure_picture(case, ready, trial, picture)
        assert outcome.target_um is not None, outcome
        found.append(outcome.target_um)
    return np.asarray(np.mean(found, axis=0))


@pytest.mark.parametrize("off_um", [pytest.param(0.0, marks=pytest.mark.slow), 3.0])
def test_trials_through_a_stated_lens_move_answers_as_twins_do(off_um: float) -> None:
    """Within 2 nm, of the tens that coma and trefoil move them by."""
    case = look(off_um)
    ready = prepare(case, (CHAIN,))
    plain = answer_um(case, ready, ()), imaged_um(case, ready, ())
    for terms in (COMA, ((8, -0.05),), ((7, 0.03), (10, 0.05))):
        moved = answer_um(case, ready, terms) - plain[0]
        found = imaged_um(case, ready, terms) - plain[1]
        np.testing.assert_allclose(found, moved, rtol=0, atol=0.002)
        if off_um > 0:
            assert np.linalg.norm(moved) > 0.005


def test_what_is_not_known_is_paid_in_proportion_to_its_total() -> None:
    case = look(3.0)
    ready = prepare(case, (CHAIN,))
    plain = paid(case, UNKNOWN, WavefrontSpec(), ready).place
    less = paid(case, UNKNOWN, WavefrontSpec(rms_waves=0.03), ready).place
    ratio = LIMITED / 0.03
    assert plain.interval[0] == pytest.approx(ratio * less.interval[0], rel=0.15)
    assert plain.half_width[0] > less.half_width[0] > 0
    wanted = np.linalg.norm(answer_um(case, ready, ((8, total_share() * LIMITED),)))
    assert plain.half_width[0] >= wanted - 0.002
    assert plain.interval[0] == pytest.approx(wanted, rel=0.25)
    np.testing.assert_array_equal(plain.mean, 0.0)
