"""Edge offsets by coherence: the table against direct calculations and images."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.optics.edge_table import COHERENCE as MADE_COHERENCE
from benchmarks.optics.edge_table import CONTRAST as MADE_CONTRAST
from benchmarks.optics.edge_table import WAVES as MADE_WAVES
from benchmarks.optics.edge_table import edge_row
from microplan.optics.coherence import edge_table
from microplan.optics.coherence.coherence import render_coherent
from microplan.optics.coherence.edge_offsets import (
    EDGE_WAVES,
    amplitude_contrast,
    coherence_error,
    edge_offset_um,
    ring_shifts_um,
)
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Window
from microplan.optics.transfer.microscope import Microscope
from tests.optics.shapes import circle, microscope, one_layer, polygon, rectangle

AIRY = 0.6 / 0.42  # wavelength / A of `microscope()`, um
# Wavelength / A, between the nodes of the table within one wave of defocus: measured by
# `benchmarks.optics.coherence` (coherence.max_edge_offset_error).
BETWEEN = 0.006


def _defocus_um(optics: Microscope, waves: float) -> float:
    return waves * optics.wavelength_um / optics.rim_w20_um(1.0)


def test_the_table_is_what_its_script_makes() -> None:
    assert edge_table.COHERENCE == MADE_COHERENCE
    assert edge_table.WAVES == MADE_WAVES
    assert edge_table.CONTRAST == MADE_CONTRAST
    for i, coherence in ((0, 0.0), (5, 0.5), (13, 1.1)):
        line = edge_table.EDGES[i * len(MADE_WAVES)]
        expected = edge_row((coherence, 0.0))
        # four decimals are kept
        np.testing.assert_allclose(line, expected, rtol=0, atol=0.51e-4)


@pytest.mark.parametrize(
    ("coherence", "offset", "error"),
    [(0.1, 0.106, 0.26), (0.5, 0.108, 0.25), (1.0, 0.094, 0.17)],
)
def test_full_contrast_edges_are_as_an_earlier_calculation_had_them(
    coherence: float, offset: float, error: float
) -> None:
    found = edge_offset_um(coherence, microscope(), 1.0) / AIRY
    assert found == pytest.approx(offset, abs=5.1e-4)  # of their digits
    assert coherence_error(coherence, microscope()) == pytest.approx(error, abs=5.1e-3)


def test_a_coherent_edge_moves_as_its_closed_form() -> None:
    # (1/2 + Si(2 pi x) / pi)**2 = 1/2 where Si(q) = pi (sqrt(1/2) - 1/2), q = .6669
    q = 0.0
    for _ in range(50):  # Si(q) = q - q**3/18 + q**5/600 - q**7/35280, 1e-8 off here
        q = math.pi * (math.sqrt(0.5) - 0.5) + q**3 / 18 - q**5 / 600 + q**7 / 35280
    found = edge_offset_um(1e-12, microscope(), 1.0) / AIRY
    assert found == pytest.approx(q / (2 * math.pi), abs=1e-4)  # four decimals


@pytest.mark.parametrize("setting", [(0.25, 0.0), (0.45, 0.125), (1.35, 0.0)])
def test_between_its_nodes_the_table_is_close(setting: tuple[float, float]) -> None:
    coherence, waves = setting
    optics = microscope()
    z_um = _defocus_um(optics, waves)
    contrasts = (0.4, 0.9)
    row = edge_row(setting, contrasts)
    for contrast, shift, error in zip(contrasts, row[:2], row[2:], strict=True):
        found = edge_offset_um(coherence, optics, contrast, z_um) / AIRY
        assert found == pytest.approx(shift * contrast, abs=BETWEEN)
        assert error <= coherence_error(coherence, optics, contrast, z_um)


@pytest.mark.parametrize(("coherence", "z_um"), [(0.3, 0.0), (0.8, 2.0)])
def test_an_image_shows_the_offset(coherence: float, z_um: float) -> None:
    optics = microscope(60.0, 120, 61)
    window = Window(row=30, column=40, rows=1, columns=40)
    image = render_coherent(
        one_layer(rectangle(0.0, -400.0, 400.0, 400.0), z_um),
        optics,
        focus_um=0.0,
        coherence=coherence,
        window=window,
        samples=12,
    )[0]
    at = int(np.flatnonzero(image >= 0.5)[0])
    part = (0.5 - image[at - 1]) / (image[at] - image[at - 1])
    seen_um = (40 + at - 1 + part - 59.5) * optics.um_per_px
    # source and tile move the level by .012 + .005 (test_coherence), the edge rises by
    # 1 per wavelength / A at least; chords of pixels of .09 wavelength / A err less
    assert seen_um == pytest.approx(
        edge_offset_um(coherence, optics, 1.0, z_um), abs=0.017 * AIRY
    )


def test_wide_condensers_leave_edges_where_they_are() -> None:
    optics = microscope()
    assert edge_offset_um(0.0, optics, 1.0) == 0
    assert coherence_error(0.0, optics) == 0
    at_4 = edge_offset_um(4.0, optics, 1.0)
    assert edge_offset_um(40.0, optics, 1.0) == pytest.approx(at_4 / 10)
    assert coherence_error(4.0, optics) == pytest.approx(0.086 / 4, rel=0.03)


def test_no_contrast_moves_nothing() -> None:
    assert edge_offset_um(0.5, microscope(), 0.0) == 0
    body = polygon([(0.0, 0.0), (40.0, 0.0), (0.0, 30.0)])
    (shift,) = ring_shifts_um(body, 0.5, microscope(), reflectance=0.3, background=0.3)
    assert shift == (0, 0)


def test_both_sides_of_focus_are_alike() -> None:
    near, far = (edge_offset_um(0.5, microscope(), 0.7, z) for z in (-3.0, 3.0))
    assert near == far > 0


def test_centroids_of_symmetric_rings_stay() -> None:
    rings = (circle(20.0, (3.0, 1.0)), circle(8.0, (3.0, 1.0), hole=True))
    for shift in ring_shifts_um(
        Outline(rings=rings), 0.5, microscope(), reflectance=1.0, background=0.0
    ):
        assert shift == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(
    ("reflectance", "background", "sign"), [(1.0, 0.0, -1), (0.04, 0.64, 1)]
)
def test_bright_bodies_shrink_and_dark_ones_grow(
    reflectance: float, background: float, sign: int
) -> None:
    optics, corners = microscope(), [(0.0, 0.0), (40.0, 0.0), (0.0, 30.0)]
    outer = polygon(corners)
    hole = Outline(rings=tuple(ring.reversed() for ring in outer.rings))
    edge_um = sign * edge_offset_um(
        0.5, optics, amplitude_contrast(reflectance, background)
    )
    # grown by d it stays similar about its incentre (10, 10), whose radius is 10:
    # all lengths times 1 + d / 10, so the centroid (40/3, 10) moves by d / 3 along x;
    # a hole in the body does the opposite
    for body, grown_um in ((outer, edge_um), (hole, -edge_um)):
        (shift,) = ring_shifts_um(
            body, 0.5, optics, reflectance=reflectance, background=background
        )
        assert shift == pytest.approx((grown_um / 3, 0.0), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("coherence", math.nan), ("coherence", -1.0), ("coherence", math.inf),
        ("contrast", math.nan), ("contrast", 1.1), ("contrast", -0.1),
        ("defocus_um", math.nan), ("defocus_um", 20.0),
    ],
)  # fmt: skip
def test_bad_numbers_are_refused(name: str, value: float) -> None:
    given = {"coherence": 0.5, "contrast": 0.5, "defocus_um": 0.0, name: value}
    for function in (edge_offset_um, coherence_error):
        with pytest.raises(ValueError, match=name):
            function(microscope=microscope(), **given)


def test_bad_reflectances_are_refused() -> None:
    for one, other in ((0.0, 0.0), (-0.1, 0.5), (math.nan, 0.5), (0.5, math.inf)):
        with pytest.raises(ValueError, match="reflectances"):
            amplitude_contrast(one, other)
    assert amplitude_contrast(0.25, 1.0) == amplitude_contrast(1.0, 0.25) == 0.5


def test_the_limit_of_defocus_itself_is_predicted() -> None:
    optics = microscope()
    z_um = _defocus_um(optics, EDGE_WAVES) * (1 - 1e-12)
    assert 0 < edge_offset_um(1e-9, optics, 1.0, z_um) < AIRY
    assert 0 < coherence_error(1e-9, optics, 1.0, z_um) < 1
