"""Through a lens that is not round in depth one image tells the side of focus.

The judge is a twin of a camera, whose lens and bodies share no code with ours.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Artifact, Guess, Measurement
from microplan.featuresel.routines.likelihood import defocus_pair, likelihood
from microplan.featuresel.trials.trials import (
    PreparedRoutines,
    measure_picture,
    prepare,
)
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.microscope import Terms
from microplan.optics.transfer.wavefront import disc_shift_um
from tests.featuresel.conftest import MICROSCOPE, disc, make_case, noisy, on_target
from validation.twins import optics, scenes

RADIUS_UM, HALF_PX, AT_UM = 9.0, 24, (0.1, 0.2)
DEPTH_UM = MICROSCOPE.wave_depth_um
NONE: Terms = ()
COMA = ((8, 0.05),)
TELLING = ((5, 0.05), (11, 0.05))  # astigmatism, spherical aberration
SLIGHT = ((6, 0.02),)  # a seventieth of a wave is what a good objective has
# standard deviations that errors may reach: one of 10^4 beyond, and twins differ by a
# third of one from our images
SURE = 4.3


@cache
def look(terms: Terms, sigma_um: float = 1.2 * DEPTH_UM) -> LookCase:
    """Return a look at a round post, in focus."""
    layer = Layer(
        name="part", outline=Outline(rings=(disc(RADIUS_UM),)), z_um=0.0,
        reflectance=0.75,
    )  # fmt: skip
    found = make_case(
        "circle", {"radius_um": RADIUS_UM}, (layer,), half_px=(HALF_PX, HALF_PX)
    )
    scope = replace(found.microscope, wavefront=terms)
    spread = replace(found.spread, focus_sigma_um=sigma_um, search_um=3.0)
    case = replace(found, spread=spread, theta_rad=0.0, model="exact", microscope=scope)
    return on_target(replace(case, x_um=0.0, y_um=0.0))


@cache
def artifact(terms: Terms) -> Artifact:
    case = look(terms)
    made = likelihood.LIKELIHOOD.prepare(nominal_render(case), case.target)
    assert isinstance(made, Artifact), made
    return made


@cache
def twin(terms: Terms, dz_um: float) -> FloatArray:
    """Return a twin's picture without noise, the focus so far above the post's face."""
    case = look(terms)
    side = case.microscope.um_per_px
    column, row = case.frame.to_pixel(*AT_UM)
    place = (column - HALF_PX + 0.5) * side, (HALF_PX - 0.5 - row) * side
    body = scenes.Body(
        shape=scenes.placed(scenes.dot(RADIUS_UM), *place, 0.0), reflectance=0.75
    )
    lens = optics.Optics(
        aperture=case.microscope.aperture,
        wavelength_um=case.microscope.wavelength_um,
        zernike=dict(terms),
        focus_um=dz_um,
    )
    scene = scenes.Scene(bodies=(body,), background=0.10)
    return optics.image(scene, lens, (2 * HALF_PX, 2 * HALF_PX), side)


def guess(case: LookCase) -> Guess:
    column, row = case.frame.to_pixel(*AT_UM)
    return Guess(column=column + 0.4, row=row - 0.3)


def measured(terms: Terms, dz_um: float, seed: int) -> Measurement:
    case, rng = look(terms), np.random.default_rng(seed)
    picture = noisy(case, twin(terms, dz_um), rng)
    found = likelihood.measure(picture, artifact(terms), guess(case))
    assert isinstance(found, Measurement), found
    return found


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize("depths", [-3, -2, -1, 1, 2, 3])
def test_the_side_is_told(depths: int, seed: int) -> None:
    found = measured(TELLING, depths * DEPTH_UM, seed)
    assert found.z_is_signed
    assert found.z_um is not None
    assert found.spread_z_um is not None
    assert abs(found.z_um - depths * DEPTH_UM) < SURE * found.spread_z_um


@pytest.mark.parametrize("terms", [SLIGHT, ((11, 0.02),)])
@pytest.mark.parametrize("depths", [-1.0, -0.3, 0.3, 1.0])
def test_a_slight_error_tells_no_wrong_side(terms: Terms, depths: float) -> None:
    """A fit from one side ended on the other, and settled there."""
    for seed in range(3):
        found = measured(terms, depths * DEPTH_UM, seed)
        assert found.z_um is not None
        if found.z_is_signed:
            assert found.z_um * depths > 0
        assert abs(found.z_um) == pytest.approx(abs(depths) * DEPTH_UM, abs=0.25)


@pytest.mark.parametrize("terms", [NONE, COMA])
@pytest.mark.parametrize("depths", [-2, 2])
def test_without_it_only_the_size_is_told(terms: Terms, depths: int) -> None:
    found = measured(terms, depths * DEPTH_UM, 1)
    assert not found.z_is_signed
    assert found.z_um == pytest.approx(2 * DEPTH_UM, abs=0.1)


@pytest.mark.parametrize("depths", [0, 1])
def test_coma_moves_no_answer(depths: int) -> None:
    """From where the lens shows discs in focus: planes of finer pixels were .03 off."""
    case, found = look(COMA), measured(COMA, depths * DEPTH_UM, 5)
    x_um, y_um = disc_shift_um(case.microscope)
    column, row = case.frame.to_pixel(AT_UM[0] + x_um, AT_UM[1] + y_um)
    off_px = np.hypot(found.column - column, found.row - row)
    assert off_px < SURE * found.spread_px


@pytest.mark.parametrize(("terms", "sides"), [(TELLING, 2), (NONE, 0)])
def test_trials_count_a_wrong_side_where_it_is_told(terms: Terms, sides: int) -> None:
    """The same picture, said to be of the focus below."""
    case = look(terms)
    ready: PreparedRoutines = prepare(case, (("circle_caliper", "likelihood"),))
    trial = Trial(index=0, dx_um=AT_UM[0], dy_um=AT_UM[1], dtheta_rad=0.0,
                  dz_um=DEPTH_UM, model="exact", seed=(0,))  # fmt: skip
    (right,) = measure_picture(case, ready, trial, twin(terms, DEPTH_UM))
    other = replace(trial, dz_um=-DEPTH_UM)
    (wrong,) = measure_picture(case, ready, other, twin(terms, DEPTH_UM))
    assert right.depth_um == pytest.approx(DEPTH_UM, abs=0.1)
    assert right.z_um == pytest.approx(0.0, abs=0.1)
    assert wrong.z_um == pytest.approx(sides * DEPTH_UM, abs=0.1)


def test_images_far_out_of_focus_do_not_hide_that_sides_differ() -> None:
    """Beyond `most_defocus_um` no wavefront error is computed: there both are alike."""
    case = look(TELLING, 35.0)
    made = likelihood.LIKELIHOOD.prepare(nominal_render(case), case.target)
    assert isinstance(made, Artifact), made
    assert not made.parameters["is_even"]


@pytest.mark.parametrize(
    ("terms", "black"),
    [
        (NONE, 0.08),
        (TELLING, 0.0),
        (TELLING, 0.02),
        *(
            pytest.param(*other, marks=pytest.mark.slow)
            for other in ((NONE, 0.0), (NONE, 0.02), (TELLING, 0.08))
        ),
    ],
)
def test_a_pair_bears_a_black_level_that_nobody_stated(
    terms: Terms, black: float
) -> None:
    """Without light all over 2 % moved heights by 1.7 um, and 8 % gave none."""
    case, rng, off_um = look(terms), np.random.default_rng(3), 2 * DEPTH_UM
    made = defocus_pair.prepare(nominal_render(case), case.target, offset_um=off_um)
    assert isinstance(made, Artifact), made
    for z_um in (-2 * DEPTH_UM, 0.3 * DEPTH_UM, DEPTH_UM):
        pictures = [
            noisy(case, black + (1 - black) * twin(terms, z_um + offset), rng)
            for offset in (-off_um, off_um)
        ]
        found = defocus_pair.measure(pictures, (-off_um, off_um), made, guess(case))
        assert isinstance(found, Measurement), found
        assert found.z_um is not None
        assert found.spread_z_um is not None
        assert found.z_is_signed
        assert abs(found.z_um - z_um) < SURE * found.spread_z_um
        assert found.spread_z_um < 0.05
