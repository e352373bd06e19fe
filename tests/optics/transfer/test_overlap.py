"""The single integral of the exact phase against two-dimensional quadrature."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import j0

from microplan.arrays import FloatArray
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.otf import diffraction, exact, hopkins
from microplan.optics.transfer.overlap import HighAperture, Overlap, Paraxial, overlap
from tests.optics.transfer.exact_phase import exact_otf

ENTRIES = json.loads((Path(__file__).parents[1] / "optics_vectors.json").read_text())[
    "entries"
]
X: FloatArray = np.array(
    [0, 1e-12, 1e-6, 1e-3, 0.03, 0.1, 0.3, 0.5, 0.8, 0.97, 0.999, 1 - 1e-9, 1]
)


def _optics(aperture: float, index: float = 1.0) -> Microscope:
    return Microscope(
        aperture=aperture,
        wavelength_um=0.6,
        medium_index=index,
        magnification=10,
        pitch_um=7.5,
        width_px=1,
        height_px=1,
    )


def _exact(x: FloatArray, optics: Microscope, z_um: float) -> FloatArray:
    return exact(
        x,
        z_um=z_um,
        aperture=optics.aperture,
        wavelength_um=optics.wavelength_um,
        index=optics.medium_index,
    )


@pytest.mark.parametrize(
    "entry", [e for e in ENTRIES if e["name"] == "otf_defocus_high_na"]
)
def test_the_exact_phase_meets_the_vectors(entry: dict[str, dict[str, str]]) -> None:
    at = {key: float(value) for key, value in entry["params"].items()}
    found = exact(
        np.array([at["x"]]),
        z_um=at["Delta_um"],
        aperture=at["A"],
        wavelength_um=at["lambda_um"],
        index=at["n"],
    )
    np.testing.assert_allclose(found, float(str(entry["value"])), rtol=0, atol=1e-12)


@pytest.mark.parametrize("aperture", [1e-3, 0.1, 0.42, 0.8, 0.95])
@pytest.mark.parametrize("waves", [0.0, 0.3, 3.0, 12.0])
def test_one_integral_is_the_double_integral(aperture: float, waves: float) -> None:
    optics = _optics(aperture)
    z_um = waves * optics.wavelength_um / optics.rim_w20_um(1.0)
    found = _exact(X, optics, z_um)
    # the double integral's nodes grow with z A**2; near A = n its integrand is steep
    np.testing.assert_allclose(found, exact_otf(X, optics, z_um), rtol=0, atol=2e-12)


@pytest.mark.parametrize("index", [1.0, 1.33, 1.5])
@pytest.mark.parametrize("share", [1e-3, 0.3, 0.95, 0.999])
def test_in_focus_the_overlap_is_the_area_common_to_two_discs(
    index: float, share: float
) -> None:
    found = exact(X, z_um=0.0, aperture=share * index, wavelength_um=0.6, index=index)
    np.testing.assert_allclose(found, diffraction(X), rtol=0, atol=1e-13)


def test_for_a_small_aperture_the_exact_phase_is_hopkins() -> None:
    optics = _optics(1e-3)
    z_um = 5 * optics.wavelength_um / optics.rim_w20_um(1.0)
    # the next term of the phase is A**2 / 4 of it: 2 pi 5 1e-6 / 4
    np.testing.assert_allclose(_exact(X, optics, z_um), hopkins(X, 5.0), atol=1e-5)


def _finely(law: Overlap, s: float, phase: float) -> float:
    """Return the overlap by as many equal panels as it takes."""
    at = np.array([[s]])
    top = float(law.top(at)[0, 0])
    nodes, weights = np.polynomial.legendre.leggauss(40)
    count = int(20 + phase * top / 4 + 40 * top / min(law.scale, 10 * top))
    v = ((np.arange(count)[:, None] + (1 + nodes) / 2) / count).ravel()
    weight = np.tile(weights / (2 * count), count)
    fall = np.real(law.rise(at, np.array([[top]]), -top * v**2))
    half = np.sqrt(np.maximum(-fall * (2 + fall), 0))
    t = top * (1 - v**2)
    density = np.real(law.density(at, t, half))
    return float(8 / np.pi * top * (density * v * np.cos(phase * t) * weight).sum())


@settings(max_examples=80, deadline=None)
@given(
    st.one_of(st.none(), st.floats(1e-3, 0.999)),
    st.floats(1e-6, 1 - 1e-6),
    st.floats(0, 3000),
)
def test_rules_and_steepest_descent_meet_fine_panels(
    aperture: float | None, s: float, turned_rad: float
) -> None:
    law = Paraxial() if aperture is None else HighAperture(aperture=aperture, index=1.0)
    phase = turned_rad / float(law.top(np.array([[s]]))[0, 0])
    found = overlap(law, np.array([s]), np.array([phase]))[0]
    # rounding of a phase of 3000 rad is 4e-13
    assert found == pytest.approx(_finely(law, s, phase), rel=0, abs=1e-12)


@pytest.mark.parametrize("aperture", [None, 0.05, 0.42, 0.95, 0.999])
@pytest.mark.parametrize("steep_rad", [60.5, 90.0, 400.0])
def test_steepest_descent_is_right_from_where_it_begins(
    aperture: float | None, steep_rad: float
) -> None:
    """Rounding leaves 1e-14 of panels whose phases are hundreds of radians."""
    law = Paraxial() if aperture is None else HighAperture(aperture=aperture, index=1.0)
    for s in (1e-3, 0.1, 0.5, 0.9, 0.999):
        top = float(law.top(np.array([[s]]))[0, 0])
        phase = steep_rad / min(top, law.scale)
        found = overlap(law, np.array([s]), np.array([phase]))[0]
        assert found == pytest.approx(_finely(law, s, phase), rel=0, abs=3e-14)


@pytest.mark.parametrize("z_um", [1e3, 1e4, 1e5, 1e6])
@pytest.mark.parametrize("aperture", [0.1, 0.42, 0.95])
def test_far_out_of_focus_light_goes_where_rays_go(
    aperture: float, z_um: float
) -> None:
    # the rays' spot, averaged over the pupil: J0 of 2 pi f z tan(angle)
    optics = _optics(aperture)
    blur_um = optics.blur_diameter_um(z_um)
    f = np.array([0.2, 0.5, 1.0, 2.0, 4.0]) / blur_um  # where the transfer is large
    x = f / optics.cutoff_per_um
    nodes, weights = np.polynomial.legendre.leggauss(400)
    u = (1 + nodes) / 2  # rho**2, spaced evenly over the pupil's area
    slope = aperture * np.sqrt(u) / np.sqrt(1 - aperture**2 * u)
    rays = (j0(2 * np.pi * f[:, None] * z_um * slope) * weights / 2).sum(axis=1)
    # diffraction takes (4 / pi) x off and moves the phase by a share x
    np.testing.assert_allclose(_exact(x, optics, z_um), rays, rtol=0, atol=8 * x.max())


@settings(max_examples=60, deadline=None)
@given(st.floats(0, 10), st.floats(-1e6, 1e6), st.floats(1e-3, 0.999))
def test_the_exact_transfer_is_even_and_at_most_one(
    x: float, z_um: float, aperture: float
) -> None:
    optics = _optics(aperture)
    value = _exact(np.array([x]), optics, z_um)
    assert abs(value[0]) <= 1 + 1e-13
    np.testing.assert_allclose(
        _exact(np.array([-x]), optics, -z_um), value, rtol=0, atol=0
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("aperture", 0.0), ("aperture", 1.0), ("aperture", math.nan),
        ("wavelength_um", 0.0), ("z_um", math.nan), ("z_um", math.inf),
    ],
)  # fmt: skip
def test_what_no_lens_can_have_is_refused(name: str, value: float) -> None:
    numbers = {"z_um": 1.0, "aperture": 0.42, "wavelength_um": 0.6} | {name: value}
    with pytest.raises(ValueError, match=r"aperture|finite"):
        exact(np.array([0.5]), **numbers)
