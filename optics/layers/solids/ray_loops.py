"""Loops over rays: the wall that each meets first, and its way between walls.

Compiled: a ray ends after its own number of steps, which whole arrays do not show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from microplan.arrays import Float32Array, FloatArray, IntArray
from microplan.compiled import compiled
from microplan.optics.layers.solids.straight_rays import ThickBody
from microplan.optics.outline.distance_field import BEYOND_UM, STEP_UM, DistanceGrid

LOST = -1  # rays that end nowhere: in black walls, or faint
_TOUCH_UM = 0.1  # a ray this close to a wall meets it
_LEAST_UM = 0.25  # step along it
_WALL_UM = 1.0  # the same until the first wall, which is met between two steps
_STEPS = 300  # of a mirrored ray
_BOUNCES = 30  # on walls; what is left then is lost, as is less than
_FAINT = 0.005  # of the light
_SURE_UM = 1.0  # more than distances err by
_PASSED_UM = 1e-3  # heights this close are one
_NEXT = np.uintp(1)  # one point on in a grid
_RIM = 1.001  # steps from the end of a grid: four points lie about each place
# columns of what is known of each body
_FIRST, _COLUMNS, _ROWS, _C, _S, _U, _V, _TOP, _UNDER, _REFLECTS, _STEP, _FAR = range(
    12
)


def packed(bodies: Sequence[ThickBody]) -> tuple[Float32Array, FloatArray]:
    """Return all grids of distances, (N,) um, and what else is known of bodies.

    (bodies, 12): where its grid begins, columns and rows; cosine and sine in grid
    steps, the grid's own place; top, underside, um; what its walls reflect; the grid's
    step, and how far its distances go, um.
    """
    numbers = np.empty((len(bodies), 12))
    first = 0
    for row, body in zip(numbers, bodies, strict=True):
        field = body.distance
        (c, s), (x, y), (u, v) = field.turn, field.origin_um, field.corner_um
        rows, columns = field.values.shape
        row[:] = (
            first, columns, rows, c / STEP_UM, s / STEP_UM,
            -(c * x + s * y + u) / STEP_UM, -(c * y - s * x + v) / STEP_UM,
            body.top_um, body.under_um, body.wall_reflectance, STEP_UM, BEYOND_UM,
        )  # fmt: skip
        first += field.values.size
    return _joined(tuple(body.distance.grid for body in bodies)), numbers


@lru_cache(maxsize=8)
def _joined(grids: tuple[DistanceGrid, ...]) -> Float32Array:
    """Return the distances of grids one after the other, (N,) um: bodies only move."""
    found = np.concatenate(
        [np.zeros(0, dtype=np.float32), *(grid.values.ravel() for grid in grids)]
    )
    found.setflags(write=False)
    return found


@compiled
def _between(
    grids: Float32Array,
    first: int,
    columns: int,
    ends: tuple[float, float],
    u: float,
    v: float,
) -> float:
    """Return the value by the four points about a place in one grid."""
    u, v = min(max(u, 0.0), ends[0]), min(max(v, 0.0), ends[1])
    column, row = int(u), int(v)
    u -= column
    v -= row
    at = np.uintp(first + row * columns + column)  # no test of its sign
    below = at + np.uintp(columns)
    low = grids[at] * (1 - u) + grids[at + _NEXT] * u
    high = grids[below] * (1 - u) + grids[below + _NEXT] * u
    return float(low * (1 - v) + high * v)


@compiled
def _distance(
    grids: Float32Array, bodies: FloatArray, k: int, x: float, y: float
) -> float:
    """Return the distance from a body's outline at a place."""
    c, s, columns = bodies[k, _C], bodies[k, _S], int(bodies[k, _COLUMNS])
    u, v = c * x + s * y + bodies[k, _U], c * y - s * x + bodies[k, _V]
    ends = columns - _RIM, bodies[k, _ROWS] - _RIM
    return _between(grids, int(bodies[k, _FIRST]), columns, ends, u, v)


@compiled
def _normal(
    grids: Float32Array, bodies: FloatArray, k: int, x: float, y: float
) -> tuple[float, float]:
    """Return the unit vector outwards of the nearest edge at a place."""
    h = 2 * bodies[k, _STEP]
    nx = _distance(grids, bodies, k, x + h, y) - _distance(grids, bodies, k, x - h, y)
    ny = _distance(grids, bodies, k, x, y + h) - _distance(grids, bodies, k, x, y - h)
    length = max(math.hypot(nx, ny), 1e-6)
    return nx / length, ny / length


@compiled
def first_met(
    grids: Float32Array,
    bodies: FloatArray,
    floor_um: float,
    x_um: Float32Array,
    y_um: Float32Array,
    across: Float32Array,
    up: Float32Array,
    first: Float32Array,
    whose: IntArray,
) -> None:
    """Find where rays meet their first body, and whose wall it is if that mirrors.

    They go on as far as no wall can be, again and again.

    Parameters
    ----------
    grids, bodies
        As `packed`.
    floor_um : float
        Where rays end.
    x_um, y_um : (points, 1) or (points, slopes) float32 array
        Where rays start, at height 0.
    across, up : (slopes,) float32 array
        Sideways a um of height.
    first : (points, slopes) float32 array, in and out
        Heights, um; -inf where they meet none. Inf leaves a ray out.
    whose : (points, slopes) int array, out
        Body; -1 where it is no mirroring wall.
    """
    first[:] = np.where(first == np.inf, np.inf, -np.inf)
    whose[:] = -1
    steepest = np.sqrt(np.max(across**2 + up**2))
    for p in range(first.shape[0]):
        x, y = x_um[p, 0], y_um[p, 0]
        wide = np.sqrt(np.max((x_um[p] - x) ** 2 + (y_um[p] - y) ** 2)) + _SURE_UM
        # the highest body is the last as a rule: what it stops meets no other
        for k in range(bodies.shape[0] - 1, -1, -1):
            top, low = bodies[k, _TOP], max(bodies[k, _UNDER], floor_um)
            d = _distance(grids, bodies, k, x, y)
            if d >= max(abs(top), abs(low)) * steepest + wide:
                continue  # no ray meets it
            if -d >= abs(top) * steepest + wide:
                _end_on_top(top, first[p], whose[p])
                continue
            rays = x_um[p], y_um[p], across, up
            _meet_body(grids, bodies[k], k, low, rays, first[p], whose[p])


@compiled
def _end_on_top(top_um: float, first: Float32Array, whose: IntArray) -> None:
    """End all rays of a point on a body's top that no higher one stops, in place."""
    for r in range(first.size):
        if top_um > first[r]:
            first[r], whose[r] = top_um, -1


@compiled
def _meet_body(
    grids: Float32Array,
    body: FloatArray,
    k: int,
    low_um: float,
    rays: tuple[Float32Array, Float32Array, Float32Array, Float32Array],
    first: Float32Array,
    whose: IntArray,
) -> None:
    """End rays of a point at a body that they meet above a height, in place."""
    x_um, y_um, across, up = rays
    c, s, top = body[_C], body[_S], body[_TOP]
    for r in range(first.size):
        best = first[r]
        if top <= best:
            continue
        x, y = x_um[r % x_um.size], y_um[r % x_um.size]
        dx, dy = across[r], up[r]
        ray = (
            c * x + s * y + body[_U], c * y - s * x + body[_V],
            c * dx + s * dy, c * dy - s * dx, math.hypot(dx, dy),
        )  # fmt: skip
        met = _top_or_wall(grids, body, max(low_um, best), ray)
        if met > best:
            wall = met < top and body[_REFLECTS] > 0
            first[r], whose[r] = met, k if wall else -1


@compiled
def _top_or_wall(
    grids: Float32Array,
    body: FloatArray,
    low_um: float,
    ray: tuple[float, float, float, float, float],
) -> float:
    """Return the height at which a ray down from above meets a body, um; -inf: none.

    The ray: where it starts in the body's grid, steps a um of height, um sideways.
    """
    u, v, du, dv, slope = ray
    first, columns = int(body[_FIRST]), int(body[_COLUMNS])
    ends = columns - _RIM, body[_ROWS] - _RIM
    z = body[_TOP]
    d = _between(grids, first, columns, ends, u + z * du, v + z * dv)
    if d < 0:
        return float(z)
    # a distance changes by the way at most
    last = _between(grids, first, columns, ends, u + low_um * du, v + low_um * dv)
    if d + last >= (z - low_um) * slope:
        return -math.inf
    while z > low_um:
        step = min(max(d, _WALL_UM) / slope, z - low_um)
        at = z - step
        now = _between(grids, first, columns, ends, u + at * du, v + at * dv)
        if now < 0:
            return float(z - step * d / (d - now))
        z, d = at, now
    return -math.inf


@compiled
def fly(
    grids: Float32Array,
    bodies: FloatArray,
    floor_um: float,
    flight: FloatArray,
    walls: IntArray,
    bounces: IntArray,
    ends: IntArray,
) -> None:
    """Follow rays down from wall to wall until they end.

    Parameters
    ----------
    grids, bodies
        As `packed`.
    floor_um : float
        Height of the plane below everything.
    flight : (N, 7) float64 array, in and out
        x, y, z, um; the unit vector sideways, x and y; sideways a um of height; weight.
    walls : (N,) int array
        Body at whose wall a ray starts; -1: at none.
    bounces : (N,) int array, in and out
        On walls.
    ends : (N,) int array, out
        Body on whose top each ends, their number for the floor, `LOST`.
    """
    off = np.empty(bodies.shape[0])
    for n in range(ends.size):
        ray = flight[n]
        if walls[n] >= 0:
            bounces[n] += _mirror(grids, bodies, walls[n], ray)
        for k in range(off.size):
            off[k] = _distance(grids, bodies, k, ray[0], ray[1])
        end = LOST
        for _ in range(_STEPS):
            if bounces[n] > _BOUNCES or ray[6] <= _FAINT:
                break
            before = ray[2]
            _go_on(bodies, floor_um, off, ray)
            end, more = _meet(grids, bodies, before, off, ray)
            bounces[n] += more
            if end == LOST and ray[6] > 0 and ray[2] <= floor_um + _PASSED_UM:
                end = off.size
            if end != LOST:
                break
        ends[n] = end


@compiled
def _meet(
    grids: Float32Array,
    bodies: FloatArray,
    before_um: float,
    off: FloatArray,
    ray: FloatArray,
) -> tuple[int, int]:
    """Return on which top a ray ends, and how many walls mirror it, in place.

    A black wall leaves no weight. `before_um` is its height a step before.
    """
    mirrors = 0
    for k in range(off.size):
        top, under = bodies[k, _TOP], bodies[k, _UNDER]
        if before_um < under:
            continue
        d = off[k] = _distance(grids, bodies, k, ray[0], ray[1])
        passed = before_um > top and ray[2] <= top + _PASSED_UM
        if passed and d < 0:
            return k, mirrors
        if passed or d >= _TOUCH_UM or not under < ray[2] < top:
            continue
        nx, ny = _normal(grids, bodies, k, ray[0], ray[1])
        if ray[3] * nx + ray[4] * ny >= 0 and d >= -_TOUCH_UM:
            continue
        if bodies[k, _REFLECTS] == 0:
            ray[6] = 0.0
            break
        mirrors += _mirror(grids, bodies, k, ray)
        off[k] = _TOUCH_UM
    return LOST, mirrors


@compiled
def _go_on(
    bodies: FloatArray, floor_um: float, off: FloatArray, ray: FloatArray
) -> None:
    """Move a ray as far as it meets nothing, or a little, in place."""
    z, slope = ray[2], ray[5]
    away = (z - floor_um) * slope
    for k in range(off.size):
        if z < bodies[k, _UNDER]:
            continue
        clear, above = off[k], (z - bodies[k, _TOP]) * slope
        if above > 0:
            clear = max(above, min(clear, bodies[k, _FAR]))
        away = min(away, max(clear, _LEAST_UM))
    ray[0] += away * ray[3]
    ray[1] += away * ray[4]
    ray[2] -= away / slope


@compiled
def _mirror(grids: Float32Array, bodies: FloatArray, k: int, ray: FloatArray) -> int:
    """Mirror a ray at a body's wall, in place; return 1 unless it leaves it anyway."""
    nx, ny = _normal(grids, bodies, k, ray[0], ray[1])
    into = min(ray[3] * nx + ray[4] * ny, 0.0)
    back = _TOUCH_UM - _distance(grids, bodies, k, ray[0], ray[1])  # onto its outside
    ray[0] += back * nx
    ray[1] += back * ny
    ray[3] -= 2 * into * nx
    ray[4] -= 2 * into * ny
    if into == 0:
        return 0
    ray[6] *= bodies[k, _REFLECTS]
    return 1
