"""Fourier integrals of outlines in closed form, exact to rounding."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import j1

from microplan.arrays import ComplexArray, FloatArray
from microplan.optics.outline.clip import EdgeArrays

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)
# Half the phase, rad, that 32 nodes integrate to rounding, along a line or an arc of
# half a radian to each side (computed; the error is 4e-13 of the length at 30).
_PANEL_RAD, _PANEL_TURN_RAD = 24.0, 1.0
# Below this share of 1 / frequency the boundary sum cancels to 1e-12 and the Taylor
# series to second order errs by 40 times its cube, 3e-12 as well.
_NEAR_ZERO = 4e-5


def transform(
    edges: EdgeArrays, u_per_um: FloatArray, v_per_um: FloatArray
) -> ComplexArray:
    """Return the Fourier integral of an outline on a grid of frequencies.

    Parameters
    ----------
    u_per_um : (J,) float array
        Frequencies along x, cycles/um.
    v_per_um : (K,) float array
        Frequencies along y, cycles/um.

    Returns
    -------
    (K, J) complex array
        Integral of exp(-2 pi i (u x + v y)) over the outline, um2, within some 1e-12
        of its area.

    References
    ----------
    F = i / (2 pi r**2) times the sum over segments of (u dy - v dx) sinc(u dx + v dy)
    exp(-2 pi i (u cx + v cy)); r**2 = u**2 + v**2, (cx, cy) a segment's middle. Chu &
    Huang (1989), J. Opt. Soc. Am. A 6, 1653. A circle: R J1(2 pi R r) / r.
    """
    at = _middle(edges)
    u, v = u_per_um, v_per_um[:, None]
    r = np.hypot(u, v)
    arcs = edges.arcs - np.r_[at, 0, 0, 0]
    lines = edges.segments - np.r_[at, at]
    circles = np.abs(np.abs(arcs[:, 4]) - 2 * np.pi) < 1e-9
    total = _segments(lines, u, v) + _arcs(arcs[~circles], u, v, r)
    with np.errstate(divide="ignore", invalid="ignore"):
        total *= 1j / (2 * np.pi * r**2)
    near = r * _reach(lines, arcs) < _NEAR_ZERO
    total[near] = 0
    for cx, cy, radius, _, sweep in arcs[circles]:
        disc = _disc(radius, r) * math.copysign(1.0, sweep)
        total += np.where(near, 0, disc * np.exp(-2j * np.pi * (u * cx + v * cy)))
    if near.any():
        total[near] = _taylor(lines, arcs, u, v)[near]
    turned: ComplexArray = total * np.exp(-2j * np.pi * (u * at[0] + v * at[1]))
    return turned


def _segments(lines: FloatArray, u: FloatArray, v: FloatArray) -> ComplexArray:
    """Return the segments' boundary sum, (K, J) um per um."""
    total = np.zeros((v.size, u.size), dtype=np.complex128)
    for x0, y0, x1, y1 in lines:
        dx, dy, cx, cy = x1 - x0, y1 - y0, (x0 + x1) / 2, (y0 + y1) / 2
        real = (u * dy - v * dx) * np.sinc(u * dx + v * dy)
        total += real * np.exp(-2j * np.pi * v * cy) * np.exp(-2j * np.pi * u * cx)
    return total


def _arcs(
    arcs: FloatArray, u: FloatArray, v: FloatArray, r: FloatArray
) -> ComplexArray:
    """Return the same sum of arcs (M, 5), by Gauss panels."""
    x, y, dx, dy = _nodes(arcs, float(r.max(initial=0.0)))
    along_y = np.exp(-2j * np.pi * v * y)
    along_x = np.exp(-2j * np.pi * x[:, None] * u)
    total: ComplexArray = (along_y * dy) @ along_x * u - (along_y * dx) @ along_x * v
    return total


def _nodes(
    arcs: FloatArray, top_per_um: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return Gauss nodes on arcs and their vectors of length, (N,) each, um."""
    parts = [np.empty((4, 0))]
    for cx, cy, radius, start, sweep in arcs:
        half = np.pi * top_per_um * radius * abs(sweep)
        count = math.ceil(max(half / _PANEL_RAD, abs(sweep) / _PANEL_TURN_RAD))
        place = (np.arange(count)[:, None] + (1 + _NODES) / 2).ravel() / count
        weight = np.tile(_WEIGHTS, count) / (2 * count) * sweep * radius
        angle = start + place * sweep
        c, s = np.cos(angle), np.sin(angle)
        parts.append(
            np.stack([cx + radius * c, cy + radius * s, -weight * s, weight * c])
        )
    x, y, dx, dy = np.concatenate(parts, axis=1)
    return x, y, dx, dy


def _disc(radius: float, r: FloatArray) -> FloatArray:
    """Return the transform of a disc about the origin, um2."""
    q = 2 * np.pi * radius * np.maximum(r, 1e-300)
    disc: FloatArray = np.pi * radius**2 * 2 * j1(q) / q
    return disc


def _taylor(
    lines: FloatArray, arcs: FloatArray, u: FloatArray, v: FloatArray
) -> ComplexArray:
    """Return the series about frequency 0, to the second order."""
    t = (1 + _NODES) / 2
    dx, dy = (lines[:, [2]] - lines[:, [0]]), (lines[:, [3]] - lines[:, [1]])
    flat = [lines[:, [0]] + t * dx, lines[:, [1]] + t * dy]
    flat += [dx * _WEIGHTS / 2, dy * _WEIGHTS / 2]
    bent = _nodes(arcs, 0.0)
    x, y, dx, dy = (np.r_[a.ravel(), b] for a, b in zip(flat, bent, strict=True))
    area, mx, my = x @ dy, x**2 @ dy / 2, -(y**2) @ dx / 2
    xx, xy, yy = x**3 @ dy / 3, (x**2 * y) @ dy / 2, -(y**3) @ dx / 3
    second = u**2 * xx + 2 * u * v * xy + v**2 * yy
    series: ComplexArray = area - 2j * np.pi * (u * mx + v * my) - 2 * np.pi**2 * second
    return series


def _corners(edges: EdgeArrays) -> tuple[FloatArray, FloatArray]:
    """Return coordinates x and y that span the edges' box."""
    cx, cy, r = edges.arcs[:, 0], edges.arcs[:, 1], edges.arcs[:, 2]
    lines = edges.segments
    x = np.r_[lines[:, 0], lines[:, 2], cx - r, cx + r]
    y = np.r_[lines[:, 1], lines[:, 3], cy - r, cy + r]
    return x, y


def _middle(edges: EdgeArrays) -> FloatArray:
    """Return the middle of the edges' box, (2,) um; moments cancel least about it."""
    return np.array(
        [(c.min() + c.max()) / 2 if c.size else 0.0 for c in _corners(edges)]
    )


def _reach(lines: FloatArray, arcs: FloatArray) -> float:
    """Return how far the edges reach from the origin, um."""
    x, y = _corners(EdgeArrays(segments=lines, arcs=arcs))
    return float(np.hypot(x, y).max(initial=0.0))
