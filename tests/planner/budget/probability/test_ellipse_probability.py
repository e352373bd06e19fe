"""Chances beyond a circle against draws, mpmath and closed forms."""

from __future__ import annotations

import itertools
import math

import mpmath  # type: ignore[import-untyped]  # has no stubs
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom, ncx2

from microplan.planner.budget.probability.ellipse_probability import (
    PlaneNormal,
    beyond_circle,
    beyond_radii,
    within_circle,
)
from microplan.planner.budget.probability.miss_density import VaryingRadius
from microplan.planner.budget.probability.miss_probability import probability_beyond
from microplan.planner.budget.probability.servo_landing import Landing

SAMPLES = 1_000_000
# One run in a thousand fails by chance, whatever the number of cases.
CHANCE = 1e-3


def spread(
    narrow_um: float,
    wide_um: float,
    angle_rad: float = 0.0,
    middle_um: tuple[float, float] = (0.0, 0.0),
) -> PlaneNormal:
    """Return a law with its wide axis at an angle to x."""
    wide = PlaneNormal.along(wide_um, angle_rad)
    narrow = PlaneNormal.along(narrow_um, angle_rad + math.pi / 2)
    at = PlaneNormal(middle_um=middle_um, xx_um2=0.0, yy_um2=0.0)
    return wide.plus(narrow).plus(at)


CASES = [
    (narrow * size, size, angle, (off * math.cos(turn), off * math.sin(turn)))
    for (size, (off, turn)), (narrow, angle) in itertools.product(
        [(1.0, (0.0, 0.0)), (1.23, (1.5, 0.6)), (2.5, (0.8, 2.0)), (4.0, (5.0, -1.0)),
         (0.4, (2.9, 0.3)), (30.0, (2.0, 1.0))],
        [(0.0, 0.7), (1e-9, 0.0), (1e-3, 1.2), (0.01, 0.0), (0.1, -0.4), (0.3, 2.8),
         (0.7, 0.9), (1.0, 0.0), (1.0 - 1e-9, 1.0)],
    )
] + [(0.0, 0.0, 0.0, (2.0, 1.0)), (0.0, 0.0, 0.0, (2.0, 2.5))]  # fmt: skip


@pytest.fixture(scope="module")
def unit() -> np.ndarray:
    """Return unit normal draws, (SAMPLES, 2), the same for all cases."""
    return np.random.default_rng(20).normal(size=(SAMPLES, 2))


def test_there_are_enough_cases() -> None:
    assert len(CASES) >= 50


@pytest.mark.parametrize("case", CASES)
def test_chances_are_those_of_drawing(
    unit: np.ndarray, case: tuple[float, float, float, tuple[float, float]]
) -> None:
    narrow, wide, angle, middle = case
    found = beyond_circle(3.0, spread(narrow, wide, angle, middle))
    c, s = math.cos(angle), math.sin(angle)
    x = wide * unit[:, 0] * c - narrow * unit[:, 1] * s + middle[0]
    y = wide * unit[:, 0] * s + narrow * unit[:, 1] * c + middle[1]
    missed = int((x * x + y * y >= 9.0).sum())
    # 1 of 2 sides: the binomial law says which counts are too rare to be chance
    share = CHANCE / len(CASES) / 2
    assert binom.cdf(missed, SAMPLES, found) > share
    assert binom.sf(missed - 1, SAMPLES, found) > share


def exactly(
    radius: float, narrow: float, wide: float, middle: tuple[float, float]
) -> tuple[float, float]:
    """Return both chances by mpmath: the angle around the circle, then outwards.

    Another road: in polar coordinates about the circle's middle.
    """
    with mpmath.workdps(25):
        r, a, b = mpmath.mpf(radius), mpmath.mpf(wide), mpmath.mpf(narrow)
        p, q = mpmath.mpf(middle[0]), mpmath.mpf(middle[1])

        def ray(turn: mpmath.mpf) -> tuple[mpmath.mpf, mpmath.mpf]:
            """Return the density's integral beyond and within r along a ray."""
            c, s = mpmath.cos(turn), mpmath.sin(turn)
            square = (c / a) ** 2 + (s / b) ** 2
            mixed = c * p / a**2 + s * q / b**2
            rest = (p / a) ** 2 + (q / b) ** 2
            top, width = mixed / square, 1 / mpmath.sqrt(square)
            bottom = mpmath.exp(-(rest - mixed**2 / square) / 2)

            def beyond(start: mpmath.mpf) -> mpmath.mpf:
                u = (start - top) / width
                tail = mpmath.erfc(u / mpmath.sqrt(2)) * mpmath.sqrt(mpmath.pi / 2)
                return width**2 * mpmath.exp(-(u**2) / 2) + top * width * tail

            out = beyond(r)
            return bottom * out, bottom * (beyond(mpmath.mpf(0)) - out)

        cuts = mpmath.linspace(0, 2 * mpmath.pi, 17)
        norm = 2 * mpmath.pi * a * b
        out = mpmath.quad(lambda t: ray(t)[0], cuts) / norm
        inside = mpmath.quad(lambda t: ray(t)[1], cuts) / norm
        return float(out), float(inside)


TAILS = [
    (3.0, 0.05, 0.121, (0.0, 0.0)),  # 1e-133
    (3.0, 0.1, 0.1, (0.5, 0.0)),
    (3.0, 0.08, 0.12, (0.2, 0.1)),
    (3.0, 0.02, 0.3, (0.3, 0.05)),
    (3.0, 0.3, 0.9, (0.1, 1.5)),
    (3.0, 0.4, 1.0, (0.0, 8.0)),  # the chance of a hit is the small one
]


@pytest.mark.parametrize(
    ("radius_um", "narrow_um", "wide_um", "middle_um"),
    [
        pytest.param(*tail, marks=[pytest.mark.slow] if k in (1, 3, 4) else [])
        for k, tail in enumerate(TAILS)
    ],
)
def test_tails_keep_their_digits(
    radius_um: float, narrow_um: float, wide_um: float, middle_um: tuple[float, float]
) -> None:
    wanted = exactly(radius_um, narrow_um, wide_um, middle_um)
    at = spread(narrow_um, wide_um, 0.0, middle_um)
    # an exponent of 700 keeps 13 digits, Gauss nodes on exp(-80 u) a piece 8 or more
    assert beyond_circle(radius_um, at) == pytest.approx(wanted[0], rel=1e-8)
    assert within_circle(radius_um, at) == pytest.approx(wanted[1], rel=1e-8)


def test_a_tail_of_133_zeros() -> None:
    found = beyond_circle(3.0, spread(0.05, 0.121))
    assert 1e-136 < found < 1e-130
    assert found == pytest.approx(exactly(3.0, 0.05, 0.121, (0.0, 0.0))[0], rel=1e-8)


@pytest.mark.parametrize("sigma_um", [0.1, 0.3, 1.0, 10.0])
@pytest.mark.parametrize("off_um", [0.0, 0.01, 1.0, 2.9, 4.0])
def test_round_laws_are_rices(sigma_um: float, off_um: float) -> None:
    at = spread(sigma_um, sigma_um, 0.0, (off_um * 0.6, off_um * 0.8))
    found = beyond_circle(3.0, at)
    square = (off_um / sigma_um) ** 2
    # scipy's series for the non-central law: 1e-6 in its far tail
    wanted = ncx2.sf((3.0 / sigma_um) ** 2, 2, square) if off_um else math.exp(
        -((3.0 / sigma_um) ** 2) / 2
    )  # fmt: skip
    marcum = probability_beyond(
        VaryingRadius(radius_um=3.0, flat_um=0.0, reach_um=0.0),
        Landing(bias_um=off_um, sigma_um=0.0, within_um=0.0),
        sigma_um,
    )
    assert found == pytest.approx(float(wanted), rel=1e-6)
    assert found == pytest.approx(marcum, rel=1e-8)


def test_the_paper_pins_and_a_narrow_ellipse() -> None:
    # the line's erf, less what the width of .01 takes: 2 phi(3) .01**2 / 6 = 1.5e-7
    line = math.erf(3 / math.sqrt(2)) - 1.48e-7
    found = within_circle(3.0, spread(0.01, 1.0))
    assert found == pytest.approx(line, abs=1e-9)
    for radius, sigma in ((3.0, 1.23), (0.5, 0.20)):
        exact = radius / math.sqrt(-2 * math.log(0.05))
        assert exact == pytest.approx(sigma, abs=0.005)
        assert within_circle(radius, spread(exact, exact)) == pytest.approx(0.95)


def test_without_width_it_is_geometry() -> None:
    nothing = spread(0.0, 0.0, 0.0, (1.0, 2.0))
    assert beyond_circle(math.hypot(1, 2) * 1.001, nothing) == 0.0
    assert beyond_circle(math.hypot(1, 2) * 0.999, nothing) == 1.0
    assert beyond_circle(0.0, spread(1.0, 1.0)) == 1.0
    assert beyond_circle(-1.0, spread(1.0, 1.0)) == 1.0
    line = spread(0.0, 1.0)
    assert beyond_circle(3.0, line) == pytest.approx(math.erfc(3 / math.sqrt(2)))
    beside = spread(0.0, 1.0, 0.0, (0.0, 3.5))  # the line passes the circle
    assert beyond_circle(3.0, beside) == 1.0


@pytest.mark.parametrize("reach_um", [0.3, 0.6, 2.0])
@pytest.mark.parametrize("flat_um", [0.0, 0.2])
@pytest.mark.parametrize("sigmas_um", [(0.3, 0.3), (1.0, 1.0), (0.12, 0.12)])
def test_radii_that_vary_are_averaged(
    reach_um: float, flat_um: float, sigmas_um: tuple[float, float]
) -> None:
    """Round laws, where another module knows the answer."""
    at = spread(*sigmas_um, 0.0, (0.5, 0.2))
    found = beyond_radii(3.0, flat_um, reach_um, at)
    wanted = probability_beyond(
        VaryingRadius(radius_um=3.0, flat_um=flat_um, reach_um=reach_um),
        Landing(bias_um=math.hypot(0.5, 0.2), sigma_um=0.0, within_um=0.0),
        sigmas_um[0],
    )
    assert found == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize(
    "numbers",
    [(math.nan, 0.0, 1.0), (-1.0, 0.0, 1.0), (1.0, 1.1, 1.0), (math.inf, 0.0, 1.0)],
)
def test_what_is_no_covariance_is_refused(numbers: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match=r"um2|finite"):
        PlaneNormal(xx_um2=numbers[0], xy_um2=numbers[1], yy_um2=numbers[2])
    with pytest.raises(ValueError, match="finite"):
        beyond_circle(math.nan, spread(1.0, 1.0))


sigmas = st.sampled_from([0.0, 1e-300, 1e-12]) | st.floats(1e-6, 1e4)


@settings(max_examples=150, deadline=None)
@given(
    radius_um=st.floats(1e-6, 1e4), narrow_um=sigmas, wide_um=sigmas,
    angle_rad=st.floats(-4, 4), x_um=st.floats(-1e4, 1e4), y_um=st.floats(-1e4, 1e4),
)  # fmt: skip
def test_both_chances_make_one_and_turn_with_the_world(
    radius_um: float, narrow_um: float, wide_um: float, angle_rad: float,
    x_um: float, y_um: float,
) -> None:  # fmt: skip
    at = spread(narrow_um, wide_um, 0.0, (x_um, y_um))
    miss, hit = beyond_circle(radius_um, at), within_circle(radius_um, at)
    assert 0 <= miss <= 1
    assert miss + hit == pytest.approx(1.0, abs=1e-9)
    roomier = beyond_circle(1.5 * radius_um, at)
    assert roomier <= miss + 1e-9


@settings(max_examples=60, deadline=None)
@given(narrow=st.floats(0.01, 3), wide=st.floats(0.01, 3), angle=st.floats(-4, 4))
def test_chances_turn_with_the_world(narrow: float, wide: float, angle: float) -> None:
    c, s = math.cos(angle), math.sin(angle)
    plain = spread(narrow, wide, 0.0, (0.7, 0.4))
    turned = spread(narrow, wide, angle, (0.7 * c - 0.4 * s, 0.7 * s + 0.4 * c))
    # xx yy - xy**2 keeps 16 digits of the wide axis' square: (narrow / wide)**2 loses 5
    assert beyond_circle(3.0, turned) == pytest.approx(
        beyond_circle(3.0, plain), rel=1e-7
    )
