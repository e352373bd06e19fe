"""The loop over straight rays past one body: how near each comes to its wall.

Compiled: most rays need two distances, those close to a wall many.
"""

from __future__ import annotations

import numpy as np

from microplan.arrays import Float32Array
from microplan.compiled import compiled

_CLEAR = 1.0  # widths: a ray that far off is not hidden at all


@compiled
def least_distances(
    distances: Float32Array,
    start: tuple[Float32Array, Float32Array],
    slope: tuple[Float32Array, Float32Array],
    slopes: Float32Array,
    heights_um: Float32Array,
    widths_um: Float32Array,
    is_sharp: bool,  # noqa: FBT001 - compiled functions have no keywords
    away_um: Float32Array,
    least: Float32Array,
) -> None:
    """Find the least distance of rays from an outline, over the ray's width there.

    Parameters
    ----------
    distances : (rows, columns) float32 array
        Grid of distances, um.
    start : two (points, 1) or (points, slopes) float32 arrays
        Columns and rows at which rays start, half a step on.
    slope : two (1, slopes) float32 arrays
        Steps a um of height.
    slopes : (1, slopes) float32 array
        Sideways a um of height.
    heights_um, widths_um : (K + 1,) float32 arrays
        Where distances are looked up, in the order in which rays meet them, and how
        wide a ray is there.
    is_sharp : bool
        Whether what rays leave before they approach it does not count: the last
        distance does then.
    away_um : (points,) float32 array
        How far from the outline all rays of a point start at least, at height 0.
    least : (points, slopes) float32 array, out
        In widths.
    """
    (u, v), (du, dv) = start, slope
    stride = 0 if u.shape[1] == 1 else 1  # one start for all rays, or one for each
    last = heights_um.size - 1
    widest = max(widths_um[0], widths_um[last])
    depth = abs(heights_um[last] - heights_um[0])
    farthest = max(abs(heights_um[0]), abs(heights_um[last]))
    # points within: next to each other they meet the same part of the grid
    for r in range(least.shape[1]):
        for p in range(least.shape[0]):
            if away_um[p] >= farthest * slopes[0, r] + widest:
                least[p, r] = _CLEAR
                continue
            ray = u[p, r * stride], v[p, r * stride], du[0, r], dv[0, r]
            before = _nearest(distances, ray, heights_um[0])
            end = _nearest(distances, ray, heights_um[last])
            found = end / widths_um[last]
            if not is_sharp:
                found = min(found, before / widths_um[0])
            # a distance changes by the way at most: nearer than this none comes
            way = depth * slopes[0, r]
            if before + end - way < widest and (is_sharp or found > -0.5):
                found = _on_the_way(
                    distances, ray, heights_um, widths_um, before, found, is_sharp
                )
            least[p, r] = found


@compiled
def _on_the_way(
    distances: Float32Array,
    ray: tuple[float, float, float, float],
    heights_um: Float32Array,
    widths_um: Float32Array,
    before: float,
    found: float,
    is_sharp: bool,  # noqa: FBT001 - as above
) -> float:
    """Return the least distance of one ray, in widths; `found` of both its ends."""
    last = heights_um.size - 1
    if not is_sharp:
        for k in range(1, last):
            at = _nearest(distances, ray, heights_um[k])
            found = min(found, at / widths_um[k])
        return float(found)
    least, approaches = np.inf, False
    for k in range(1, last + 1):
        now = _nearest(distances, ray, heights_um[k])
        approaches = approaches or now < before
        if approaches:
            least = min(least, now / widths_um[k])
        before = now
    return float(least if approaches else found)


@compiled
def _nearest(
    distances: Float32Array, ray: tuple[float, float, float, float], z_um: float
) -> float:
    """Return the distance at the point of the grid nearest to a ray at a height."""
    rows, columns = distances.shape
    column = np.uintp(np.int32(min(max(ray[0] + z_um * ray[2], 0.0), columns - 1.0)))
    row = np.uintp(np.int32(min(max(ray[1] + z_um * ray[3], 0.0), rows - 1.0)))
    return float(distances[row, column])
