"""Chances of a miss against two other roads: waves, and rays from the bias.

Neither shares a step with `microplan.planner.budget.probability.miss_probability`. The
waves multiply the characteristic functions of all errors; they need an unseen rest that
is not too small. The rays go out from the bias and meet the circle of the radius where
the servo's law is known in closed form; they know no unseen rest, which Gauss-Hermite
nodes add as a shift of the bias.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, special

from microplan.planner.budget.probability.miss_density import VaryingRadius
from microplan.planner.budget.probability.miss_probability import (
    NODES,
    blurred,
    certain_miss,
    probability_beyond,
)
from microplan.planner.budget.probability.servo_landing import Landing

ROUNDING = 1e-12  # of sums of about 1e4 terms of up to 1
LANDINGS = [(1.3, 1.5), (0.2, 1.5), (5.0, 2.0), (0.01, 0.02), (3.0, 3.0), (5.0, 20.0)]
BIASES = [0.0, 0.8, 3.0, 6.0]  # for a radius of 3: none, within, at the edge, beyond


def room(radius_um: float, tolerance_um: float = 0.0) -> VaryingRadius:
    """Return the law of a radius between two sizes of the same tolerance."""
    return VaryingRadius(radius_um=radius_um, flat_um=0.0, reach_um=2 * tolerance_um)


def landing(bias_um: float, sigma_um: float = 0.0, within_um: float = 0.0) -> Landing:
    return Landing(bias_um=bias_um, sigma_um=sigma_um, within_um=within_um)


def gauss(low: float, high: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights of a composite rule, 30 nodes a piece."""
    nodes, weights = np.polynomial.legendre.leggauss(30)
    cuts = np.linspace(low, high, max(2, count // 15))
    half = np.diff(cuts)[:, None] / 2
    found = (cuts[:-1, None] + half * (nodes + 1)).ravel()
    return found, (half * weights).ravel()


def by_waves(at: VaryingRadius, left: Landing, sigma_um: float) -> float:
    """Return the chance of a miss from characteristic functions.

    P(|e| < C) = C int J1(C k) Phi(k) dk, Phi = J0(b k) exp(-(s k)**2 / 2) times that of
    the cut-off normal law.
    """
    most = 9 / sigma_um  # exp(-9**2 / 2) = 3e-18
    span = at.radius_um + at.reach_um + left.bias_um + left.within_um
    k, dk = gauss(0.0, most, 60 + round(most * span))  # at least 2 nodes a radian
    phi = np.exp(-((sigma_um * k) ** 2) / 2) * special.j0(left.bias_um * k)
    if left.within_um > 0:
        r, dr = gauss(0.0, left.within_um, 300 + round(most * left.within_um))
        law = dr * r * np.exp(-((r / left.sigma_um) ** 2) / 2)
        phi *= np.concatenate(
            [special.j0(np.outer(part, r)) @ (law / law.sum())
             for part in np.array_split(k, 1 + len(k) * len(r) // 10**6)]
        )  # fmt: skip
    deviation, share = np.zeros(1), np.ones(1)
    if at.reach_um > 0:  # a triangle
        deviation, share = gauss(-at.reach_um, at.reach_um, 45)
        share = share * (at.reach_um - np.abs(deviation)) / at.reach_um**2
    radius = at.radius_um + deviation
    hits = radius * (special.j1(np.outer(radius, k)) @ (dk * phi))
    return 1 - float(share @ hits)


@pytest.mark.parametrize("tolerance_um", [0.0, 0.5])
@pytest.mark.parametrize("sigma_um", [0.05, 0.3, 1.0, 5.0])
def test_chances_are_those_of_waves(sigma_um: float, tolerance_um: float) -> None:
    for (sigma, within), bias in itertools.product(LANDINGS, BIASES):
        if within / sigma_um > 30:
            continue  # millions of Bessel functions each; rays go there
        at, left = room(3.0, tolerance_um), landing(bias, sigma, within)
        found = probability_beyond(at, left, sigma_um)
        assert found == pytest.approx(by_waves(at, left, sigma_um), abs=10 * ROUNDING)


def inside(left: Landing, radius_um: float) -> float:
    """Return P(|m| < radius) of the cut-off law."""
    radius = min(max(radius_um, 0.0), left.within_um)
    bottom = math.expm1(-((left.within_um / left.sigma_um) ** 2) / 2)
    return math.expm1(-((radius / left.sigma_um) ** 2) / 2) / bottom


def by_rays(radius_um: float, left: Landing) -> float:
    """Return the chance of a miss without unseen rest, from rays of |m| out of b."""
    b, most = left.bias_um, left.within_um

    def hit(angle: float) -> float:
        root = math.sqrt(max(radius_um**2 - (b * math.sin(angle)) ** 2, 0.0))
        ends = -b * math.cos(angle) + root, -b * math.cos(angle) - root
        return inside(left, ends[0]) - inside(left, ends[1])

    start = 0.0 if radius_um > b else math.pi - math.asin(radius_um / b)
    cosine = (radius_um**2 - most**2 - b**2) / (2 * most * b) if b > 0 else 2.0
    cuts = {start, math.pi}
    if abs(cosine) < 1:  # the ray leaves the circle where the law is cut off
        cuts.add(max(start, math.acos(cosine)))
    chance = sum(
        integrate.quad(hit, low, high, epsabs=1e-12, epsrel=1e-12, limit=400)[0]
        for low, high in itertools.pairwise(sorted(cuts))
    )
    return 1 - chance / math.pi


SMALL = [*LANDINGS[:4], (20.0, 20.0), (1e-6, 1e-6)]


@pytest.mark.parametrize(("sigma_um", "within_um"), SMALL)
@pytest.mark.parametrize("bias_um", [0.0, 1.0, 2.4, 3.0, 5.0])
def test_chances_are_those_of_rays(
    sigma_um: float, within_um: float, bias_um: float
) -> None:
    left = landing(bias_um, sigma_um, within_um)
    wanted = by_rays(3.0, left)
    # a residual of 1e-6 um about 3 um is placed to 4e-16 um: 4e-10 of its width
    atol = ROUNDING + 2 * np.spacing(3.0) / min(sigma_um, within_um)
    assert probability_beyond(room(3.0), left, 0.0) == pytest.approx(wanted, abs=atol)


@pytest.mark.parametrize(("sigma_um", "within_um"), LANDINGS[:3])
@pytest.mark.parametrize("bias_um", [0.4, 1.1, 3.0, 4.1])
@pytest.mark.parametrize("rest_um", [1e-9, 1e-3])
def test_a_small_rest_moves_the_bias(
    sigma_um: float, within_um: float, bias_um: float, rest_um: float
) -> None:
    left = landing(bias_um, sigma_um, within_um)
    found = probability_beyond(room(3.0), left, rest_um)
    nodes, weights = np.polynomial.hermite_e.hermegauss(5)
    weights = weights / weights.sum()
    wanted = 0.0
    for x, p in zip(nodes, weights, strict=True):
        for y, q in zip(nodes[2:], weights[2:] * [1, 2, 2], strict=True):
            bias = math.hypot(bias_um + rest_um * x, rest_um * y)
            wanted += p * q * by_rays(3.0, landing(bias, sigma_um, within_um))
    # five nodes miss derivatives from the tenth on: (rest / .2)**10 is nothing
    assert found == pytest.approx(wanted, abs=10 * ROUNDING)


@pytest.mark.parametrize("rest_um", [0.0, 1e-9, 1e-3])
@pytest.mark.parametrize("bias_um", [0.0, 1.0, 3.0, 5.0])
@pytest.mark.parametrize(("sigma_um", "within_um"), [(1.3, 1.5), (0.2, 0.5)])
def test_sizes_are_averaged(
    sigma_um: float, within_um: float, bias_um: float, rest_um: float
) -> None:
    left, reach = landing(bias_um, sigma_um, within_um), 1.0
    edges = [0.0, *(bias_um + s * within_um - 3.0 for s in (-1, 1))]
    cuts = sorted({-reach, reach, *(c for c in edges if abs(c) < reach)})
    wanted = sum(
        integrate.quad(
            lambda t: (reach - abs(t)) * by_rays(3.0 + t, left),
            low, high, epsabs=1e-10,
        )[0]
        for low, high in itertools.pairwise(cuts)
    )  # fmt: skip
    # A rest moves the radius by s**2 (1/2 on each axis along and across): the triangle
    # of reach 1 bends by at most 4 in all, and is 1 high: 4 s**2 / 2 + s**2 / (2 C)
    atol = 3e-10 + 3 * rest_um**2
    found = probability_beyond(room(3.0, reach / 2), left, rest_um)
    assert found == pytest.approx(wanted, abs=atol)


@pytest.mark.parametrize("bias_um", [0.5, 1.2, 3.0, 4.9])
def test_a_flat_residual_misses_outside_a_lens(bias_um: float) -> None:
    """A servo far coarser than its tolerance leaves things evenly over a disc."""
    c, r, b = 3.0, 2.0, bias_um
    if b + r <= c:
        overlap = math.pi * r**2
    else:
        at = (b**2 + r**2 - c**2) / (2 * b * r), (b**2 + c**2 - r**2) / (2 * b * c)
        kite = (-b + r + c) * (b + r - c) * (b - r + c) * (b + r + c)
        overlap = r**2 * math.acos(at[0]) + c**2 * math.acos(at[1])
        overlap -= math.sqrt(kite) / 2
    found = probability_beyond(room(c), landing(b, 1e9, r), 0.0)
    assert found == pytest.approx(1 - overlap / (math.pi * r**2), abs=ROUNDING)


@pytest.mark.parametrize(
    ("sigma_um", "rest_um"),
    [(0.1, 0.1), (0.05, 0.12), (0.13, 0.02), (0.01, 0.13), (0.12, 1e-4)],
)
def test_two_normal_laws_make_one_down_to_hundred_zeros(
    sigma_um: float, rest_um: float
) -> None:
    """Cut off at 30 sigmas, where what is cut is below the chance of a miss."""
    wanted = math.exp(-(3.0**2) / 2 / (sigma_um**2 + rest_um**2))
    left = landing(0.0, sigma_um, 30 * sigma_um)
    found = probability_beyond(room(3.0), left, rest_um)
    assert 0 < wanted < 1e-97
    # the exponent of 300 keeps 13 digits; Gauss nodes on exp(-40 u) a piece 9
    assert found == pytest.approx(wanted, rel=1e-8)


@pytest.mark.parametrize("bias_um", [0.0, 0.3, 0.9])
def test_tails_of_a_short_residual_keep_their_digits(bias_um: float) -> None:
    """Rice tails summed over a fine disc; 20 to 45 sigmas out."""
    left, sigma = landing(bias_um, 5.0, 0.5), 0.07
    r, dr = gauss(0.0, 0.5, 75)
    turn, dturn = gauss(0.0, math.pi, 75)
    offset = np.hypot(r[:, None] + bias_um * np.cos(turn), bias_um * np.sin(turn))
    # Marcum's function by its Neumann series: offset < radius
    a, c = offset / sigma, 3.0 / sigma
    series = sum((a / c) ** k * special.ive(k, a * c) for k in range(60))
    tail = np.exp(-((c - a) ** 2) / 2) * series
    wanted = (dr * r * np.exp(-((r / 5.0) ** 2) / 2)) @ tail @ dturn / math.pi
    wanted /= float(dr @ (r * np.exp(-((r / 5.0) ** 2) / 2)))
    found = probability_beyond(room(3.0), left, sigma)
    assert 0 < wanted < 1e-100
    assert found == pytest.approx(float(wanted), rel=1e-6)


lengths = st.floats(1e-3, 20.0)


@given(
    radius_um=lengths, tolerance_um=st.just(0.0) | st.floats(1e-4, 0.5),
    bias_um=st.floats(0, 20), sigma_um=lengths, within_um=lengths, rest_um=lengths,
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_the_weights_are_a_law(
    radius_um: float, tolerance_um: float, bias_um: float, sigma_um: float,
    within_um: float, rest_um: float,
) -> None:  # fmt: skip
    """What is always missed and the bump along w make 1 without being told to."""
    at, left = room(radius_um, tolerance_um), landing(bias_um, sigma_um, within_um)
    breaks = left.breaks_um() - radius_um
    _, weight = blurred(at, rest_um, breaks)
    assert weight.min() >= 0
    assert certain_miss(at, rest_um) + weight.sum() == pytest.approx(1.0, abs=1e-10)


@pytest.mark.parametrize(
    ("radius_um", "tolerance_um", "rest_um"),
    [(0.5, 0.5, 0.002), (3.7, 3.7, 0.01), (2.7, 3.0, 0.01), (0.01, 1.1, 0.01)],
)
def test_the_weights_are_a_law_where_radii_end_at_nothing(
    radius_um: float, tolerance_um: float, rest_um: float
) -> None:
    """Some pairs have no room at all: the law bends within a sigma of no error."""
    at = room(radius_um, tolerance_um)
    _, weight = blurred(at, rest_um, np.zeros(0))
    assert certain_miss(at, rest_um) + weight.sum() == pytest.approx(1.0, abs=1e-9)


@given(scale=st.integers(-60, 60), bias_um=st.floats(0, 6), rest_um=st.floats(0, 2))
@settings(max_examples=40, deadline=None)
def test_chances_know_no_unit(scale: int, bias_um: float, rest_um: float) -> None:
    k = 2.0**scale
    small = probability_beyond(
        VaryingRadius(radius_um=3 * k, flat_um=0.1 * k, reach_um=0.5 * k),
        landing(bias_um * k, 1.3 * k, 1.5 * k),
        rest_um * k,
    )
    plain = VaryingRadius(radius_um=3.0, flat_um=0.1, reach_um=0.5)
    found = probability_beyond(plain, landing(bias_um, 1.3, 1.5), rest_um)
    assert small == pytest.approx(found, abs=ROUNDING)


@pytest.mark.parametrize(("flat_um", "reach_um"), [(0.0, 0.6), (0.2, 0.4), (0.3, 0.3)])
def test_the_radius_spreads_as_two_uniform_laws(
    flat_um: float, reach_um: float
) -> None:
    at = VaryingRadius(radius_um=3.0, flat_um=flat_um, reach_um=reach_um)
    deviation, width = gauss(-reach_um, reach_um, 6000)
    weight = width * at.density(deviation)
    sides = (reach_um + flat_um) / 2, (reach_um - flat_um) / 2
    # the bend of a density within one of 400 pieces of 1.5e-3 of the reach
    assert weight.sum() == pytest.approx(1.0, abs=1e-5)
    assert weight @ deviation == pytest.approx(0.0, abs=1e-12)
    variance = weight @ deviation**2
    assert variance == pytest.approx((sides[0] ** 2 + sides[1] ** 2) / 3, rel=1e-5)


@pytest.mark.parametrize("sigma_um", [1e-12, 1e-6, 1e-3, 0.1, 1.0, 1e3])
def test_one_chance_costs_no_more_where_lengths_differ(sigma_um: float) -> None:
    """What it costs is nodes: no more than of 128 pieces for any ratio of lengths."""
    left = landing(0.4, 1.3, 1.5)
    offset, _ = blurred(room(3.0, 0.5), sigma_um, left.breaks_um() - 3.0)
    assert 100 < offset.size <= 128 * NODES
