"""Curves under affine maps, and how near their arcs are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.optics.outline.outline import Arc, Edge
from microplan.planner.drawings.affine import Affine
from microplan.planner.drawings.biarcs import CURVE_PART, CURVE_UM, TooManyError
from microplan.planner.drawings.dxf.curves import EllipticArc, spline

PARTS = st.floats(-3, 3)
MAPS = st.builds(
    Affine,
    st.builds(complex, PARTS, PARTS),
    st.builds(complex, PARTS, PARTS),
    st.builds(complex, PARTS, PARTS),
)


def as_matrix(map_: Affine) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return the 3 x 3 matrix of a map, from where it puts three points."""
    zero, one, i = (map_.point(z) for z in (0j, 1 + 0j, 1j))
    columns = [one - zero, i - zero, zero]
    return np.array(
        [[z.real for z in columns], [z.imag for z in columns], [0.0, 0.0, 1.0]]
    )


@settings(deadline=None)
@given(first=MAPS, second=MAPS)
def test_maps_compose_as_matrices_do(first: Affine, second: Affine) -> None:
    product = as_matrix(second) @ as_matrix(first)
    # at most 6 of each factor, three products each: rounding far below 1e-12
    np.testing.assert_allclose(as_matrix(second.of(first)), product, atol=1e-12)


@settings(max_examples=25, deadline=None)
@given(
    major=st.floats(1, 1000), ratio=st.floats(0.01, 1), turn=st.floats(0, 6),
    sweep=st.floats(0.1, math.tau),
)  # fmt: skip
def test_arcs_are_near_their_ellipse(
    major: float, ratio: float, turn: float, sweep: float
) -> None:
    way = complex(math.cos(turn), math.sin(turn))
    u, v = major * way, 1j * major * ratio * way
    edges = EllipticArc(2 + 3j, u, v, 0.5, sweep).edges(100_000)
    points = np.array([complex(*edge.start) for edge in edges])
    middles = np.array(
        [complex(*edge.at(f)) for edge in edges if isinstance(edge, Arc)
         for f in (0.25, 0.5, 0.75)]
    )  # fmt: skip
    local = (np.concatenate([points, middles]) - (2 + 3j)) / way
    x, y = local.real / major, local.imag / (major * ratio)
    slope = 2 * np.hypot(x / major, y / (major * ratio))
    off = np.abs(x**2 + y**2 - 1) / slope  # the distance, to first order
    within = min(CURVE_UM, CURVE_PART * 2 * major * (1 + ratio))
    assert off.max() <= 1.5 * within  # seven probes a span may miss the worst place
    ends = pairwise(edges)
    assert max((math.dist(a.end, b.start) for a, b in ends), default=0) < 1e-9 * major


def cox_de_boor(
    degree: int, knots: Sequence[float], points: Sequence[complex],
    weights: Sequence[float], at: float,
) -> complex:  # fmt: skip
    """Return a point of a rational B-spline from its basis functions' definition."""

    def basis(i: int, p: int) -> float:
        if p == 0:
            return float(knots[i] <= at < knots[i + 1])
        total = 0.0
        if knots[i + p] > knots[i]:
            total += (at - knots[i]) / (knots[i + p] - knots[i]) * basis(i, p - 1)
        if knots[i + p + 1] > knots[i + 1]:
            rest = (knots[i + p + 1] - at) / (knots[i + p + 1] - knots[i + 1])
            total += rest * basis(i + 1, p - 1)
        return total

    shares = [basis(i, degree) * w for i, w in enumerate(weights)]
    return sum(s * z for s, z in zip(shares, points, strict=True)) / sum(shares)


def distance(edges: Sequence[Edge], z: complex) -> float:
    """Return how far a point is from a chain of edges."""
    best = math.inf
    for edge in edges:
        if isinstance(edge, Arc):
            local = z - complex(*edge.center)
            turn = math.atan2(local.imag, local.real) - edge.start_rad
            turn = turn * math.copysign(1, edge.sweep_rad) % math.tau
            if turn <= abs(edge.sweep_rad):
                best = min(best, abs(abs(local) - edge.radius_um))
        best = min(best, abs(z - complex(*edge.start)), abs(z - complex(*edge.end)))
    return best


@pytest.mark.parametrize("degree", [2, 3, 5])
@pytest.mark.parametrize("clamped", [True, False])
def test_arcs_are_near_their_spline(degree: int, clamped: bool) -> None:
    rng = np.random.default_rng(degree)
    angles = np.sort(rng.uniform(0, 5, 8))
    points = [50 * complex(math.cos(a), math.sin(a)) for a in angles.tolist()]
    weights = rng.uniform(0.5, 2, 8).tolist()
    inner = np.cumsum(rng.uniform(0.5, 2, 9 - degree)).tolist()
    if clamped:
        knots = [inner[0]] * degree + inner + [inner[-1]] * degree
    else:
        knots = np.cumsum(rng.uniform(0.5, 2, 8 + degree + 1)).tolist()
    controls = list(zip(points, weights, strict=True))
    edges = spline(degree, knots, controls).edges(10_000)
    low, high = knots[degree], knots[8]
    for at in np.linspace(low, high, 60, endpoint=False).tolist():
        z = cox_de_boor(degree, knots, points, weights, at)
        assert distance(edges, z) <= 1.5 * CURVE_UM


def test_the_number_of_arcs_is_bounded() -> None:
    with pytest.raises(TooManyError):
        EllipticArc(0j, 50 + 0j, 20j, 0.0, math.tau).edges(20)
