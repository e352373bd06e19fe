"""Predicted polarity and contrast of drawn edges."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.localisation.polarity import judge, judge_lit
from benchmarks.selection.lit_parts import lit_case
from benchmarks.selection.random_parts import polygon, random_case
from microplan.featuresel.features.contour import with_contour
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contour.polarity import predict
from microplan.optics.outline.outline import Outline, Ring
from microplan.optics.render.scene import Layer, Window

Look = Callable[[str], LookCase]


@pytest.mark.parametrize(
    "seeds", [range(4), pytest.param(range(4, 12), marks=pytest.mark.slow)]
)
def test_the_exact_reference_agrees_on_every_kept_edge_of_random_parts(
    seeds: range,
) -> None:
    found = [judge(seed) for seed in seeds]
    assert sum(one.wrong for one in found) == 0
    assert sum(one.kept for one in found) > 0.3 * sum(one.points for one in found)


@pytest.mark.parametrize(
    "kind", ["transmitted", "ring", pytest.param("line", marks=pytest.mark.slow)]
)
def test_rays_agree_on_every_kept_edge_in_other_light(kind: str) -> None:
    found = judge_lit(kind, 0)
    assert found.wrong == 0
    assert found.kept > 0.3 * found.points


def test_in_a_ring_s_light_corners_tell_no_polarity() -> None:
    # where another edge begins within half a blur, which side is inside is not told:
    # rays find the first point .01 brighter outside, the image .09 darker
    case = lit_case(random_case(np.random.default_rng((7, 19))), "ring")
    found = predict(nominal_render(case), case.target)
    x, y, *_ = case.target.contour[0]
    ends = [end for ring in case.moving[0].outline.rings for end in corners_of(ring)]
    assert min(math.dist((x, y), end) for end in ends) < 0.2
    assert not found.kept[0]
    assert found.kept.sum() > 1000


def corners_of(ring: Ring) -> list[tuple[float, float]]:
    """Return where a ring's edges begin."""
    return [edge.start for edge in ring.edges]


def test_an_isolated_edge_in_focus_has_the_step_of_its_reflectances(look: Look) -> None:
    case = look("post")
    found = predict(nominal_render(case), case.target)
    assert found.kept.mean() > 0.95
    # .15 outside, .75 inside; the filter of .8 to 1.2 px takes in most of the blur
    np.testing.assert_allclose(found.step[found.kept], -0.6, rtol=0.15)
    assert abs(found.offset_px[found.kept].mean()) < 0.05


def test_a_darker_part_is_brighter_outside(look: Look) -> None:
    case = look("post")
    dark = replace(case, background=0.8, moving=_shaded(case, 0.1))
    found = predict(nominal_render(dark), dark.target)
    assert found.kept.mean() > 0.95
    assert (found.step[found.kept] > 0.5).all()


def grating(look: Look, focus_um: float, sigma_um: float) -> LookCase:
    """Return a plate with slots of 4 um, 8 um apart: they swap bright and dark.

    The transfer is below 0 from blur / period = 1.22 to 2.23: z = 10.5 to 19.3 um.
    """
    case = look("bracket")
    rings = [polygon([(-40, -30), (40, -30), (40, 30), (-40, 30)])]
    for x in range(-30, 30, 8):
        slot = [(x, -22.0), (x + 4.0, -22.0), (x + 4.0, 22.0), (x, 22.0)]
        rings.append(polygon(slot).reversed())
    outline = Outline(rings=tuple(rings))
    moving = (replace(case.moving[0], outline=outline),)
    spread = replace(case.spread, focus_sigma_um=sigma_um)
    found = replace(case, moving=moving, focus_um=focus_um, spread=spread)
    target = with_contour(replace(case.target, parameters={"extent_um": 50}), [outline])
    return replace(found, target=target)


def kept_slots(case: LookCase) -> tuple[float, float]:
    """Return the share kept of the slots' long sides inside, and of the plate's rim."""
    found = predict(nominal_render(case), case.target)
    points = np.array(case.target.contour)
    inside = (np.abs(points[:, 0]) < 20) & (np.abs(points[:, 2]) > 0.9)
    inside &= np.abs(points[:, 1]) < 12
    rim = np.abs(points[:, 1]) > 29
    return float(found.kept[inside].mean()), float(found.kept[rim].mean())


def test_a_grating_is_kept_below_its_limit_and_not_beyond(look: Look) -> None:
    slots, rim = kept_slots(grating(look, 4.0, 0.0))
    assert slots > 0.9
    assert rim > 0.9
    slots, rim = kept_slots(grating(look, 14.0, 0.0))
    assert slots == 0
    assert rim > 0.5


def test_focus_errors_that_may_swap_the_polarity_drop_edges(look: Look) -> None:
    # two sigma of 5 um reach from 4 um, where all slots are seen, to 14
    slots, rim = kept_slots(grating(look, 4.0, 5.0))
    assert slots == 0
    assert rim > 0.5


@pytest.mark.parametrize("reflectance", [0.10, 0.11])
def test_nothing_is_kept_without_contrast(reflectance: float, look: Look) -> None:
    case = look("bracket")
    dull = replace(case, moving=_shaded(case, reflectance))
    found = predict(nominal_render(dull), dull.target)
    assert not found.kept.any()
    assert np.isfinite(found.step).all()
    assert np.isfinite(found.offset_px).all()


def test_what_is_out_of_view_is_not_kept(look: Look) -> None:
    case = look("post")
    aside = replace(case, window=Window(row=0, column=0, rows=60, columns=60))
    target = replace(case.target, column=60.0, row=30.0)
    found = predict(nominal_render(aside), target)
    assert not found.kept.any()
    blank = replace(target, contour=())
    assert predict(nominal_render(aside), blank).kept.shape == (0,)


def _shaded(case: LookCase, reflectance: float) -> tuple[Layer, ...]:
    return tuple(replace(layer, reflectance=reflectance) for layer in case.moving)
