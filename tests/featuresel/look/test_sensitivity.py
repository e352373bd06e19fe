from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.localisation.information import slopes_of
from microplan.arrays import FloatArray
from microplan.featuresel.look.scenario import (
    Backdrop,
    LookCase,
    moved_layers,
    render_look,
    scene,
)
from microplan.featuresel.look.sensitivity import (
    LIGHT,
    POSE,
    LookSetting,
    Sensitivities,
    sensitivities,
)
from microplan.featuresel.look.static_layers import fresh
from microplan.optics.layers.occlusion import occluded
from microplan.optics.lens.lens import LensErrors
from microplan.optics.render.scene import Illumination, Window

Look = Callable[[str], LookCase]


def shown(case: LookCase, at: LookSetting) -> FloatArray:
    """Return the look at a setting, by the renderer's usual band and margin."""
    scope = replace(
        case.microscope, magnification=case.microscope.magnification * at.zoom
    )
    light = Illumination(
        gain=case.light.gain * at.gain,
        gradient_x=case.light.gradient_x + at.gradient_x,
        gradient_y=case.light.gradient_y + at.gradient_y,
    )
    seen = replace(
        case, microscope=scope, focus_um=case.focus_um + at.dz_um, light=light
    )
    moved = moved_layers(case, at.dx_um, at.dy_um, at.dtheta_rad)
    return render_look(seen, moved, Backdrop(fresh(seen, seen.static).layers))


def small(case: LookCase) -> LookCase:
    """Return a look with a small window about its target."""
    window = Window(row=205, column=285, rows=70, columns=70)
    return replace(case, window=window)


def norm(image: FloatArray) -> float:
    return float(np.linalg.norm(image))


@pytest.mark.parametrize(
    ("name", "z_um", "most", "most_z"),
    [
        ("find_gear", 3.0, 1e-3, 1e-3),
        ("over_shaft", 0.0, 1e-3, 1e-2),
        ("over_shaft", 3.0, 1e-2, 5e-2),
    ],
)
def test_slopes_err_by_a_small_part_of_their_norm_at_most(
    look: Look, name: str, z_um: float, most: float, most_z: float
) -> None:
    """More where bodies out of focus hide the same rays, which meet them on points."""
    seen = sensitivities(small(look(name)), LookSetting(dx_um=0.2, dz_um=z_um), POSE)
    told = ["x", "y", "z", "zoom"] + ["theta"] * (name != "over_shaft")
    for name_of, slope, error in zip(seen.names, seen.slopes, seen.errors, strict=True):
        if name_of in told:
            limit = most_z if name_of == "z" else most
            assert norm(error) < limit * norm(slope), name_of


@pytest.mark.parametrize(("name", "step"), [("dx_um", 0.3), ("dz_um", 0.5)])
def test_changes_out_of_focus_are_those_of_traced_images(
    look: Look, name: str, step: float
) -> None:
    """By rays through cells: both roads err by a fortieth of the norm there."""
    case, at = small(look("over_shaft")), LookSetting(dx_um=0.2, dz_um=3.0)
    ends = [replace(at, **{name: getattr(at, name) + sign * step}) for sign in (1, -1)]
    traced = [
        occluded(
            scene(case, end.dx_um, end.dy_um, end.dtheta_rad),
            case.microscope,
            focus_um=case.focus_um + end.dz_um,
            model=case.model,
            window=case.window,
            samples=512,
            step_um=0.27,
        )
        for end in ends
    ]
    change, own = traced[0] - traced[1], shown(case, ends[0]) - shown(case, ends[1])
    assert norm(own - change) < 0.05 * norm(change)


@pytest.mark.parametrize(
    ("field", "name", "step"),
    [
        ("dx_um", "x", 0.02),
        ("dy_um", "y", 0.02),
        ("dtheta_rad", "theta", 5e-4),
        ("dz_um", "z", 0.4),
        ("zoom", "zoom", 5e-4),
    ],
)
def test_slopes_are_those_of_plain_differences_at_other_steps(
    look: Look, field: str, name: str, step: float
) -> None:
    case, at = look("bracket"), LookSetting(dx_um=0.3, dz_um=5.0, dtheta_rad=0.2)
    seen = sensitivities(case, at, (name,))
    ends = [
        shown(case, replace(at, **{field: getattr(at, field) + h}))
        for h in (step, -step)
    ]
    plain = (ends[0] - ends[1]) / (2 * step)
    # a plain difference errs by the series (step over the blur's 4.6 um, squared) and
    # by the usual band's 5e-4 over twice the step, on the edges' pixels alone
    assert norm(plain - seen.slopes[0]) < 0.01 * norm(plain)


def test_slopes_to_light_are_exact(look: Look) -> None:
    case = replace(
        look("between"), light=Illumination(gain=0.9, gradient_x=0.1, gradient_y=-0.2)
    )
    at = LookSetting(gain=1.1, gradient_x=-0.2, gradient_y=0.1)
    seen = sensitivities(case, at, LIGHT)
    # the mean is linear in each: any difference is the slope
    for k, name in enumerate(LIGHT[:3]):
        value = getattr(at, name)
        more = sensitivities(case, replace(at, **{name: value + 0.3}), ())
        np.testing.assert_allclose(
            (more.mean - seen.mean) / 0.3, seen.slopes[k], atol=1e-13
        )
    assert (seen.slopes[3] == 1).all()
    assert (seen.errors == 0).all()


def test_mean_is_the_image_that_is_rendered(look: Look) -> None:
    case = look("between")
    at = LookSetting(dx_um=1.0, dtheta_rad=0.1, dz_um=2.0, zoom=1.01, gain=0.8)
    seen = sensitivities(case, at, ())
    # band_error of the usual sampling, and its margin's 1 / (40 pi**3)
    np.testing.assert_allclose(seen.mean, shown(case, at), atol=1.5e-3)


def test_slope_to_focus_vanishes_in_focus(look: Look) -> None:
    seen = sensitivities(small(look("find_gear")), names=("z",))
    assert (seen.slopes == 0).all()


def test_sign_of_the_defocus_is_in_no_single_image(look: Look) -> None:
    above, below = (
        sensitivities(small(look("bore")), LookSetting(dz_um=z), ("x", "z"))
        for z in (7.0, -7.0)
    )
    np.testing.assert_array_equal(above.mean, below.mean)
    np.testing.assert_array_equal(above.slopes[0], below.slopes[0])
    np.testing.assert_array_equal(above.slopes[1], -below.slopes[1])


def test_lens_that_shifts_with_focus_makes_z_a_shift(look: Look) -> None:
    lens = LensErrors(lateral_x=0.01)
    case = replace(small(look("bracket")), lens=lens)
    seen = sensitivities(case, names=("x", "z"))
    moved, raised = seen.slopes
    # z in focus raises the plane in focus: the part is 1 um lower, and .01 um left
    assert norm(raised + 0.01 * moved) < 1e-3 * norm(raised)


def test_gain_of_the_sensor_stretches_the_scale(look: Look) -> None:
    case = small(look("post"))
    loud = replace(case, sensor=replace(case.sensor, gain=1.5))
    quiet = replace(case, sensor=replace(case.sensor, gain=0.5))
    plain, high, low = (
        sensitivities(c, names=("x", "gain")) for c in (case, loud, quiet)
    )
    np.testing.assert_allclose(high.mean, 1.5 * plain.mean)
    np.testing.assert_allclose(high.slopes, 1.5 * plain.slopes)
    assert (plain.ceiling, high.ceiling, low.ceiling) == (1.0, 1.0, 0.5)


def test_target_without_an_edge_has_no_slopes(look: Look) -> None:
    case = look("post")
    bare = replace(
        case, moving=(), window=Window(row=230, column=310, rows=9, columns=9)
    )
    seen = sensitivities(bare, names=POSE + LIGHT)
    assert (seen.slopes[: len(POSE)] == 0).all()
    np.testing.assert_allclose(seen.slopes[5], bare.background)


@pytest.mark.parametrize(
    "change", [{"zoom": 0.0}, {"gain": -1.0}, {"dz_um": math.nan}, {"zoom": math.inf}]
)
def test_settings_that_cannot_be_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must be"):
        LookSetting(**change)


def test_unknown_names_are_refused(look: Look) -> None:
    with pytest.raises(ValueError, match="tilt"):
        sensitivities(look("post"), names=("x", "tilt"))


def test_slopes_can_be_chosen_by_name() -> None:
    flat = np.zeros((2, 3))
    seen = Sensitivities(
        names=("x", "gain"), mean=flat, slopes=np.stack((flat, flat + 1)),
        errors=np.stack((flat, flat)),
    )  # fmt: skip
    assert (slopes_of(seen, ("gain",)).slopes == 1).all()
    with pytest.raises(ValueError, match="tuple"):
        slopes_of(seen, ("theta",))
    with pytest.raises(ValueError, match="slopes"):
        replace(seen, slopes=seen.slopes[:1])
    with pytest.raises(ValueError, match="finite"):
        replace(seen, mean=np.full((2, 3), np.nan))
