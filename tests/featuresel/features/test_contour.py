"""Drawn edges as points with normals."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from microplan.featuresel.features.contour import MOST, edge_points, with_contour
from microplan.featuresel.look.scenario import LookCase
from microplan.optics.outline.outline import Arc, Outline, Ring, Segment

Look = Callable[[str], LookCase]


def ring(*points: tuple[float, float]) -> Ring:
    ends = points[1:] + points[:1]
    return Ring(
        edges=tuple(Segment(start=a, end=b) for a, b in zip(points, ends, strict=True))
    )


def square(half_um: float) -> Outline:
    h = half_um
    return Outline(rings=(ring((-h, -h), (h, -h), (h, h), (-h, h)),))


def contour(case: LookCase) -> np.ndarray:
    return np.array(case.target.contour)


@pytest.mark.parametrize("name", ["find_gear", "bracket"])
def test_normals_leave_the_material_by_the_divergence_theorem(
    name: str, look: Look
) -> None:
    outline = look(name).moving[0].outline
    spacing = 0.05
    points = edge_points([outline], spacing_um=spacing)
    edges = [e for r in outline.rings for e in r.edges]
    lengths = np.concatenate(
        [
            np.full(n, e.length_um / n)
            for e in edges
            for n in [max(1, math.ceil(e.length_um / spacing - 1e-9))]
        ]
    )
    outflow = (points[:, 0] * points[:, 2] + points[:, 1] * points[:, 3]) @ lengths
    # exact on segments; an arc's midpoints lie on it
    assert outflow / 2 == pytest.approx(outline.area_um2, rel=1e-9)
    # the notched bore lacks a chord of 6 um of 25: 6 (spacing / 25)**2 / 24 = 1e-6
    np.testing.assert_allclose(points[:, 2:].T @ lengths, 0, atol=2e-6)
    np.testing.assert_allclose(np.hypot(points[:, 2], points[:, 3]), 1, rtol=1e-12)


def test_points_are_half_a_pixel_apart_and_never_too_many(look: Look) -> None:
    case = look("find_gear")
    points = contour(case)
    steps = np.hypot(*np.diff(points[:, :2], axis=0).T)
    assert np.percentile(steps, 95) <= 0.5 / case.target.px_per_um + 1e-9
    fine = replace(case.target, px_per_um=20.0)
    outlines = [layer.outline for layer in case.moving]
    assert len(with_contour(fine, outlines).contour) == MOST


def test_a_circle_is_its_own_points_without_notch_or_teeth(look: Look) -> None:
    points = contour(look("bore"))
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 25, rtol=0.02)
    inwards = points[:, 0] * points[:, 2] + points[:, 1] * points[:, 3]
    assert (inwards < 0).all()  # the material is around a bore


def test_fingers_without_end_are_cut_behind_their_tips(look: Look) -> None:
    points = contour(look("jaws"))
    reach = math.hypot(165, 60)
    assert np.hypot(points[:, 0], points[:, 1]).max() <= reach
    tips = points[np.isclose(points[:, 3], -1)]
    assert tips[:, 0].min() < -160
    assert tips[:, 0].max() > 160
    assert np.ptp(tips[:, 1]) == 0


def test_an_edge_a_pair_and_a_corner_take_their_own_edges(look: Look) -> None:
    target = look("post").target
    bar = Outline(rings=(ring((-5, -40), (5, -40), (5, 40), (-5, 40)),))
    pair = replace(target, kind="pair", parameters={"length_um": 60, "width_um": 10})
    points = np.array(with_contour(pair, [bar]).contour)
    np.testing.assert_allclose(np.abs(points[:, 0]), 5)
    assert (points[:, 0] * points[:, 2] > 0).all()
    assert np.abs(points[:, 1]).max() <= 31
    moved = Outline(rings=(ring((-10, -40), (0, -40), (0, 40), (-10, 40)),))
    edge = replace(target, kind="edge", parameters={"length_um": 60})
    points = np.array(with_contour(edge, [moved]).contour)
    np.testing.assert_allclose(points[:, [0, 2]], [[0, 1]] * len(points))
    # the right corner of a diamond: its bisector leads out along +x
    diamond = Outline(rings=(ring((0, 0), (-20, 20), (-40, 0), (-20, -20)),))
    corner = replace(
        target, kind="corner", parameters={"angle_rad": math.pi / 2, "reach_um": 15}
    )
    points = np.array(with_contour(corner, [diamond]).contour)
    assert np.hypot(points[:, 0], points[:, 1]).max() <= 15
    np.testing.assert_allclose(points[:, 2], math.sqrt(0.5))
    assert {-1.0, 1.0} == set(np.sign(points[:, 3]))


def test_spacing_must_be_positive_and_a_blank_drawing_has_no_points() -> None:
    with pytest.raises(ValueError, match="spacing_um"):
        edge_points([square(1)], spacing_um=0)
    assert edge_points([], spacing_um=1).shape == (0, 4)


def test_a_hole_run_clockwise_points_into_itself() -> None:
    arc = Arc(center=(3, 4), radius_um=2, start_rad=0, sweep_rad=-math.tau)
    points = edge_points([Outline(rings=(Ring(edges=(arc,)),))], spacing_um=0.1)
    away = points[:, :2] - [3, 4]
    np.testing.assert_allclose((away * points[:, 2:]).sum(axis=1), -2)
