"""Rows of the lens' budget: levels, and predictions against what is measured."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.optics.lens.displacement import corner_um, displaced
from microplan.optics.lens.lens import LensErrors
from microplan.optics.lens.lens_budget import LEVELS, LensRow, predict
from microplan.optics.outline.outline import Outline
from tests.optics.shapes import disc, gear, microscope

OPTICS = microscope()
POINTS = [[30.0, 0.0], [-10.0, 40.0], [0.0, 0.0]]
EFFECTS = (
    "radial distortion",
    "lateral shift with focus",
    "scale with focus",
    "field curvature",
    "aperture by zoom",
    "light gradient, steepest edge",
    "edge offset, made against drawn",
)
KNOWN = LensErrors(
    distortion=-0.01,
    lateral_x=0.003,
    lateral_y=0.004,
    scale_per_um=1e-4,
    field_curvature_per_um=-1e-4,
    edge_offset_um=-0.05,
    gradient_x=0.1,
    apertures=((2.0, 0.3), (50.0, 0.45)),
)
UNKNOWN = LensErrors(
    distortion_sigma=0.01,
    lateral_sigma=0.004,
    scale_sigma_per_um=1e-4,
    field_curvature_sigma_per_um=1e-4,
    edge_offset_sigma_um=0.05,
    gradient_sigma=0.1,
)


def _rows(lens: LensErrors, **options: Any) -> dict[str, LensRow]:
    """Return the rows by effect."""
    rows = predict(lens, options.pop("optics", OPTICS), POINTS, **options)
    assert len({row.effect for row in rows}) == len(rows)
    return {row.effect: row for row in rows}


def test_a_lens_without_errors_is_off_everywhere() -> None:
    rows = _rows(LensErrors(), defocus_um=20.0, outline=gear())
    assert {row.level for row in rows.values()} == {"off"}
    numbers = [(r.known_nm, r.left_nm, r.sigma_nm) for r in rows.values()]
    assert set(numbers) == {(0.0, 0.0, 0.0)}


def test_the_effects_are_always_the_same() -> None:
    for lens in (LensErrors(), KNOWN, UNKNOWN):
        assert tuple(_rows(lens)) == EFFECTS
        whole = tuple(_rows(lens, outline=disc(5.0)))
        assert set(whole) - set(EFFECTS) == {
            "light gradient, threshold",
            "light gradient, centroid",
        }


def test_known_shifts_are_those_of_the_map() -> None:
    rows = _rows(KNOWN, defocus_um=10.0)
    alone: dict[str, dict[str, Any]] = {
        "radial distortion": {"distortion": -0.01},
        "lateral shift with focus": {"lateral_x": 0.003, "lateral_y": 0.004},
        "scale with focus": {"scale_per_um": 1e-4},
    }
    for effect, numbers in alone.items():
        lens = replace(LensErrors(), **numbers)
        moved = displaced(POINTS, lens, OPTICS, defocus_um=10.0) - POINTS
        largest = 1000 * np.hypot(*moved.T).max()
        assert rows[effect].known_nm == pytest.approx(largest, rel=1e-12)
    r2 = 10.0**2 + 40.0**2
    assert rows["field curvature"].known_nm == pytest.approx(1000 * 1e-4 * r2 / 2)
    assert rows["field curvature"].axis == "z"
    assert rows["edge offset, made against drawn"].known_nm == pytest.approx(50.0)


def test_a_modelled_effect_leaves_nothing_but_what_one_height_leaves() -> None:
    for row in _rows(KNOWN, defocus_um=10.0).values():
        assert row.level == "modelled" or row.effect == "aperture by zoom"
        assert row.left_nm == 0.0
    rows = _rows(KNOWN, outline=disc(10.0, (30.0, 0.0)))
    # edges from 20 to 40 um: half the range of r**2 / (2 R)
    assert rows["field curvature"].left_nm == pytest.approx(
        1000 * 1e-4 * (1600 - 400) / 4, rel=1e-12
    )


def test_the_unknown_is_charged_from_its_sigma() -> None:
    unknown = _rows(UNKNOWN, defocus_um=10.0, outline=gear())
    signed = LensErrors(
        distortion=0.01,
        lateral_x=0.004,
        scale_per_um=1e-4,
        field_curvature_per_um=1e-4,
        edge_offset_um=0.05,
        gradient_x=0.1,
    )
    # a gradient along y is steeper, as the field is lower than it is wide
    steep = replace(signed, gradient_x=0.0, gradient_y=0.1)
    known = _rows(steep, defocus_um=10.0, outline=gear())
    for effect, row in unknown.items():
        if effect == "aperture by zoom":
            continue
        assert row.level == "charged from sigma"
        assert (row.known_nm, row.left_nm) == (0.0, 0.0)
        assert row.sigma_nm == pytest.approx(known[effect].known_nm, rel=1e-9)


def test_the_scatter_of_drawn_lenses_is_the_sigma() -> None:
    rng, count = np.random.default_rng(11), 4000
    point, z = np.array([40.0, 20.0]), 6.0
    shifts = []
    for d, lx, s in rng.standard_normal((count, 3)):
        drawn = LensErrors(distortion=0.01 * d, lateral_x=0.004 * lx)
        drawn = replace(drawn, scale_per_um=1e-4 * s)
        shifts.append(displaced(point, drawn, OPTICS, defocus_um=z) - point)
    found = np.cov(np.array(shifts).T)
    rows = {r.effect: r for r in predict(UNKNOWN, OPTICS, [point], defocus_um=z)}
    radial = point / math.hypot(*point)
    expected = np.zeros((2, 2))
    for effect in ("radial distortion", "scale with focus"):
        expected += (rows[effect].sigma_nm / 1000) ** 2 * np.outer(radial, radial)
    expected[0, 0] += (rows["lateral shift with focus"].sigma_nm / 1000) ** 2
    # a variance of 4000 draws is known to sqrt(2 / 4000) = 2.2 %; four of that
    np.testing.assert_allclose(found, expected, rtol=0.09)


def test_the_aperture_is_compared_with_the_table() -> None:
    row = _rows(KNOWN)["aperture by zoom"]
    assert row.level == "not modelled"
    fitting = replace(OPTICS, aperture=KNOWN.aperture_at(6.9))
    assert _rows(KNOWN, optics=fitting)["aperture by zoom"].level == "modelled"
    with pytest.raises(ValueError, match="no aperture is known"):
        _rows(KNOWN, optics=microscope(60.0))


@given(st.floats(0, 1), st.floats(0, 6.3), st.floats(-100, 100))
def test_rows_are_numbers_and_levels(share: float, angle: float, z: float) -> None:
    r = share * corner_um(OPTICS)
    point = [[r * math.cos(angle), r * math.sin(angle)]]
    both = replace(KNOWN, distortion_sigma=0.01, gradient_sigma=0.02)
    for row in predict(both, OPTICS, point, defocus_um=z):
        assert row.level in LEVELS
        for number in (row.known_nm, row.left_nm, row.sigma_nm):
            assert math.isfinite(number)
            assert number >= 0
        assert row.left_nm <= row.known_nm


def test_what_cannot_be_predicted_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one point"):
        predict(KNOWN, OPTICS, np.empty((0, 2)))
    with pytest.raises(ValueError, match="must be finite"):
        predict(KNOWN, OPTICS, [[math.nan, 0.0]])
    with pytest.raises(ValueError, match="defocus_um must be finite"):
        predict(KNOWN, OPTICS, POINTS, defocus_um=math.nan)
    far = 10 * corner_um(OPTICS)
    with pytest.raises(ValueError, match="folds"):
        predict(KNOWN, OPTICS, [[far, 0.0]])
    hole = Outline(rings=tuple(ring.reversed() for ring in disc(1.0).rings))
    with pytest.raises(ValueError, match="no area"):
        predict(KNOWN, OPTICS, POINTS, outline=hole)
