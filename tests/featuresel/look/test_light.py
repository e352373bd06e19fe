"""Cases in coaxial light, and cases whose layers are traced ray by ray."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from microplan.featuresel.look.design import design
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.perturb import image
from microplan.featuresel.look.scenario import Backdrop, LookCase, scene
from microplan.featuresel.look.static_layers import fresh
from microplan.optics.layers.occlusion import occluded
from microplan.optics.layers.shading import render_coaxial
from microplan.optics.lens.lens import LensErrors
from tests.featuresel.sharing import FINE, SHARED

Look = Callable[[str], LookCase]


def lit(case: LookCase) -> LookCase:
    """Return the case in coaxial light."""
    lamp = case.microscope.aperture
    return replace(case, lamp_aperture=lamp, background_z_um=-50.0)


def test_a_lit_case_is_shaded_wherever_the_target_is(look: Look) -> None:
    case = replace(lit(look("between")), sampling=FINE)
    for dx_um in (0.0, 3.0):
        expected = render_coaxial(
            scene(case, dx_um, 0.0, 0.0),
            case.microscope,
            focus_um=case.focus_um,
            lamp_aperture=case.microscope.aperture,
            model=case.model,
            window=case.window,
            light=case.light,
            sampling=case.sampling,
        )
        found = nominal_render(case)(dx_um=dx_um)
        np.testing.assert_allclose(found, np.clip(expected, 0, 1), rtol=0, atol=SHARED)
    plain = nominal_render(replace(case, lamp_aperture=None))()
    dark = plain - nominal_render(case)()
    assert dark.max() > 0.02  # the jaws are above the gear
    assert dark.min() > -0.02  # shade adds no light


def test_a_trial_of_a_lit_case_is_shaded_too(look: Look) -> None:
    case = lit(look("between"))
    trial = design(case, 4, 1)[0]
    bright = image(replace(case, lamp_aperture=None), trial)
    assert image(case, trial).mean() < bright.mean() - 0.002
    assert not case.shares_spectra


def test_what_is_not_blended_shares_no_blurred_layers(look: Look) -> None:
    case = replace(look("between"), treatment="occluded")
    scope = case.microscope
    assert fresh(case, case.static) == Backdrop()
    found = nominal_render(case)()
    expected = occluded(
        scene(case, 0.0, 0.0, 0.0),
        scope,
        focus_um=case.focus_um,
        model=case.model,
        window=case.window,
        light=case.light,
    )
    np.testing.assert_array_equal(found, np.clip(expected, 0, 1))


def test_a_known_lens_moves_what_is_seen(look: Look) -> None:
    case = replace(look("post"), x_um=40.0)
    bent = replace(case, lens=LensErrors(distortion=0.2))
    assert not bent.shares_still_layers

    def column(of: LookCase) -> float:
        light = np.clip(nominal_render(of)() - 0.4, 0, None)
        return float(light.sum(axis=0) @ np.arange(light.shape[1]) / light.sum())

    moved_um = (column(bent) - column(case)) * case.microscope.um_per_px
    half = np.hypot(*case.microscope.field_um) / 2
    # of a disc 22 um in radius, of which the outer side is stretched: r**2 + 3 w**2
    wanted = 0.2 * 40 * (40**2 + 3 * 22**2) / half**2
    assert abs(moved_um - wanted) < 0.1 * wanted
