"""Where a lens shows points: map, inverse, Jacobian, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.arrays import FloatArray
from microplan.optics.lens.displacement import (
    REACH,
    corner_um,
    displaced,
    displaced_far,
)
from microplan.optics.lens.lens import MAX_DISTORTION, LensErrors
from tests.optics.shapes import microscope

OPTICS = microscope()
CORNER = corner_um(OPTICS)
OFF = LensErrors()
LENS = LensErrors(distortion=0.01, lateral_x=0.003, lateral_y=-0.002, scale_per_um=2e-5)

tilts = st.floats(-0.1, 0.1)
lenses = st.builds(
    LensErrors,
    distortion=st.floats(-MAX_DISTORTION, MAX_DISTORTION),
    lateral_x=tilts,
    lateral_y=tilts,
    scale_per_um=st.floats(-1e-3, 1e-3),
)
angles = st.floats(0, 2 * math.pi)


def _at(share: float, angle: float) -> FloatArray:
    """Return a point at a share of the corner radius."""
    return share * CORNER * np.array([math.cos(angle), math.sin(angle)])


def test_distortion_is_stated_at_the_corner_of_the_field() -> None:
    corner = np.array(OPTICS.field_um) / 2
    shown = displaced(corner, LensErrors(distortion=0.01), OPTICS)
    np.testing.assert_allclose(shown, 1.01 * corner, rtol=1e-15)
    half = displaced(corner / 2, LensErrors(distortion=0.01), OPTICS)
    np.testing.assert_allclose(half, (1 + 0.01 / 4) * corner / 2, rtol=1e-15)


def test_shift_and_scale_grow_with_the_defocus() -> None:
    lens = LensErrors(lateral_x=0.01, lateral_y=-0.02, scale_per_um=1e-4)
    shown = displaced([[10.0, 0.0], [0.0, 30.0]], lens, OPTICS, defocus_um=[5.0, -10.0])
    # by hand: 10 (1 + 5e-4) + .05, -.1 and -.1, 30 (1 - 1e-3) + .2
    np.testing.assert_allclose(shown, [[10.055, -0.1], [-0.1, 30.17]], rtol=1e-14)


def test_a_lens_without_errors_moves_nothing() -> None:
    points = np.random.default_rng(3).normal(size=(50, 2)) * 1e4
    np.testing.assert_array_equal(displaced(points, OFF, OPTICS), points)
    np.testing.assert_array_equal(displaced_far(points, OFF, OPTICS), points)
    assert not OFF.moves_points
    assert not OFF.changes_scene


@given(lenses, st.floats(0, 50), st.floats(0, 50), angles)
def test_the_far_map_keeps_the_order_along_a_ray(
    lens: LensErrors, one: float, other: float, angle: float
) -> None:
    lens = LensErrors(distortion=lens.distortion)
    near, far = sorted((one, other))
    radii = [
        math.hypot(*displaced_far(_at(share, angle), lens, OPTICS))
        for share in (near, far)
    ]
    if far - near > 1e-9:
        assert radii[0] < radii[1]
    inside = _at(min(near, REACH), angle)
    np.testing.assert_allclose(
        displaced_far(inside, lens, OPTICS), displaced(inside, lens, OPTICS), rtol=1e-14
    )


@pytest.mark.parametrize("distortion", [-0.25, -0.01, 0.1])
def test_the_far_map_is_smooth_at_its_reach(distortion: float) -> None:
    lens, h = LensErrors(distortion=distortion), 1e-6
    x = (REACH + h * np.array([-1, 0, 1])) * CORNER
    shown = displaced_far(np.column_stack([x, 0 * x]), lens, OPTICS)[:, 0]
    before, after = np.diff(shown)
    # the slope changes by 6 d reach h; differences round at 1e-16 * 1.1 / h
    assert after == pytest.approx(before, abs=(7 * REACH * h**2 + 1e-15) * CORNER)


def test_points_where_a_barrel_folds_the_image_are_refused() -> None:
    lens = LensErrors(distortion=-0.25)
    limit = 1 / math.sqrt(0.75)
    displaced(_at(limit * 0.999, 1.0), lens, OPTICS)
    with pytest.raises(ValueError, match=r"1\.156 corner radii .* folds"):
        displaced(_at(limit * 1.001, 1.0), lens, OPTICS)


def test_a_scale_that_leaves_no_image_is_refused() -> None:
    lens = LensErrors(scale_per_um=-0.01)
    with pytest.raises(ValueError, match=r"scale_per_um -0\.01 leaves no image"):
        displaced([1.0, 1.0], lens, OPTICS, defocus_um=100.0)


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300])
def test_points_that_are_no_numbers_are_refused(value: float) -> None:
    with pytest.raises(ValueError, match=r"finite|folds"):
        displaced([value, 0.0], LENS, OPTICS)
    if not math.isfinite(value):
        with pytest.raises(ValueError, match="defocus_um must be finite"):
            displaced([0.0, 0.0], LENS, OPTICS, defocus_um=value)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_points_have_two_coordinates(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"points must be \(\.\.\., 2\)"):
        displaced(np.zeros(shape), LENS, OPTICS)
