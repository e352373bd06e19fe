"""Mapped outlines against the map itself, densely sampled."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from microplan.arrays import FloatArray
from microplan.optics.lens.displacement import displaced_far
from microplan.optics.lens.lens import LensErrors
from microplan.optics.outline.outline import Arc, Outline, flatten
from microplan.optics.outline.warp import WARP_UM, Map, scaled, warped
from tests.optics.shapes import disc, gear, microscope, polygon, rectangle

OPTICS = microscope()


def _barrel(points: FloatArray) -> FloatArray:
    return displaced_far(points, LensErrors(distortion=-0.03), OPTICS)


def _shear(points: FloatArray) -> FloatArray:
    x, y = points.T
    return np.column_stack([1.2 * x - 0.1 * y + 5.0, 0.3 * x + 0.9 * y - 7.0])


def _fine(outline: Outline, count: int) -> list[FloatArray]:
    """Return many points on every edge, by its own parameter."""
    t = np.linspace(0, 1, count)[:, None]
    points = []
    for ring in outline.rings:
        for edge in ring.edges:
            if isinstance(edge, Arc):
                points.append(np.array([edge.at(float(s[0])) for s in t]))
            else:
                points.append(np.array(edge.start) * (1 - t) + np.array(edge.end) * t)
    return points


@pytest.mark.parametrize("mapping", [_barrel, _shear])
@pytest.mark.parametrize("error_um", [WARP_UM, 1e-2])
def test_mapped_points_lie_on_the_mapped_outline(mapping: Map, error_um: float) -> None:
    source = gear()
    image = warped(source, mapping, error_um=error_um)
    mapped = mapping(np.concatenate(_fine(source, 41)))
    dense = np.concatenate(_fine(image, 801))
    spacing = max(e.length_um for r in image.rings for e in r.edges) / 800
    away, _ = cKDTree(dense).query(mapped)
    # off sideways by the error, along by half the spacing of the dense points
    sideways = np.sqrt(np.maximum(away**2 - (spacing / 2) ** 2, 0))
    assert sideways.max() <= error_um


def test_a_circle_about_the_axis_keeps_four_arcs() -> None:
    image = warped(disc(30.0), _barrel)
    (ring,) = image.rings
    assert len(ring.edges) == 4
    radius = _barrel(np.array([30.0, 0.0]))[0]
    for edge in ring.edges:
        assert isinstance(edge, Arc)
        assert edge.radius_um == pytest.approx(radius, rel=1e-13)
        assert math.hypot(*edge.center) < 1e-12


def test_the_identity_keeps_corners_and_areas() -> None:
    source = gear()
    image = warped(source, lambda points: points)
    assert image.area_um2 == pytest.approx(source.area_um2, rel=1e-12)
    assert image.perimeter_um == pytest.approx(source.perimeter_um, rel=1e-12)
    assert len(image.rings[0].edges) == len(source.rings[0].edges)
    assert [ring.layer for ring in image.rings] == ["", ""]


def test_the_area_is_the_integral_of_the_determinant() -> None:
    d, corner = -0.03, math.hypot(*OPTICS.field_um) / 2
    image = warped(rectangle(-40, 10, 30, 50), _barrel)
    # det of r (1 + a r^2): (1 + a r^2) (1 + 3 a r^2), a polynomial: Gauss is exact
    node, weight = np.polynomial.legendre.leggauss(8)
    x, y = -5 + 35 * node, 30 + 20 * node[:, None]
    q = d * (x**2 + y**2) / corner**2
    exact = 35 * 20 * (weight[:, None] * weight * (1 + q) * (1 + 3 * q)).sum()
    assert image.area_um2 == pytest.approx(exact, abs=WARP_UM * 220)


@settings(max_examples=30)
@given(
    st.floats(0.1, 10),
    st.floats(-100, 100),
    st.floats(-100, 100),
)
def test_a_similarity_keeps_arcs_either_way(factor: float, x: float, y: float) -> None:
    quick = scaled(gear(), factor, (x, y))
    slow = warped(gear(), lambda points: points * factor + (x, y))
    assert len(quick.rings[1].edges) == 1
    assert quick.area_um2 == pytest.approx(gear().area_um2 * factor**2, rel=1e-10)
    assert slow.area_um2 == pytest.approx(quick.area_um2, rel=1e-10)
    np.testing.assert_allclose(
        flatten(quick.rings[0], 0.01)[::7],
        flatten(gear().rings[0], 0.01 / factor)[::7] * factor + (x, y),
        atol=1e-10,
    )


def test_edges_of_centimetres_stay_closed() -> None:
    bar = polygon([(-2e4, -100.0), (2e4, -100.0), (2e4, 300.0), (-2e4, 300.0)])
    image = warped(bar, _barrel)
    assert len(image.rings[0].edges) < 2000
    assert math.isfinite(image.area_um2)


def test_a_map_that_is_rough_at_every_scale_is_refused() -> None:
    def rough(points: FloatArray) -> FloatArray:
        return points + np.sin(points[:, :1] * (1e9, 1.7e9))

    with pytest.raises(ValueError, match="too rough"):
        warped(rectangle(0, 0, 10, 10), rough)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_errors_and_factors_that_cannot_be_are_refused(value: float) -> None:
    with pytest.raises(ValueError, match="error_um must be positive"):
        warped(disc(1.0), _barrel, error_um=value)
    with pytest.raises(ValueError, match="factor must be positive"):
        scaled(disc(1.0), value)
