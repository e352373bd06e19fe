from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jv

from benchmarks.localisation.depth_of_field import (
    DepthOfField,
    depth_of_field,
    limit_curve,
)
from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.limits.resolution import SAFE, contrast, spurious_um
from microplan.featuresel.look.scenario import LookCase
from microplan.optics.outline.outline import Outline, Ring, Segment
from microplan.optics.render.scene import Layer, Window
from microplan.optics.transfer.otf import exact, hopkins

Look = Callable[[str], LookCase]


def nodes(low: float, high: float, count: int) -> tuple[FloatArray, FloatArray]:
    """Return Gauss nodes and weights on an interval."""
    x, w = np.polynomial.legendre.leggauss(count)
    return low + (high - low) * (x + 1) / 2, w * (high - low) / 2


def tooth_share(radius_um: FloatArray) -> FloatArray:
    """Return the 18th harmonic (N,) of the gear's material on circles.

    One tooth: corners at 50 um +-4 deg and 45 um +-6 deg, chords between.
    """
    angle = np.radians(np.linspace(-10, 10, 4001))[1::2]
    x, y = (
        radius_um[:, None] * np.cos(angle),
        radius_um[:, None] * np.abs(np.sin(angle)),
    )

    def inside(one: tuple[float, float], two: tuple[float, float]) -> BoolArray:
        (r, a), (s, b) = one, two
        p = r * math.cos(math.radians(a)), r * math.sin(math.radians(a))
        q = s * math.cos(math.radians(b)), s * math.sin(math.radians(b))
        return np.asarray((q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) > 0)

    tip, flank = inside((50, -4), (50, 4)), inside((50, 4), (45, 6))
    root = inside((45, 6), (45, 14))
    material = tip & np.where(np.abs(angle) < np.radians(6), flank | root, root)
    return np.asarray((material * np.cos(18 * angle)).mean(axis=1))


@cache
def ring_spectrum(cutoff_per_um: float) -> tuple[FloatArray, FloatArray]:
    """Return frequencies and what each adds to the harmonic on 47.5 um, unblurred."""
    radius, dr = nodes(44.5, 50.0, 200)
    f, df = nodes(0.0, cutoff_per_um, 500)
    waves = 2 * np.pi * f
    spectrum = jv(18, np.outer(waves, radius)) @ (tooth_share(radius) * radius * dr)
    return f, np.asarray(jv(18, waves * 47.5) * spectrum * f * df)


def ring_contrast(case: LookCase, z_um: float) -> float:
    """Return the harmonic on 47.5 um by Hankel transforms, out of focus over in."""
    scope = case.microscope
    f, added = ring_spectrum(scope.cutoff_per_um)
    there, here = (
        exact(
            f / scope.cutoff_per_um,
            z_um=z,
            aperture=scope.aperture,
            wavelength_um=scope.wavelength_um,
        )
        @ added
        for z in (z_um, 0.0)
    )
    return float(there / here)


def test_teeth_change_sign_where_their_own_harmonic_does(look: Look) -> None:
    case = replace(look("find_gear"), model="exact")
    expected = brentq(lambda z: ring_contrast(case, z), 19.0, 22.0, xtol=1e-3)
    assert expected == pytest.approx(20.6, abs=0.05)
    # the usual band's 5e-4, of a harmonic of .5 that falls by .013 a um
    assert spurious_um(case) == pytest.approx(expected, abs=0.08)


def test_contrast_of_teeth_is_that_of_their_harmonic(look: Look) -> None:
    case = replace(look("find_gear"), model="exact")
    found = contrast(case, (0.0, 5.0, 15.0, 25.0, -25.0))
    expected = [ring_contrast(case, z) for z in (0.0, 5.0, 15.0, 25.0, 25.0)]
    # the usual band's 5e-4, of a harmonic of .5
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_limit_of_teeth_does_not_depend_on_camera_pose_or_what_stands_in_front(
    look: Look,
) -> None:
    case = look("find_gear")
    plain = spurious_um(case)
    scope = replace(case.microscope, magnification=10.0)
    column, row = replace(case, microscope=scope).frame.to_pixel(1.7, 0.4)
    target = replace(
        case.target, column=column, row=row, theta_rad=0.7, px_per_um=10.0 / 7.5
    )
    other = replace(
        case, microscope=scope, target=target, theta_rad=0.7, x_um=1.7, y_um=0.4
    )
    assert spurious_um(other) == pytest.approx(plain, abs=0.08)
    raised = replace(look("between"), focus_um=5.0)
    assert spurious_um(raised) == pytest.approx(plain, abs=1e-9)
    assert SAFE * plain < 0.8 * 20.6


def test_contrast_of_an_edge_is_its_transfer_summed_over_frequency(
    look: Look,
) -> None:
    corners = [(-250.0, -250.0), (0.0, -250.0), (0.0, 250.0), (-250.0, 250.0)]
    sides = zip(corners, corners[1:] + corners[:1], strict=True)
    ring = Ring(edges=tuple(Segment(start=a, end=b) for a, b in sides))
    face = Layer(name="face", outline=Outline(rings=(ring,)), z_um=3.0, reflectance=0.8)
    case = replace(look("post"), moving=(face,))
    places = tuple((0.0, y, 1.0, 0.0) for y in np.linspace(-8, 8, 9).tolist())
    case = replace(case, target=replace(case.target, kind="edge", contour=places))
    scope = case.microscope
    f, df = nodes(0.0, scope.cutoff_per_um, 400)
    step = scope.wavelength_um / scope.aperture / 8  # the slope is over two of them
    heights = (0.0, 1.0, 3.0, 8.0)
    slopes = [
        hopkins(f / scope.cutoff_per_um, scope.rim_w20_um(z) / scope.wavelength_um)
        @ (np.sinc(2 * f * step) * df)
        for z in heights
    ]
    expected = np.array(slopes) / slopes[0]
    # cubics between four samples a wavelength / A
    np.testing.assert_allclose(contrast(case, heights), expected, atol=1e-3)


def test_edges_and_circles_never_change_sign(look: Look) -> None:
    case = look("bore")
    assert spurious_um(case) == math.inf
    found = contrast(case, (1.0, 3.0, 10.0, 20.0, 40.0))
    assert (found > 0).all()
    assert (np.diff(found) < 0).all()


def test_target_without_contrast_has_none_at_any_focus(look: Look) -> None:
    case = look("find_gear")
    bare = replace(case.moving[0], reflectance=case.background)
    none = replace(case, moving=(bare,))
    assert (contrast(none, (0.0, 10.0)) == 0).all()
    assert spurious_um(none) == math.inf


def test_target_without_edges_is_refused(look: Look) -> None:
    case = look("post")
    empty = replace(case.moving[0], outline=Outline(rings=()))
    target = replace(case.target, contour=())
    with pytest.raises(ValueError, match="drawn edges"):
        contrast(replace(case, moving=(empty,), target=target), (1.0,))


@pytest.mark.parametrize(("low", "high"), [(-7.3, 4.1), (-0.01, 39.0), (0.0, 1.0)])
def test_depth_of_field_ends_where_the_curve_meets_the_tolerance(
    look: Look, low: float, high: float
) -> None:
    case = look("post")
    found = depth_of_field(
        case, lambda z: 1.0 if low <= z <= high else 2.0, 1.5, reach_um=50.0
    )
    # the last step is at most half the distance, and halved six times
    assert low <= found.lowest_um <= low + max(abs(low), 0.9) / 64
    assert high - max(high, 0.9) / 64 <= found.highest_um <= high
    assert found.depth_um == found.highest_um - found.lowest_um
    assert found.textbook_um == pytest.approx(3.40, abs=0.005)


def test_depth_of_field_is_nothing_or_all_of_the_reach(look: Look) -> None:
    case = look("post")
    none = depth_of_field(case, lambda z: 2.0, 1.0, reach_um=9.0)
    assert none == DepthOfField(
        lowest_um=0.0, highest_um=0.0, textbook_um=none.textbook_um
    )
    full = depth_of_field(case, lambda z: 1.0, 1.0, reach_um=9.0)
    assert (full.lowest_um, full.highest_um) == (-9.0, 9.0)
    assert depth_of_field(case, lambda z: math.inf, 1.0, reach_um=9.0).depth_um == 0
    for tolerance, reach_um in ((0.0, 1.0), (1.0, 0.0), (math.nan, 1.0)):
        with pytest.raises(ValueError, match="positive"):
            depth_of_field(case, lambda z: 1.0, tolerance, reach_um=reach_um)


def test_tasks_depth_of_field_is_not_the_textbooks(look: Look) -> None:
    window = Window(row=208, column=288, rows=64, columns=64)
    case = replace(look("post"), window=window)
    curve = limit_curve(case, "x", ("x", "gain"))
    tolerance = 1.5 * curve(0.0)
    found = depth_of_field(case, curve, tolerance, reach_um=40.0)
    # in focus nothing tells above from below
    assert found.highest_um == pytest.approx(-found.lowest_um)
    assert curve(found.highest_um) == pytest.approx(tolerance, rel=0.02)
    assert found.depth_um > 2 * found.textbook_um
