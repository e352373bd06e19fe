"""Probability that an error in the plane ends inside polygons.

With Q(r) = P(|e| >= r) of an error about the origin that is alike in all directions,
the probability inside a polygon is its winding number about the origin less the sum
over its edges of the integral of Q dphi / 2 pi, phi being the angle from the origin:
the divergence theorem for the field (1 - Q) / (2 pi r) along the radius. Where Q is
near 1 its complement is integrated instead, as (1 - Q) / r**2 is smooth there; so small
probabilities keep their digits, of a hit as of a miss.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.assembly.fits.peg_in_hole import PolygonEdges
from microplan.planner.budget.probability.ellipse_probability import PlaneNormal
from microplan.planner.budget.probability.fit_probability import Residual
from microplan.planner.budget.probability.quadrature import gauss
from microplan.planner.budget.probability.radial_law import RadialLaw, radial_law

PANEL_SCALES = 1.5  # length of a piece of an edge
# Gauss nodes of a piece, by its length over the scale on which the error changes.
SHORT, FEW, MANY = 0.3, 2, 5
# Scales of the law: an edge through its middle, or nearly so, is taken as so far off;
# where the middle is along it is rounded to 1e-16.
TOUCH_SCALES = 1e-8
ON_EDGE = 1e-6  # turns by which a sum of angles differs from a whole one
# Narrow principal sigmas below this share of the wide one are taken as that: the mass
# then differs by what lies within so much of the boundary.
LEAST_RATIO = 1e-3
LEAST_UM = 1e-9  # a smaller sigma is taken as that
# Steps along the wide axis: in scales of the law, of which the least is a share of its
# reach; and how many sigmas of the axis count, 1e-12.
STEP_SCALES, LEAST_STEP, WIDE_SIGMAS = 1.2, 0.03, 7.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaneError:
    """A residual cut off at a circle, plus a normal rest about a middle."""

    residual: Residual
    rest: PlaneNormal


def masses(
    edges: PolygonEdges, error: PlaneError, shifts_um: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the probabilities inside and outside each polygon.

    Parameters
    ----------
    edges : PolygonEdges
        Of N polygons.
    error : PlaneError
        Law of the error.
    shifts_um : (N, 2) float array
        What is added to the error's middle for each polygon.

    Returns
    -------
    two (N,) float arrays
        [1], in 0..1; small values of either keep their digits.
    """
    if not len(edges.owner):
        return np.zeros(edges.count), np.ones(edges.count)
    middle = (shifts_um + np.array(error.rest.middle_um))[edges.owner]
    starts, ends = edges.starts_um - middle, edges.ends_um - middle
    law, basis, moves, weights = _isotropic(error, starts)
    starts, ends = starts @ basis.T, ends @ basis.T
    hit, miss = np.zeros(edges.count), np.zeros(edges.count)
    for move, weight in zip(moves, weights, strict=True):
        angle, tail = _tails(starts - move, ends - move, law)
        turns = np.bincount(edges.owner, angle, edges.count)
        whole = np.round(turns)  # but where the middle is on an edge
        winding = np.where(np.abs(turns - whole) < ON_EDGE, whole, turns)
        beyond = np.bincount(edges.owner, tail, edges.count)
        hit += weight * np.clip(winding - beyond, 0, 1)
        miss += weight * np.clip((1 - winding) + beyond, 0, 1)
    # where no shift brings a polygon near, nothing is hit
    return hit, np.clip(miss + (1 - weights.sum()), 0, 1)


def _isotropic(
    error: PlaneError, reached_um: FloatArray
) -> tuple[RadialLaw, FloatArray, FloatArray, FloatArray]:
    """Return a radial law, a basis in which it holds, moves (N, 2) and weights (N,).

    A normal error is stretched until it is round. Beside a residual that is cut off,
    what the wide axis has more is averaged over; `reached_um`, (N, 2), are the corners
    of the polygons.
    """
    residual, rest = error.residual, error.rest
    narrow, wide, angle = rest.principal
    c, s = math.cos(angle), math.sin(angle)
    free = math.isinf(residual.within_um)
    if residual.sigma_um <= 0 or residual.within_um <= 0 or free:
        left = residual.sigma_um if free else 0.0
        narrow, wide = math.hypot(narrow, left), math.hypot(wide, left)
        wide = max(wide, LEAST_UM)
        narrow = max(narrow, LEAST_RATIO * wide)
        basis = np.array([[c / wide, s / wide], [-s / narrow, c / narrow]])
        return radial_law(_NONE, 1.0), basis, np.zeros((1, 2)), np.ones(1)
    law = radial_law(residual, narrow)
    extra = math.sqrt(max((wide - narrow) * (wide + narrow), 0.0))
    if extra <= LEAST_RATIO * law.scale_um:
        return law, np.eye(2), np.zeros((1, 2)), np.ones(1)
    way = np.array([c, s])
    steps, weights = _along(extra, law, (reached_um @ way).tolist())
    return law, np.eye(2), steps[:, None] * way, weights


def _along(
    extra_um: float, law: RadialLaw, reached_um: list[float]
) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights, (N,), of a normal shift that may bring polygons near.

    The rule of equal steps: for a normal factor, blurred by the law, it errs by
    exp(-2 pi**2 / step**2) in sigmas of the narrower one.
    """
    step = min(extra_um, STEP_SCALES * max(law.scale_um, law.reach_um * LEAST_STEP))
    most = WIDE_SIGMAS * extra_um
    low = max(min(reached_um) - law.reach_um, -most)
    high = min(max(reached_um) + law.reach_um, most)
    first, last = math.floor(low / step), math.ceil(high / step)
    nodes = step * np.arange(first, max(last, first) + 1)
    weights = np.exp(-((nodes / extra_um) ** 2) / 2) / math.sqrt(math.tau)
    return np.asarray(nodes, dtype=np.float64), weights * step / extra_um


_NONE = Residual(sigma_um=0.0, within_um=0.0)


def _tails(
    starts: FloatArray, ends: FloatArray, law: RadialLaw
) -> tuple[FloatArray, FloatArray]:
    """Return the angle of each edge from the origin, in turns, and its part of Q."""
    step = ends - starts
    length = np.hypot(*step.T)
    along = step / np.maximum(length, 1e-300)[:, None]
    off = starts[:, 0] * along[:, 1] - starts[:, 1] * along[:, 0]
    touch = TOUCH_SCALES * law.scale_um
    off = np.where(np.abs(off) < touch, touch, off)  # on one side for all below
    low = (starts * along).sum(axis=1)
    turns = np.arctan2(off * length, (starts * ends).sum(axis=1)) / math.tau
    half = np.sqrt(np.maximum((law.reach_um - off) * (law.reach_um + off), 0.0))
    first, last = np.clip(low, -half, half), np.clip(low + length, -half, half)
    tail = np.zeros(len(starts))
    near = np.flatnonzero(last > first)
    if len(near):
        tail[near] = _within_reach(off[near], first[near], last[near], law)
    return turns, tail


def _within_reach(
    off: FloatArray, first: FloatArray, last: FloatArray, law: RadialLaw
) -> FloatArray:
    """Return the integral of Q dphi / 2 pi along lines at a distance `off`, (N,)."""
    count = np.ceil((last - first) / (PANEL_SCALES * law.scale_um)).astype(np.intp)
    which = np.repeat(np.arange(len(off)), count)
    index = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    width = ((last - first) / count)[which]
    start, h = first[which] + index * width, off[which]
    part = np.empty(len(which))
    short = width < SHORT * law.scale_um
    for chosen, nodes in ((short, FEW), (~short, MANY)):
        part[chosen] = _pieces(h[chosen], start[chosen], width[chosen], law, nodes)
    return np.asarray(np.bincount(which, part, len(off)), dtype=np.float64)


def _pieces(
    h: FloatArray, start: FloatArray, width: FloatArray, law: RadialLaw, count: int
) -> FloatArray:
    """Return the integral along pieces of lines at a distance `h`, (N,)."""
    nodes, weights = gauss(count)
    t = start[:, None] + width[:, None] * (nodes + 1) / 2
    square = h[:, None] ** 2 + t * t
    radius = np.sqrt(square)
    weight = (width * h)[:, None] * weights / 2 / math.tau
    close = radius.min(axis=1) < law.scale_um
    part = np.empty(len(h))
    far = ~close
    part[far] = (weight[far] * law.tail(radius[far]) / square[far]).sum(axis=1)
    inner = (weight[close] * law.density(radius[close])).sum(axis=1)
    end = start + width
    angle = np.arctan2(h * width, h * h + start * end)
    part[close] = angle[close] / math.tau - inner
    return part
