"""What coherence may move, measured on dilated outlines, against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.featuresel.features.contour import with_contour
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.trials import prepare
from microplan.optics.coherence.degree import Coherence
from microplan.optics.coherence.dilation import MOST_OFFSET, differing_um, dilation_um
from microplan.optics.coherence.edge_offsets import edge_offset_um
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer
from microplan.planner.looks.edge_shifts.coherence_shift import (
    coherence_shift,
    dilated,
    edge_contrasts,
)
from tests.optics.shapes import rectangle

ANY = Coherence(least=0.0, most=1.0, is_stated=False)


def test_unstated_light_moves_edges_by_nothing_to_the_most(post: LookCase) -> None:
    scope = post.microscope
    airy_um = scope.wavelength_um / scope.aperture
    assert dilation_um(ANY, scope, 0.3) == (0.0, MOST_OFFSET * airy_um)
    assert differing_um(ANY, scope) == pytest.approx(MOST_OFFSET * airy_um / 2)
    assert dilation_um(None, scope, 1.0) == (0.0, 0.0)
    # the bound holds at every coherence and contrast, within the table's .006
    moved = [edge_offset_um(s, scope, c) for s in np.linspace(0.01, 4, 40)
             for c in (0.1, 0.5, 1.0)]  # fmt: skip
    assert max(moved) <= (MOST_OFFSET + 0.006) * airy_um
    stated = Coherence(least=0.4, most=0.6)
    low, high = dilation_um(stated, scope, 0.5)
    ends = [edge_offset_um(s, scope, 0.5) for s in (0.4, 0.5, 0.6)]
    assert low <= min(ends) <= max(ends) <= high


def test_dark_bodies_grow_and_bright_ones_shrink(post: LookCase) -> None:
    case = post
    body = case.moving[0]
    dark = replace(case, background=0.9)
    for each, way in ((case, -1), (dark, 1)):
        moved = dilated(each, 0.2).moving[0].outline
        grown_um2 = way * 0.2 * body.outline.perimeter_um
        # of a circle the rest is pi 0.2**2
        assert moved.area_um2 - body.outline.area_um2 == pytest.approx(
            grown_um2, abs=0.2
        )
    assert dilated(case, 0.0) is case


def test_the_centre_of_a_circle_stays(post: LookCase) -> None:
    case = post
    chain = ("circle_caliper",)
    found = coherence_shift(case, prepare(case, [chain]), chain, ANY, root_seed=1)
    assert found.um < 0.005  # of edges that move by .157 um
    assert found.differing_um == 0
    none = coherence_shift(case, prepare(case, [chain]), chain, None, root_seed=1)
    assert (none.um, none.rad, none.dilation_um) == (0.0, 0.0, 0.0)


def test_edges_of_other_directions_add_half_of_what_they_differ_by(
    post: LookCase,
) -> None:
    light, chain = Coherence(least=0.3, most=0.3), ("circle_caliper",)
    coma = replace(post.microscope, wavefront=((8, 0.05),))
    case = replace(post, microscope=coma, background=0.0)
    found = coherence_shift(case, prepare(case, [chain]), chain, light, root_seed=1)
    # .044 um the one side, .008 um the other (test_aberrated_edges)
    assert found.uneven_um == pytest.approx(0.021, abs=0.004)
    assert found.uneven_um <= found.um < found.uneven_um + 0.005


def test_edges_of_other_contrast_add_half(post: LookCase) -> None:
    case = post
    assert np.ptp(edge_contrasts(case)) < 1e-9
    # half of the post's surroundings are nearly as bright as the post
    under = Layer(name="plate", outline=rectangle(0, -400, 400, 400),
                  z_um=-5.0, reflectance=0.5)  # fmt: skip
    mixed = replace(case, static=(*case.static, under))
    contrasts = edge_contrasts(mixed)
    own, ground = case.moving[0].reflectance, case.background
    assert sorted(set(contrasts.round(6).tolist())) == pytest.approx(
        sorted(1 - math.sqrt(g / own) for g in (0.5, ground)), abs=1e-5
    )
    chain = ("circle_caliper",)
    found = coherence_shift(mixed, prepare(mixed, [chain]), chain, ANY, root_seed=1)
    scope = case.microscope
    assert found.differing_um == pytest.approx(differing_um(ANY, scope))
    assert found.um >= found.differing_um


def test_a_single_edge_moves_with_its_dilation(post: LookCase) -> None:
    """A body seen by one side alone is displaced by all of it."""
    case = post
    wide = Outline(rings=rectangle(0, -300, 300, 300).rings)
    moving = (replace(case.moving[0], outline=wide),)
    target = with_contour(
        replace(case.target, kind="outline", parameters={"extent_um": 30.0}), [wide]
    )
    single = replace(case, moving=moving, target=target)
    x0 = dilated(single, 0.1).moving[0].outline.bounds_um[0]
    assert x0 == pytest.approx(0.1)  # brighter than its ground: it shrinks
