"""Scenes through an imperfect lens against warped rasters and measured shifts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.arrays import FloatArray
from microplan.optics.lens.displacement import corner_um, displaced
from microplan.optics.lens.distorted_scene import (
    curvature_rest_um,
    curvature_um,
    imaged,
    lens_scene,
)
from microplan.optics.lens.jacobian import to_px
from microplan.optics.lens.lens import LensErrors
from microplan.optics.outline.outline import Arc, Outline, Ring, Segment
from microplan.optics.outline.warp import WARP_UM
from microplan.optics.render.render import render
from microplan.optics.render.sampling import BAND_ERROR, margin_error
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.otf import diffraction
from tests.optics.shapes import (
    brute_force,
    circle,
    disc,
    gear,
    microscope,
    one_layer,
    rectangle,
)

OPTICS = microscope(width_px=64, height_px=48)


def _centroid_um(image: FloatArray, optics: Microscope, window: Window) -> FloatArray:
    """Return the centroid of the light in a window, um."""
    rows, columns = np.mgrid[: window.rows, : window.columns]
    share = image / image.sum()
    px = np.array([(share * columns).sum(), (share * rows).sum()])
    px += (window.column, window.row)
    k = optics.px_per_um
    middle = ((optics.width_px - 1) / 2, (optics.height_px - 1) / 2)
    return np.asarray((px - middle) / (k, -k))


@pytest.mark.parametrize(
    "distortion", [0.03, pytest.param(-0.03, marks=pytest.mark.slow)]
)
def test_a_rendered_disc_agrees_with_a_warped_raster(distortion: float) -> None:
    lens = LensErrors(distortion=distortion, lateral_x=0.2, scale_per_um=0.01)
    radius, center, z = 9.0, (12.0, -6.0), 2.0

    def distance(x: FloatArray, y: FloatArray) -> FloatArray:
        where = np.stack(np.broadcast_arrays(x, y), axis=-1)
        back = where
        for _ in range(30):  # the map differs from 1 by less than a fifth
            back = back + where - displaced(back, lens, OPTICS, defocus_um=z)
        back = back - center
        inside = radius - np.hypot(back[..., 0], back[..., 1])
        step = float(x[1] - x[0])
        return np.asarray(inside / np.hypot(*np.gradient(inside, step)))

    shown = lens_scene(one_layer(disc(radius, center), z), OPTICS, lens, 0.0)
    found = render(shown, OPTICS, focus_um=z)
    expected = brute_force(distance, OPTICS, diffraction, samples=16, margin_px=12)
    plain = render(one_layer(disc(radius, center), z), OPTICS, focus_um=z)
    # The raster's own repetitions are 50 um away or more: of 254 um2 of light comes
    # 254 / (pi**2 4.4 50**3) = 5e-5, the mean of 1 / (pi**2 k A r**3) over the rings.
    np.testing.assert_allclose(found, expected, rtol=0, atol=BAND_ERROR + 5e-5)
    assert np.abs(found - plain).max() > 0.2


@pytest.mark.parametrize(
    "lens",
    [
        LensErrors(distortion=0.02),
        LensErrors(distortion=-0.02),
        LensErrors(lateral_x=0.05, lateral_y=-0.03),
        LensErrors(scale_per_um=2e-3),
        LensErrors(distortion=0.01, lateral_x=-0.04, scale_per_um=-1e-3),
    ],
)
def test_a_measured_centroid_moves_as_predicted(lens: LensErrors) -> None:
    optics = microscope(44.5, width_px=480, height_px=360)
    radius, center, z = 3.0, (18.0, 12.0), 5.0
    scene = one_layer(disc(radius, center), z)
    column, row = to_px(np.array(center), optics)
    half = round(12 * optics.px_per_um)
    window = Window(
        row=round(float(row)) - half,
        column=round(float(column)) - half,
        rows=2 * half + 1,
        columns=2 * half + 1,
    )
    before, after = (
        _centroid_um(render(s, optics, focus_um=0.0, window=window), optics, window)
        for s in (scene, lens_scene(scene, optics, lens, 0.0))
    )
    shift = _centroid_of_disc(lens, optics, radius, center, z) - center
    error_nm = 1000 * np.hypot(*(after - before - shift))
    assert 1000 * np.hypot(*shift) > 50
    # Of the light, wavelength / (pi**2 A r) falls beyond r, the window's border at 9 um
    # from the disc. Its displacement is missed; and what crosses the border comes or
    # goes with a lever of r, at most as much again.
    tail = optics.wavelength_um / (math.pi**2 * optics.aperture * 9.0)
    assert error_nm < 2 * tail * 1000 * np.hypot(*shift)


def _centroid_of_disc(
    lens: LensErrors,
    optics: Microscope,
    radius_um: float,
    center: tuple[float, float],
    z_um: float,
) -> FloatArray:
    """Return the centroid of a displaced disc, by quadrature over the disc.

    The Jacobian is a difference quotient: nothing is shared but `displaced`.
    """
    node, weight = np.polynomial.legendre.leggauss(12)
    r = radius_um * (1 + node) / 2
    angle = 2 * math.pi * np.arange(24) / 24
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points = np.array(center) + r[:, None, None] * unit
    images, h = displaced(points, lens, optics, defocus_um=z_um), 1e-4
    dx, dy = (
        (displaced(points + d, lens, optics, defocus_um=z_um) - images) / h
        for d in (np.array([h, 0]), np.array([0, h]))
    )
    det = dx[..., 0] * dy[..., 1] - dx[..., 1] * dy[..., 0]
    mass = (weight * r)[:, None] * det
    total: FloatArray = (mass[..., None] * images).sum(axis=(0, 1)) / mass.sum()
    return total


def test_a_pure_shift_is_the_renderers_own() -> None:
    optics = microscope()
    lens = LensErrors(lateral_x=0.3, lateral_y=-0.2)
    scene = one_layer(gear(), 4.0)
    found = render(lens_scene(scene, optics, lens, 1.0), optics, focus_um=1.0)
    expected = render(scene, optics, focus_um=1.0, shift_um=(0.9, -0.6))
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=2 * BAND_ERROR + margin_error()
    )


def test_a_pure_scale_is_another_magnification() -> None:
    optics = replace(microscope(), fill_factor=1e-6)  # a point: no other pixel area
    lens = LensErrors(scale_per_um=1e-2)
    found = imaged(gear(), optics, lens, defocus_um=2.0)
    radii = [e.radius_um for r in found.rings for e in r.edges if isinstance(e, Arc)]
    assert sorted(set(np.round(radii, 9))) == [25 * 1.02, 45 * 1.02, 50 * 1.02]
    assert len(found.rings[1].edges) == 1


def test_a_lens_without_known_errors_costs_nothing() -> None:
    scene = one_layer(gear())
    unknown = LensErrors(
        distortion_sigma=0.01, edge_offset_sigma_um=0.1, gradient_x=0.1, lateral_sigma=1
    )
    for lens in (LensErrors(), unknown):
        assert lens_scene(scene, OPTICS, lens, 3.0) is scene
    assert imaged(gear(), OPTICS, unknown, defocus_um=1.0).rings == gear().rings


def test_the_focus_of_a_layer_changes_no_other() -> None:
    lens = LensErrors(lateral_x=0.1)
    layers = tuple(
        Layer(name=str(z), outline=disc(5.0), z_um=z, reflectance=0.5)
        for z in (0.0, 10.0)
    )
    shown = lens_scene(Scene(layers=layers, background=0.1), OPTICS, lens, 10.0)
    boxes = [layer.outline.bounds_um for layer in shown.layers]
    np.testing.assert_allclose(boxes[0], (-6.0, -5.0, 4.0, 5.0), atol=1e-12)
    np.testing.assert_allclose(boxes[1], (-5.0, -5.0, 5.0, 5.0), atol=1e-12)
    assert [layer.z_um for layer in shown.layers] == [0.0, 10.0]
    assert shown.background == 0.1


def _rough_squares(outline: Outline) -> FloatArray:
    """Return r**2 of many points on all edges."""
    found = []
    for ring in outline.rings:
        for edge in ring.edges:
            t = np.linspace(0, 1, 2001)
            if isinstance(edge, Arc):
                points = np.array([edge.at(float(s)) for s in t])
            else:
                points = np.outer(1 - t, edge.start) + np.outer(t, edge.end)
            found.append((points**2).sum(axis=1))
    return np.concatenate(found)


@settings(max_examples=25, deadline=None)
@given(
    st.floats(-20, 20),
    st.floats(-15, 15),
    st.floats(1, 12),
    st.floats(0, 6.28),
    st.floats(-1e-2, 1e-2),
)
def test_curvature_is_halved_over_the_edges(
    x: float, y: float, size: float, start: float, curvature: float
) -> None:
    arc = Arc(center=(x, y), radius_um=size, start_rad=start, sweep_rad=2.5)
    rings = rectangle(x, y, x + size, y + size / 2).rings
    body = Outline(rings=(*rings, *_closed(arc).rings))
    lens = LensErrors(field_curvature_per_um=curvature)
    optics = microscope()
    scene = one_layer(body)
    (up,) = curvature_um(scene.layers, optics, lens)
    rest = curvature_rest_um(body, optics, lens)
    raised = curvature * _rough_squares(body) / 2
    # samples lie size 2.5 / 2000 apart, so r**2 is 2 r times half of that off
    atol = abs(curvature) * 40 * 12 * 2.5 / 2000
    assert up == pytest.approx((raised.min() + raised.max()) / 2, abs=atol)
    assert rest == pytest.approx((raised.max() - raised.min()) / 2, abs=atol)


def _closed(arc: Arc) -> Outline:
    """Return an arc with its chord."""
    chord = Segment(start=arc.end, end=arc.start)
    return Outline(rings=(Ring(edges=(arc, chord)),))


def test_a_curved_field_is_a_defocus_by_position() -> None:
    optics = microscope()
    lens = LensErrors(field_curvature_per_um=0.01)
    scene = one_layer(disc(2.0, (40.0, 0.0)))
    (up,) = (layer.z_um for layer in lens_scene(scene, optics, lens, 0.0).layers)
    assert up == pytest.approx(0.01 * (38**2 + 42**2) / 4, rel=1e-14)
    found = render(lens_scene(scene, optics, lens, 0.0), optics, focus_um=0.0)
    expected = render(scene, optics, focus_um=-up)
    np.testing.assert_array_equal(found, expected)


def test_what_is_beyond_the_field_does_not_count() -> None:
    optics = microscope()
    lens = LensErrors(field_curvature_per_um=1e-3)
    long = one_layer(rectangle(10.0, -2.0, 2e4, 2.0))
    (up,) = curvature_um(long.layers, optics, lens)
    far = 1.1 * corner_um(optics)
    assert up == pytest.approx(1e-3 * (100 + far**2) / 4, rel=1e-12)


def _stack(*heights: float) -> tuple[Layer, ...]:
    """Return bodies over one another: the lower ones wider."""
    return tuple(
        Layer(
            name=f"{i}",
            outline=disc(30.0 - 8 * i, (15.0, 0.0)),
            z_um=z,
            reflectance=0.5,
        )
        for i, z in enumerate(heights)
    )


@given(st.lists(st.floats(-5, 5), min_size=1, max_size=4), st.floats(-0.05, 0.05))
def test_layers_over_one_another_keep_their_order(
    heights: list[float], curvature: float
) -> None:
    layers = _stack(*heights)
    lens = LensErrors(field_curvature_per_um=curvature)
    up = curvature_um(layers, microscope(), lens)
    after = [z + u for z, u in zip(heights, up, strict=True)]
    for i, z in enumerate(heights):
        for j, other in enumerate(heights):
            if z < other:
                assert after[i] <= after[j]
            if z == other:
                assert after[i] == after[j]


def test_layers_apart_are_raised_each_by_its_own() -> None:
    layers = tuple(
        Layer(name=str(x), outline=disc(3.0, (x, 0.0)), z_um=0.0, reflectance=1.0)
        for x in (0.0, 30.0)
    )
    lens = LensErrors(field_curvature_per_um=1e-3)
    near, far = curvature_um(layers, microscope(), lens)
    assert near == pytest.approx(1e-3 * 9 / 2, rel=1e-12)  # all of its edge is 3 away
    assert far == pytest.approx(1e-3 * (27**2 + 33**2) / 4, rel=1e-12)


def test_edges_are_offset_before_they_are_displaced() -> None:
    lens = LensErrors(edge_offset_um=0.5, distortion=0.02)
    optics = microscope()
    shown = lens_scene(one_layer(disc(20.0)), optics, lens, 0.0)
    x_min, _, x_max, _ = shown.layers[0].outline.bounds_um
    edge = displaced([20.5, 0.0], lens, optics)[0]
    assert x_max == pytest.approx(edge, abs=WARP_UM)
    assert x_min == pytest.approx(-edge, abs=WARP_UM)


def test_a_radius_in_the_image_grows_by_the_offset() -> None:
    optics = microscope(44.5, width_px=240, height_px=180)
    areas = [
        render(
            lens_scene(one_layer(disc(8.0)), optics, LensErrors(edge_offset_um=d), 0.0),
            optics,
            focus_um=0.0,
        ).sum()
        * optics.um_per_px**2
        for d in (0.0, 0.1)
    ]
    grown = math.sqrt(areas[1] / areas[0]) * 8.0 - 8.0
    # both lose the same share of light, wavelength / (pi**2 A r), beyond the frame's
    # nearest border at 15 um, of which the change is of the second order
    share = optics.wavelength_um / (math.pi**2 * optics.aperture * 7.0)
    assert 1000 * grown == pytest.approx(100.0, abs=100 * share)


def test_an_offset_that_closes_a_shape_names_the_layer() -> None:
    scene = one_layer(Outline(rings=(circle(5.0), circle(0.2, hole=True))))
    lens = LensErrors(edge_offset_um=0.2)
    with pytest.raises(ValueError, match=r"layer 'part': .* vanishes"):
        lens_scene(scene, OPTICS, lens, 0.0)


@pytest.mark.parametrize("focus", [math.nan, math.inf])
def test_a_focus_that_is_no_number_is_refused(focus: float) -> None:
    with pytest.raises(ValueError, match="focus_um must be finite"):
        lens_scene(one_layer(disc(1.0)), OPTICS, LensErrors(), focus)


def test_bodies_of_no_outline_pass() -> None:
    lens = LensErrors(
        distortion=0.01, field_curvature_per_um=0.01, edge_offset_um=0.1, lateral_x=1.0
    )
    scene = one_layer(Outline(rings=()), 5.0)
    assert lens_scene(scene, OPTICS, lens, 0.0) == scene


def test_a_tool_of_centimetres_is_rendered_where_it_is_seen() -> None:
    optics = microscope()
    lens = LensErrors(distortion=-0.01)
    scene = one_layer(rectangle(-3.0, 20.0, 3.0, 2e4))
    found = render(lens_scene(scene, optics, lens, 0.0), optics, focus_um=0.0)
    near = one_layer(rectangle(-3.0, 20.0, 3.0, 300.0))
    expected = render(lens_scene(near, optics, lens, 0.0), optics, focus_um=0.0)
    # cut 240 um above the frame, or by the margin
    assert found.max() > 0.8
    np.testing.assert_allclose(found, expected, rtol=0, atol=2 * margin_error())
