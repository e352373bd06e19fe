"""A sample of the random scenes that the fidelity selector is judged by."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.optics.selector import COUNT, draw, judge

# One layer and closed forms that take a moment, several layers, high apertures, and
# the scenes that once found bounds which were none: cut arcs, wide bodies, an arc that
# touches its box, and a body hardly wider than its blur.
SAMPLE = (5, 13, 17, 21, 22, 37, 44, 47, 53, 55, 202)
DEAREST = 1, 8, 25, 31, 43, 448


@pytest.mark.parametrize(
    "index", [*SAMPLE, *(pytest.param(k, marks=pytest.mark.slow) for k in DEAREST)]
)
def test_an_image_errs_by_what_was_predicted_at_most(index: int) -> None:
    found = judge(index)
    assert found.true <= found.predicted + found.unsure
    assert found.unsure < 1.5e-4  # the truth is good enough to tell


def test_the_scenes_cover_what_the_renderer_is_for() -> None:
    cases = [draw(index) for index in range(COUNT)]
    optics = [case.microscope for case in cases]
    sines = [o.aperture / o.medium_index for o in optics]
    assert min(sines) < 0.06
    assert max(sines) > 0.94
    zooms = [o.magnification for o in optics]
    assert 2 <= min(zooms) < 2.1
    assert 58 < max(zooms) <= 60
    layers = [layer for case in cases for layer in case.scene.layers]
    assert {len(case.scene.layers) for case in cases} == {1, 2, 3, 4}
    heights = np.abs([layer.z_um for layer in layers])
    assert heights.max() <= 200
    assert np.quantile(heights, 0.95) > 100
    focused = [any(la.z_um == 0 for la in case.scene.layers) for case in cases]
    assert np.mean(focused) > 0.4
    boxes = [layer.outline.bounds_um for layer in layers]
    sizes = np.array([x1 - x0 for x0, _, x1, _ in boxes])
    assert sizes.min() < 2.5
    assert sizes.max() > 180
