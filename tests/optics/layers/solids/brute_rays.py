"""Rays through solid bodies, one by one: edges crossed, points in polygons.

Written from the geometry alone: a ray comes down through a pixel, ends on a face or
the floor, is lost in a black wall or goes on mirrored by it. A diffuse face gets a
ray of the lamp of any slope, traced upwards in the same way; a polished one that which
it mirrors along the ray seen, if the lamp sends any of that slope.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.optics.outline.outline import Outline, flatten
from microplan.optics.render.scene import Layer

_CHORD_UM = 0.01
_NEXT_UM = 1e-6  # a crossing nearer than this is the one a ray comes from


@dataclass(frozen=True)
class Prism:
    """A body by the corners of its rings."""

    edges: FloatArray  # (E, 4) x0, y0, x1, y1, the inside to the left
    low_um: float
    high_um: float
    face: float
    wall: float
    finish: float

    def holds(self, p: FloatArray) -> BoolArray:
        """Return whether points (N, 2) lie inside: edges crossed to the right."""
        x0, y0, x1, y1 = self.edges.T
        x, y = p[:, 0, None], p[:, 1, None]
        over = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            right = x0 + (y - y0) / (y1 - y0) * (x1 - x0) > x
        inside: BoolArray = np.sum(over & right, axis=1) % 2 == 1
        return inside


def prism(layer: Layer) -> Prism:
    """Return a layer as a prism."""
    return Prism(
        edges=_edges(layer.outline),
        low_um=layer.z_um if layer.underside_um is None else layer.underside_um,
        high_um=layer.z_um,
        face=layer.reflectance,
        wall=layer.wall_reflectance,
        finish=layer.finish,
    )


def _edges(outline: Outline) -> FloatArray:
    rings = [flatten(ring, _CHORD_UM) for ring in outline.rings]
    return np.concatenate([np.hstack([r, np.roll(r, -1, axis=0)]) for r in rings])


def pupil(aperture: float, count: int, rng: np.random.Generator) -> FloatArray:
    """Return slopes (count, 2) that fill a pupil evenly by area, jittered in cells."""
    side = int(np.ceil(np.sqrt(count)))
    u, v = (np.indices((side, side)).reshape(2, -1) + rng.random((2, side**2))) / side
    order = rng.permutation(side**2)[:count]
    s = aperture * np.sqrt(u[order])
    slope = s / np.sqrt(1 - s**2)
    angle = 2 * np.pi * v[order]
    return np.stack([slope * np.cos(angle), slope * np.sin(angle)], axis=1)


def seen(
    bodies: Sequence[Prism],
    floor: tuple[float, float],
    at_um: FloatArray,
    *,
    aperture: float,
    lamp: float,
    focus_um: float,
    rays: int,
    rng: np.random.Generator,
    bounces: int = 8,
) -> FloatArray:
    """Return the radiance at points (P, 2) of the plane in focus, (P,).

    The lamp's light is even within its aperture; of each slope a polished face gives
    back so much more than a dull one as the lens' cone is wider, none beyond.
    """
    top = max(body.high_um for body in bodies) + 1.0
    found = np.empty(len(at_um))
    for k, at in enumerate(at_um):
        slopes = pupil(aperture, rays, rng)
        lit = np.hypot(*slopes.T) < lamp / np.sqrt(1 - lamp**2)
        bright = lit / lit.mean()  # 1 in the mean: walls keep what a ray rises
        start = at + (top - focus_um) * slopes
        back = _down(bodies, floor, start, -slopes, top, bounces)
        weight, face, finish, p, z, d = back
        free = np.ones(rays)
        shiny = (weight * face > 0) & (finish > 0)
        free[shiny] = bright[shiny] * _up(
            bodies, p[shiny], d[shiny], z[shiny], top, bounces
        )
        diffuse = (weight * face > 0) & (finish < 1)
        shaded = _up(bodies, p[diffuse], pupil(lamp, rays, rng)[diffuse], z[diffuse],
                     top, bounces)  # fmt: skip
        free[diffuse] *= finish[diffuse]
        free[diffuse] += (1 - finish[diffuse]) * shaded
        found[k] = np.mean(weight * face * free)
    return found


def _down(
    bodies: Sequence[Prism],
    floor: tuple[float, float],
    p: FloatArray,
    d: FloatArray,
    z: float,
    bounces: int,
) -> tuple[FloatArray, ...]:
    """Return weight, reflectance, finish and place of what rays end on, and slopes."""
    n = len(p)
    p, d, h = p.copy(), d.copy(), np.full(n, z)
    weight, face, finish = np.ones(n), np.zeros(n), np.zeros(n)
    alive = np.arange(n)
    for _ in range(bounces + 1):
        fall = h[alive] - floor[1]
        whose = np.full(alive.size, -1)
        at_top = np.zeros(alive.size, dtype=bool)
        edge = np.zeros(alive.size, dtype=int)
        for k, body in enumerate(bodies):
            to_top = h[alive] - body.high_um
            where = p[alive] + to_top[:, None] * d[alive]
            top = (to_top >= 0) & (to_top < fall)
            top[top] = body.holds(where[top])
            fall[top], whose[top], at_top[top] = to_top[top], k, True
            t, e = _crossing(body, p[alive], d[alive], h[alive], -1)
            wall = t < fall
            fall[wall], whose[wall], at_top[wall] = t[wall], k, False
            edge[wall] = e[wall]
        p[alive] += fall[:, None] * d[alive]
        h[alive] -= fall
        ended = (whose < 0) | at_top
        for k, body in enumerate(bodies):
            mine = alive[at_top & (whose == k)]
            face[mine], finish[mine] = body.face, body.finish
        face[alive[whose < 0]] = floor[0]
        for k, body in enumerate(bodies):
            mine = ~ended & (whose == k)
            _bounce(body, d, weight, alive[mine], edge[mine])
        alive = alive[~ended]
        alive = alive[weight[alive] > 0]
        if not alive.size:
            break
    weight[alive] = 0.0
    return weight, face, finish, p, h, d


def _up(
    bodies: Sequence[Prism],
    p: FloatArray,
    d: FloatArray,
    z: FloatArray,
    top: float,
    bounces: int,
) -> FloatArray:
    """Return the weights of rays that come out above all, (N,)."""
    p, d, h, weight = p.copy(), d.copy(), z.copy(), np.ones(len(p))
    alive = np.arange(len(p))
    for _ in range(bounces + 1):
        rise = top - h[alive]
        whose = np.full(alive.size, -1)
        edge = np.zeros(alive.size, dtype=int)
        lost = np.zeros(alive.size, dtype=bool)
        for k, body in enumerate(bodies):
            to_low = body.low_um - h[alive]
            where = p[alive] + to_low[:, None] * d[alive]
            low = (to_low > _NEXT_UM) & (to_low < rise)
            low[low] = body.holds(where[low])
            rise[low], whose[low], lost[low] = to_low[low], k, True
            t, e = _crossing(body, p[alive], d[alive], h[alive], 1)
            wall = t < rise
            rise[wall], whose[wall], lost[wall] = t[wall], k, False
            edge[wall] = e[wall]
        p[alive] += rise[:, None] * d[alive]
        h[alive] += rise
        weight[alive[lost]] = 0.0
        for k, body in enumerate(bodies):
            mine = (whose == k) & ~lost
            _bounce(body, d, weight, alive[mine], edge[mine])
        alive = alive[(whose >= 0) & ~lost]
        alive = alive[weight[alive] > 0]
        if not alive.size:
            return weight
    weight[alive] = 0.0
    return weight


def _crossing(
    body: Prism, p: FloatArray, d: FloatArray, h: FloatArray, sign: int
) -> tuple[FloatArray, np.ndarray]:
    """Return the first crossing of a wall from outside, um of height, and its edge."""
    x0, y0, x1, y1 = body.edges.T
    ex, ey = x1 - x0, y1 - y0
    dx, dy = d[:, 0, None], d[:, 1, None]
    cross = dx * ey - dy * ex  # negative: from the outside, which lies right of an edge
    px, py = x0 - p[:, 0, None], y0 - p[:, 1, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (px * ey - py * ex) / cross
        s = (px * dy - py * dx) / cross
    z = h[:, None] + sign * t
    hit = (t > _NEXT_UM) & (s >= 0) & (s < 1) & (z > body.low_um) & (z < body.high_um)
    t = np.where(hit & (cross < 0), t, np.inf)
    edge = np.argmin(t, axis=1)
    return t[np.arange(len(p)), edge], edge


def _bounce(
    body: Prism, d: FloatArray, weight: FloatArray, which: np.ndarray, edge: np.ndarray
) -> None:
    """Mirror some slopes at edges, in place."""
    along = body.edges[edge, 2:] - body.edges[edge, :2]
    along /= np.hypot(*along.T)[:, None]
    d[which] = 2 * np.sum(d[which] * along, axis=1)[:, None] * along - d[which]
    weight[which] *= body.wall
