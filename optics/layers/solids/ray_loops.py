"""Loops over rays: the wall that each meets first, and its way between walls.

Compiled: a ray ends after its own number of steps, which whole arrays do not show.
"""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import BoolArray, Float32Array, FloatArray, IntArray
from microplan.compiled import compiled

LOST = -1  # rays that end nowhere: in black walls, or faint
_TOUCH_UM = 0.1  # a ray this close to a wall meets it
_LEAST_UM = 0.25  # step along it
_WALL_UM = 1.0  # the same until the first wall, which is met between two steps
_RATE = 0.95  # at most, a um, at which a ray is taken to leave it further
_STEPS = 300  # of a mirrored ray
_BOUNCES = 30  # on walls; what is left then is lost, as is less than
_FAINT = 0.005  # of the light
_SURE_UM = 1.0  # more than distances err by
_PASSED_UM = 1e-3  # heights this close are one
_NEXT = np.uintp(1)  # one point on in a grid
_ASIDE = 2.0  # steps of a grid to where distances of a normal are looked up
# If they differ by less than this share of the way, a normal lies between those of two
# edges: that of the nearer one is taken, so many steps from their corner at most.
_EVEN, _BESIDE = 0.98, 4.0
_RIM = 1.001  # steps from the end of a grid: four points lie about each place
# columns of what is known of each body, as `packed_bodies.packed` has them
(_FIRST, _COLUMNS, _ROWS, _C, _S, _U, _V, _TOP, _UNDER, _REFLECTS, _STEP, _FAR,
 _CORNERS) = range(13)  # fmt: skip


@compiled
def _between(
    grids: Float32Array, first: int, columns: int, ends: tuple[float, float],
    u: float, v: float,
) -> float:  # fmt: skip
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
    c, s, columns = bodies[k, _C], bodies[k, _S], int(bodies[k, _COLUMNS])
    u, v = c * x + s * y + bodies[k, _U], c * y - s * x + bodies[k, _V]
    first, ends = int(bodies[k, _FIRST]), (columns - _RIM, bodies[k, _ROWS] - _RIM)
    grid = grids, first, columns, ends
    nu = _between(*grid, u + _ASIDE, v) - _between(*grid, u - _ASIDE, v)
    nv = _between(*grid, u, v + _ASIDE) - _between(*grid, u, v - _ASIDE)
    length, step = max(math.hypot(nu, nv), 1e-6), bodies[k, _STEP]
    nu, nv = nu / length, nv / length
    if length < 2 * _ASIDE * step * _EVEN:
        nu, nv = _beside_corner(grids, bodies[k], (u, v), (nu, nv))
    return step * (c * nu - s * nv), step * (s * nu + c * nv)


@compiled
def _beside_corner(
    grids: Float32Array, body: FloatArray, place: tuple[float, float],
    between: tuple[float, float],
) -> tuple[float, float]:  # fmt: skip
    """Return the unit vector outwards of the nearer edge of a corner at a place.

    In the grid's frame, as is that `between` both, which stays where no corner is near.
    """
    (u, v), count = place, int(body[_CORNERS])
    first = int(body[_FIRST] + body[_ROWS] * body[_COLUMNS])
    corners = grids[first : first + 6 * count].reshape(6, count)
    at, nearest, least = int(np.searchsorted(corners[0], u - _BESIDE)), -1, _BESIDE**2
    while at < count and corners[0, at] < u + _BESIDE:
        square = (u - corners[0, at]) ** 2 + (v - corners[1, at]) ** 2
        if square < least:
            nearest, least = at, square
        at += 1
    if nearest < 0:
        return between
    cu, cv, eu, ev, su, sv = corners[:, nearest]
    if (u - cu) * (su - eu) + (v - cv) * (sv - ev) > 0:
        return float(sv), float(-su)
    return float(-ev), float(eu)


@compiled
def first_met(
    grids: Float32Array, bodies: FloatArray, floor_um: float,
    x_um: Float32Array, y_um: Float32Array, across: Float32Array, up: Float32Array,
    slopes: FloatArray, wide_um: Float32Array, first: Float32Array, whose: IntArray,
) -> None:  # fmt: skip
    """Find where rays meet their first body, and whose wall it is if that mirrors.

    They go on as far as no wall can be, again and again.

    Parameters
    ----------
    grids, bodies
        As `packed_bodies.packed`.
    floor_um : float
        Where rays end.
    x_um, y_um : (points, 1) or (points, slopes) float32 array
        Where rays start, at height 0.
    across, up : (slopes,) float32 array
        Sideways a um of height, in x and in y.
    slopes : (slopes,) float64 array
        Their lengths.
    wide_um : (points,) float32 array
        How far from a point's first ray the others start at most.
    first : (points, slopes) float32 array, in and out
        Heights, um; -inf before, and where they meet none. Inf leaves a ray out.
    whose : (points, slopes) int array, in and out
        Body; -1 before, and where it is no mirroring wall.
    """
    steepest = slopes.max()
    for p in range(first.shape[0]):
        x, y, wide = x_um[p, 0], y_um[p, 0], wide_um[p] + _SURE_UM
        # the highest body is the last as a rule: what it stops meets no other
        for k in range(bodies.shape[0] - 1, -1, -1):
            top, low = bodies[k, _TOP], max(bodies[k, _UNDER], floor_um)
            d = _distance(grids, bodies, k, x, y)
            if d >= max(abs(top), abs(low)) * steepest + wide:
                continue  # no ray meets it
            rays = x_um[p], y_um[p], across, up, slopes
            sure = d - wide, -d - wide
            _meet_body(grids, bodies[k], k, low, sure, rays, first[p], whose[p])


@compiled
def _meet_body(
    grids: Float32Array, body: FloatArray, k: int, low_um: float,
    sure_um: tuple[float, float],
    rays: tuple[Float32Array, Float32Array, Float32Array, Float32Array, FloatArray],
    first: Float32Array, whose: IntArray,
) -> None:  # fmt: skip
    """End rays of a point at a body that they meet above a height, in place.

    All of them start at least so far outside the body, and inside. One loop, as below.
    """
    x_um, y_um, across, up, slopes = rays
    c, s, top = body[_C], body[_S], body[_TOP]
    start, columns = int(body[_FIRST]), int(body[_COLUMNS])
    ends = columns - _RIM, body[_ROWS] - _RIM
    # slopes up to which rays stay outside, and inside up to the top
    outside, inside = sure_um[0] / max(abs(top), abs(low_um)), sure_um[1] / abs(top)
    stride = 0 if x_um.size == 1 else 1  # one start for all rays, or one for each
    for r in range(first.size):
        slope, best = slopes[r], first[r]
        if top <= best or outside >= slope:
            continue
        if inside >= slope:
            first[r], whose[r] = top, -1
            continue
        x, y, dx, dy = x_um[r * stride], y_um[r * stride], across[r], up[r]
        u, v = c * x + s * y + body[_U], c * y - s * x + body[_V]
        du, dv = c * dx + s * dy, c * dy - s * dx
        z, low = top, max(low_um, best)
        d = _between(grids, start, columns, ends, u + z * du, v + z * dv)
        if d < 0:
            first[r], whose[r] = top, -1
            continue
        # a distance changes by the way at most
        if d >= (z - low) * slope:
            continue
        last = _between(grids, start, columns, ends, u + low * du, v + low * dv)
        if d + last >= (z - low) * slope:
            continue
        while z > low:
            step = min(max(d, _WALL_UM) / slope, z - low)
            at = z - step
            now = _between(grids, start, columns, ends, u + at * du, v + at * dv)
            if now < 0:
                z -= step * d / (d - now)
                if z > best:
                    first[r] = z
                    whose[r] = k if z < top and body[_REFLECTS] > 0 else -1
                break
            z, d = at, now
            if now + last >= (z - low) * slope:
                break


@compiled
def fly(  # noqa: C901 - one loop: see below
    grids: Float32Array,
    bodies: FloatArray,
    floor_um: float,
    flight: FloatArray,
    walls: IntArray,
    bounces: IntArray,
    ends: IntArray,
    reach: float,
) -> None:
    """Follow rays down from wall to wall until they end.

    Parameters
    ----------
    grids, bodies
        As `packed_bodies.packed`.
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
    reach : float
        How far rays go on as they leave a body, over what is sure, at most 2. Above 1
        faster, but one in a hundred touches that body once more or less.
    """
    off, old = np.empty(bodies.shape[0]), np.empty(bodies.shape[0], dtype=np.bool_)
    for n in range(ends.size):
        # one loop over numbers: what is handed to functions or kept in arrays leaves
        # the registers, and takes nearly twice as long
        x, y, z, slope = flight[n, 0], flight[n, 1], flight[n, 2], flight[n, 5]
        across, up, weight = flight[n, 3], flight[n, 4], flight[n, 6]
        count, end, left, rate = bounces[n], LOST, walls[n], 0.0
        if left >= 0:
            nx, ny = _normal(grids, bodies, left, x, y)
            d = _distance(grids, bodies, left, x, y)
            x, y, across, up, into = _mirrored((x, y, across, up), d, (nx, ny))
            rate = across * nx + up * ny
            if into < 0:
                count, weight = count + 1, weight * bodies[left, _REFLECTS]
        off[:], old[:] = -np.inf, True
        for _ in range(_STEPS):
            if count > _BOUNCES or weight <= _FAINT:
                break
            ray, boost = (x, y, z, slope), 1.0
            if reach > 1 and rate > 0:
                boost = reach / (1 - min(rate, _RATE))
            away, near = _away(grids, bodies, floor_um, ray, off, old, (left, boost))
            start = _LEAST_UM if near < 0 else max(off[near], _LEAST_UM)
            if near == left and boost > 1 and z <= bodies[near, _TOP] and away > start:
                u, v = x + away * across, y + away * up
                if away > start + _distance(grids, bodies, near, u, v):
                    away = start  # it may have met the body
            left, rate, before = near, 0.0, z
            x, y, z = x + away * across, y + away * up, z - away / slope
            for k in range(off.size):
                top, under = bodies[k, _TOP], bodies[k, _UNDER]
                if before < under:
                    continue
                off[k], old[k] = off[k] - away, True  # at least
                if off[k] >= _TOUCH_UM + _SURE_UM:
                    continue
                d = _distance(grids, bodies, k, x, y)
                if k == near:
                    rate = (d - start) / away
                off[k], old[k] = d, False
                passed = before > top and z <= top + _PASSED_UM
                if passed and d < 0:
                    end = k
                    break
                if passed or d >= _TOUCH_UM or not under < z < top:
                    continue
                nx, ny = _normal(grids, bodies, k, x, y)
                if across * nx + up * ny >= 0 and d >= -_TOUCH_UM:
                    continue
                if bodies[k, _REFLECTS] == 0:
                    weight = 0.0
                    break
                x, y, across, up, into = _mirrored((x, y, across, up), d, (nx, ny))
                if into < 0:
                    count, weight = count + 1, weight * bodies[k, _REFLECTS]
                off[k], left, rate = _TOUCH_UM, k, across * nx + up * ny
            if end == LOST and weight > 0 and z <= floor_um + _PASSED_UM:
                end = off.size
            if end != LOST:
                break
        ends[n], bounces[n] = end, count
        flight[n, 0], flight[n, 1], flight[n, 2] = x, y, z
        flight[n, 3], flight[n, 4], flight[n, 6] = across, up, weight


@compiled
def _away(
    grids: Float32Array,
    bodies: FloatArray,
    floor_um: float,
    ray: tuple[float, float, float, float],
    off: FloatArray,
    old: BoolArray,
    leaves: tuple[int, float],
) -> tuple[float, int]:
    """Return how far a ray meets nothing, or a little, sideways um, and what is there.

    Distances that are `old` are the least possible, and looked up if they matter. That
    to the body that a ray `leaves` counts so many times.
    """
    x, y, z_um, slope = ray
    while True:
        away, nearest = (z_um - floor_um) * slope, -1
        for k in range(off.size):
            if z_um < bodies[k, _UNDER]:
                continue
            clear, above = off[k], (z_um - bodies[k, _TOP]) * slope
            if above > 0:
                clear = max(above, min(clear, bodies[k, _FAR]))
            elif k == leaves[0]:
                clear *= leaves[1]
            clear = max(clear, _LEAST_UM)
            if clear < away:
                away, nearest = clear, k
        if nearest < 0 or not old[nearest]:
            return away, nearest
        off[nearest], old[nearest] = _distance(grids, bodies, nearest, x, y), False


@compiled
def _mirrored(
    ray: tuple[float, float, float, float], off_um: float, normal: tuple[float, float]
) -> tuple[float, float, float, float, float]:
    """Return place and way of a ray after a wall so far off, and how it came in.

    0: it leaves the wall anyway.
    """
    x, y, across, up = ray
    nx, ny = normal
    into = min(across * nx + up * ny, 0.0)
    back = _TOUCH_UM - off_um  # onto its outside
    x, y = x + back * nx, y + back * ny
    return x, y, across - 2 * into * nx, up - 2 * into * ny, into
