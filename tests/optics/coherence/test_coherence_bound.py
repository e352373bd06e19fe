"""Errors of incoherent images of whole bodies, predicted and measured."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.optics.coherence.coherence import render_coherent
from microplan.optics.coherence.edge_offsets import (
    CLOSE_EDGES,
    NARROW_EDGES,
    coherence_error,
    mean_width_um,
    scene_error,
)
from microplan.optics.outline.outline import Outline
from microplan.optics.render.render import render
from microplan.optics.render.scene import Layer, Scene, Window
from tests.optics.shapes import circle, disc, gear, microscope, one_layer, rectangle

TEETH = Window(row=60, column=0, rows=60, columns=90)  # and some of the bore


@pytest.mark.parametrize("coherence", [0.3, 0.7])
@pytest.mark.parametrize("z_um", [0.0, 5.0])
def test_the_gear_errs_by_no_more_than_predicted(coherence: float, z_um: float) -> None:
    optics, scene = microscope(20.0, 300, 300), one_layer(gear(), z_um)
    found = render(scene, optics, focus_um=0.0, window=TEETH)
    truth = render_coherent(
        scene, optics, focus_um=0.0, coherence=coherence, window=TEETH, samples=6
    )
    predicted = scene_error(scene, optics, focus_um=0.0, coherence=coherence)
    measured = np.abs(found - truth).max()
    # the median over many scenes is below 2 (benchmarks.optics.coherence), none here
    # above 3
    assert measured <= predicted < 3 * measured


def test_incoherent_light_and_no_contrast_err_by_nothing() -> None:
    optics = microscope()
    assert scene_error(one_layer(gear()), optics, focus_um=0.0, coherence=0.0) == 0
    plain = Scene(layers=one_layer(gear()).layers, background=1.0)
    assert scene_error(plain, optics, focus_um=0.0, coherence=0.5) == 0
    empty = Scene(layers=(), background=0.5)
    assert scene_error(empty, optics, focus_um=0.0, coherence=0.5) == 0


def test_narrow_bodies_are_charged_more() -> None:
    optics = microscope()
    wide, narrow = (
        scene_error(one_layer(disc(r), 10.0), optics, focus_um=0.0, coherence=0.3)
        for r in (5.0, 4.8)  # two Fresnel radii of 10 um are 4.9 um
    )
    edge = coherence_error(0.3, optics, 1.0, 10.0)
    assert wide == pytest.approx(CLOSE_EDGES * edge)
    assert narrow == pytest.approx(NARROW_EDGES * edge)


def test_heights_add_up_and_levels_scale() -> None:
    optics = microscope()
    low = Layer(name="a", outline=disc(20.0), z_um=0.0, reflectance=0.5)
    high = replace(low, name="b", z_um=4.0, reflectance=0.02)
    beside = replace(low, name="c")
    scene = Scene(layers=(low, high, beside), background=0.18)
    found = scene_error(scene, optics, focus_um=0.0, coherence=0.4)
    contrast = 1 - math.sqrt(0.02 / 0.5)
    edges = sum(coherence_error(0.4, optics, contrast, z) for z in (0.0, 4.0))
    assert found == pytest.approx(0.48 * CLOSE_EDGES * edges)


def test_mean_widths() -> None:
    assert mean_width_um(disc(3.0)) == pytest.approx(3.0)
    assert mean_width_um(rectangle(0.0, 0.0, 1000.0, 2.0)) == pytest.approx(2, rel=3e-3)
    ring = Outline(rings=(circle(50.0), circle(48.0, hole=True)))
    assert mean_width_um(ring) == pytest.approx(2.0)
    pierced = Outline(rings=(circle(50.0), circle(4.0, hole=True)))
    assert mean_width_um(pierced) == pytest.approx(4.0)


def test_far_defocus_and_nan_are_refused() -> None:
    scene = one_layer(disc(5.0), 100.0)
    for focus_um, coherence in ((0.0, 0.5), (math.nan, 0.5), (100.0, math.nan)):
        with pytest.raises(ValueError, match=r"coherence|defocus"):
            scene_error(scene, microscope(), focus_um=focus_um, coherence=coherence)
