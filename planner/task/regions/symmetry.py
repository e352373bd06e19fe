"""Centroids of rings, and the order of their rotational symmetry."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray, Point
from microplan.optics.outline.outline import Arc, Edge, Ring
from microplan.planner.task.regions.rings import corners

NEAR = 2e-3  # of the radius: edges nearer than this meet when a ring is turned
_PLACES = 9  # decimals of a centroid, um: one at 0 is at 0
_SAMPLES = 1440  # points along a ring
_FEW = 60  # of them one is compared first: most turns meet nowhere
_MOST = 360  # orders that are tried
_ODD = (89, 97)  # turns that only what is round meets itself under


def centroid(rings: Sequence[Ring]) -> Point:
    """Return the centroid of the area that rings enclose, exact for arcs, um.

    Parameters
    ----------
    rings : sequence of Ring
        Outer ones in one direction, their holes in the other.

    Notes
    -----
    A sum over the polygon of the edges' ends and the segments between arcs and their
    chords: one of radius r and sweep s has the area r^2 (s - sin s) / 2, and its first
    moment about the arc's centre is 2 r^3 sin(s / 2)^3 / 3 along its middle.
    """
    origin = rings[0].edges[0].start  # near: less is lost to rounding
    parts = [_moments(edge, origin) for ring in rings for edge in ring.edges]
    area, x, y = (math.fsum(column) for column in zip(*parts, strict=True))
    return (
        round(origin[0] + x / area, _PLACES) + 0.0,
        round(origin[1] + y / area, _PLACES) + 0.0,
    )


def symmetry_order(ring: Ring) -> int:
    """Return the order of a ring's rotational symmetry; 1 is none, 0 is round.

    A turn by one n-th that leaves a closed curve as it is moves every point along it by
    one n-th of its length: points at equal lengths are compared in pairs, so that it
    does not matter of how many edges the ring is drawn.
    """
    points = corners(ring)
    x, y = centroid([ring])
    z = points[:, 0] - x + 1j * (points[:, 1] - y)
    z = np.append(z, z[0])
    ends = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(z)))])
    shares = np.arange(_SAMPLES) / _SAMPLES
    rays, near = _at(z, ends, shares), NEAR * float(np.abs(z).max())
    turn = 1 if ring.signed_area_um2 > 0 else -1

    def apart(n: int, step: int) -> bool:
        turned = rays[::step] * cmath.rect(1.0, turn * math.tau / n)
        moved = _at(z, ends, shares[::step] + 1 / n)
        return bool((np.abs(moved - turned) > near).any())

    def meets(n: int) -> bool:
        return not (apart(n, _FEW) or apart(n, 1))

    if all(meets(n) for n in _ODD):
        return 0
    return max((n for n in range(2, _MOST + 1) if meets(n)), default=1)


def _at(
    z: npt.NDArray[np.complex128], ends: FloatArray, share: FloatArray
) -> npt.NDArray[np.complex128]:
    """Return the points after shares of a curve's length, round and round."""
    found: npt.NDArray[np.complex128] = np.interp(share % 1.0 * ends[-1], ends, z)
    return found


def _moments(edge: Edge, origin: Point) -> tuple[float, float, float]:
    """Return area, um2, and its first moments, um3, swept from `origin`."""
    (x0, y0), (x1, y1) = (
        (x - origin[0], y - origin[1]) for x, y in (edge.start, edge.end)
    )
    area = (x0 * y1 - x1 * y0) / 2
    moments = (area * (x0 + x1) / 3, area * (y0 + y1) / 3)
    if not isinstance(edge, Arc):
        return (area, *moments)
    r, s = edge.radius_um, edge.sweep_rad
    bow, lift = r**2 / 2 * (s - math.sin(s)), 2 / 3 * r**3 * math.sin(s / 2) ** 3
    middle_rad = edge.start_rad + s / 2
    cx, cy = edge.center[0] - origin[0], edge.center[1] - origin[1]
    return (
        area + bow,
        moments[0] + bow * cx + lift * math.cos(middle_rad),
        moments[1] + bow * cy + lift * math.sin(middle_rad),
    )
