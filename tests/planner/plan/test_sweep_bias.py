"""What a wavefront error moves a sweep's peak by, judged by the cell's own pictures."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.localisation.scenes import pair
from microplan.executor.run.focus_sweep import (
    Height,
    SharpnessCurve,
    peak_of,
    unbiased,
)
from microplan.executor.simulated.imaging.imaging_view import PixelWindow
from microplan.executor.simulated.imaging.photograph import photograph
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.focus.measures import face_sharpness
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.microscope import Terms
from microplan.planner.looks.model_errors.wavefront_ends import LIMITED, total_share
from microplan.planner.plan.sweep_bias import (
    SweepBias,
    focus_peak_um,
    sweep_bias,
)
from microplan.planner.task.workcell import WavefrontSpec, ZernikeTerm
from microplan.schemas.plan import HeightSearch
from tests.executor.simulated.imaging.bodies import body, circle, scene, view
from tests.featuresel.conftest import disc, make_case

STOPS_UM = tuple(float(z) for z in np.arange(-12, 12.1, 3.0))
RADIUS_UM = 14.0
MAGNIFICATION = 6.9
OFF_UM = 0.8  # of the cell's post from where the plan has it: no stop is at its face


def stated(*terms: tuple[int, float, float]) -> WavefrontSpec:
    return WavefrontSpec(
        terms=tuple(
            ZernikeTerm(noll=noll, waves=waves, sigma_waves=sigma)
            for noll, waves, sigma in terms
        )
    )


def lens_of(spec: WavefrontSpec, case: LookCase) -> LookCase:
    """Return a look as it is compiled: through what is known of the lens."""
    scope = replace(case.microscope, wavefront=spec.known)
    return replace(case, microscope=scope)


def post() -> LookCase:
    """Return the look at a small post with nothing around: quick for the cell."""
    outline = Outline(rings=(disc(RADIUS_UM),))
    layer = Layer(name="post", outline=outline, z_um=0.0, reflectance=0.75)
    parameters = {"radius_um": RADIUS_UM}
    return make_case("circle", parameters, (layer,), half_px=(32, 32), background=0.0)


def bias(spec: WavefrontSpec, case: LookCase | None = None) -> SweepBias:
    return sweep_bias(lens_of(spec, case or post()), spec, STOPS_UM, RADIUS_UM)


@cache
def peak_in_the_cell(terms: Terms) -> Height:
    """Return the peak of a sweep over the same post in the cell's own pictures."""
    region, face_um = post().window, OFF_UM
    post_in_cell = body([circle(0, 0, RADIUS_UM)], face_um - 0.01, face_um, 0.75)
    stage = replace(scene(post_in_cell, stage=0.0), stage_um=-400.0)
    window = PixelWindow(
        row=region.row, column=region.column, rows=region.rows, columns=region.columns
    )
    middle, scores = (region.rows - 1) / 2, []
    for stop_um in STOPS_UM:
        lens = replace(view(MAGNIFICATION, stop_um), wavefront=terms)
        light = photograph(stage, lens, window)
        radius_px = RADIUS_UM * lens.px_per_um
        scores.append(face_sharpness(light, middle, middle, radius_px))
    curve = SharpnessCurve(focus_um=STOPS_UM, scores=tuple(scores), noise=0.0)
    return peak_of(curve, "post")


def told(spec: WavefrontSpec, terms: Terms) -> Height:
    """Return what a run tells of the post, its plan compiled for a lens as stated."""
    off = bias(spec)
    search = HeightSearch(
        look="post", expected_um=0.0, within_um=5.0, focus_um=STOPS_UM,
        ring_radius_um=RADIUS_UM, bias_um=off.um, bias_half_width_um=off.half_width_um,
    )  # fmt: skip
    return unbiased(peak_in_the_cell(terms), search)


@pytest.mark.parametrize(
    "terms",
    [
        ((11, 0.1),),
        pytest.param(((11, -0.05),), marks=pytest.mark.slow),
        pytest.param(((11, 0.05),), marks=pytest.mark.slow),
        pytest.param(((11, -0.1),), marks=pytest.mark.slow),
        pytest.param(((22, 0.05),), marks=pytest.mark.slow),
        pytest.param(((6, 0.07), (11, 0.05)), marks=pytest.mark.slow),
        pytest.param(((8, 0.05), (11, 0.05), (22, 0.05)), marks=pytest.mark.slow),
    ],
)
def test_heights_in_the_cell_are_what_the_plan_promises(terms: Terms) -> None:
    found = told(stated(*((noll, waves, 0.0) for noll, waves in terms)), terms)
    peak = peak_in_the_cell(terms)
    assert abs(found.z_um - OFF_UM) < 2 * found.sigma_um
    # a small share of what the peak is off by, where that is more than the fit's own
    most_um = max(abs(peak.z_um - OFF_UM) / 15, 2 * peak.sigma_um)
    assert abs(found.z_um - OFF_UM) < most_um


@pytest.mark.slow
def test_spherical_aberration_costs_less_than_a_tenth_of_what_it_did() -> None:
    errors_um, peaks_um = [], []
    for waves in (0.1, 0.05, -0.05, -0.1):
        terms = ((11, waves),)
        errors_um.append(told(stated((11, waves, 0.0)), terms).z_um - OFF_UM)
        peaks_um.append(peak_in_the_cell(terms).z_um - OFF_UM)
    assert np.abs(peaks_um).min() > 0.4
    assert np.abs(errors_um).mean() < np.abs(peaks_um).mean() / 10


def test_an_unstated_lens_is_charged_as_much_as_it_moves() -> None:
    """Seven tenths of a diffraction-limited lens' total, all of it spherical."""
    terms, found = ((11, -0.05),), told(WavefrontSpec(), ((11, -0.05),))
    assert total_share() * LIMITED == pytest.approx(0.05, rel=0.02)
    assert found.z_um == peak_in_the_cell(terms).z_um  # nothing is known to take off
    assert abs(found.z_um - OFF_UM) < 2.2 * found.sigma_um
    assert abs(found.z_um - OFF_UM) > 5 * peak_in_the_cell(terms).sigma_um


def test_without_a_wavefront_error_there_is_no_bias() -> None:
    assert bias(WavefrontSpec(rms_waves=0.0)) == SweepBias()
    assert bias(stated()) == SweepBias()


@pytest.mark.parametrize("noll", [11, 22])
@pytest.mark.parametrize("waves", [0.02, 0.04])
def test_the_other_sign_moves_the_other_way(noll: int, waves: float) -> None:
    here, there = (bias(stated((noll, w, 0.0))).um for w in (waves, -waves))
    assert abs(here) > 0.01
    assert there == pytest.approx(-here, abs=1e-6)


@pytest.mark.parametrize("noll", [7, 8, 9, 10])
def test_coma_and_trefoil_alone_move_no_peak(noll: int) -> None:
    """What turned by half a turn is its opposite blurs alike above and below."""
    assert bias(stated((noll, 0.07, 0.0))).um == pytest.approx(0.0, abs=1e-3)


def test_astigmatism_moves_no_peak_of_what_is_round_but_a_bars() -> None:
    assert bias(stated((6, 0.05, 0.0))).um == pytest.approx(0.0, abs=5e-3)
    upright, spec = bar(), stated((6, 0.05, 0.0))
    lying = replace(upright, theta_rad=upright.theta_rad + math.pi / 2)
    here, there = (sweep_bias(lens_of(spec, c), spec, STOPS_UM, 0.0).um
                   for c in (upright, lying))  # fmt: skip
    assert abs(here) > 0.3
    assert there == pytest.approx(-here, rel=0.02)


def bar() -> LookCase:
    """Return a bar whose long edges alone are in view."""
    return replace(pair(), background=0.0, theta_rad=math.pi / 2)


def test_of_a_bar_at_any_angle_the_swing_is_charged() -> None:
    spec = stated((6, 0.04, 0.0), (5, 0.03, 0.0))
    one = sweep_bias(lens_of(stated((6, 0.05, 0.0)), bar()),
                     stated((6, 0.05, 0.0)), STOPS_UM, 0.0)  # fmt: skip
    case = lens_of(spec, replace(bar(), theta_any=True))
    found = sweep_bias(case, spec, STOPS_UM, 0.0)
    assert found.half_width_um == pytest.approx(abs(one.um), rel=0.05)
    assert abs(found.um) < 0.05 * found.half_width_um


def test_sigmas_of_stated_terms_are_charged_by_what_they_move() -> None:
    """In squares: each by the slope that a term has there."""
    spec = stated((11, 0.04, 0.01), (22, 0.0, 0.01))
    slopes = []
    for noll, about in ((11, 0.04), (22, 0.0)):
        ends = [{11: 0.04} | {noll: about + step} for step in (0.002, -0.002)]
        up, down = (bias(stated(*((n, w, 0.0) for n, w in e.items()))) for e in ends)
        slopes.append((up.um - down.um) / 0.004)
    sure = stated((11, 0.04, 0.0))
    unsure_um2 = bias(spec).half_width_um ** 2 - bias(sure).half_width_um ** 2
    wanted = 1.96 * 0.01 * math.hypot(*slopes)
    assert math.sqrt(unsure_um2) == pytest.approx(wanted, rel=0.1)


def test_a_total_is_shared_by_terms_that_may_lie_any_way() -> None:
    """Of drawn lenses with the same total 95 % move the peak by less."""
    rng = np.random.default_rng(3)
    drawn = rng.normal(size=(4000, 7))
    share = drawn[:, 6] / np.sqrt((drawn**2).sum(axis=1))  # Noll 5 to 11
    slope = bias(stated((11, 0.02, 0.0))).um / 0.02
    half_um = bias(WavefrontSpec(rms_waves=0.05)).half_width_um
    inside = float(np.mean(np.abs(share * 0.05 * slope) < half_um))
    assert inside == pytest.approx(0.95, abs=0.02)


def test_a_sweep_without_a_peak_tells_nothing() -> None:
    spec, far = stated((11, 0.05, 0.01)), tuple(z + 60 for z in STOPS_UM)
    found = sweep_bias(lens_of(spec, post()), spec, far, RADIUS_UM)
    assert found == SweepBias(half_width_um=12.0)  # half of the sweep


def test_who_knows_less_of_a_lens_is_promised_less() -> None:
    """Of .07 waves the peak moves back, as if nothing had been unknown."""
    halves = [bias(stated((11, 0.1, s))).half_width_um for s in (0.01, 0.03, 0.07)]
    assert halves[0] < halves[1] / 2
    assert halves[1] < halves[2] / 2


def test_a_long_sweep_has_the_bias_of_its_middle() -> None:
    spec = stated((11, 0.05, 0.0))
    long = tuple(float(z) for z in np.arange(-3000, 3001, 3.0))
    found = sweep_bias(lens_of(spec, post()), spec, long, RADIUS_UM)
    through, without = (
        focus_peak_um(lens_of(lens, post()), long[900:1101], radius_um=RADIUS_UM)
        for lens in (spec, stated())
    )
    assert through is not None
    assert without is not None
    assert found.um == pytest.approx(through - without, rel=0.01)
