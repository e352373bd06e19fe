"""One ray at a time through circles and polygons, in plain Python.

Shares no line with the camera: no maps, no beams, no lattices.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass

NEAR = 1e-9


@dataclass(frozen=True)
class Prism:
    """A body between two heights; rings are circles (x, y, r) or tuples of corners."""

    rings: tuple[tuple[object, ...], ...]
    low: float
    high: float
    reflectance: float
    wall: float = 0.0
    finish: float = 0.0


Hit = tuple[float, float, float]  # way, and the normal


def inside(prism: Prism, x: float, y: float) -> bool:
    """Return whether a point is in an odd number of rings."""
    odd = False
    for ring in prism.rings:
        if isinstance(ring[0], float):
            cx, cy, r = ring
            odd ^= math.hypot(x - cx, y - cy) < r  # type: ignore[operator]
        else:
            for (x0, y0), (x1, y1) in sides(ring):
                if (y0 > y) != (y1 > y) and x < x0 + (y - y0) * (x1 - x0) / (y1 - y0):
                    odd = not odd
    return odd


def sides(ring: tuple[object, ...]) -> Iterator[tuple[tuple[float, float], ...]]:
    """Yield the sides of a polygon."""
    for k, corner in enumerate(ring):
        yield corner, ring[(k + 1) % len(ring)]  # type: ignore[misc]


def crossings(
    prism: Prism, x: float, y: float, u: float, v: float
) -> Iterator[tuple[float, float, float]]:
    """Yield ways at which (x, y) + way (u, v) crosses the outline, and normals."""
    for ring in prism.rings:
        if isinstance(ring[0], float):
            cx, cy, r = ring
            dx, dy = x - cx, y - cy  # type: ignore[operator]
            a, b = u * u + v * v, dx * u + dy * v
            root = b * b - a * (dx * dx + dy * dy - r * r)  # type: ignore[operator]
            if root > 0 and a > 0:
                for sign in (-1, 1):
                    way = (-b + sign * math.sqrt(root)) / a
                    yield way, (dx + way * u) / r, (dy + way * v) / r  # type: ignore[operator]
        else:
            for (x0, y0), (x1, y1) in sides(ring):
                ex, ey = x1 - x0, y1 - y0
                det = u * ey - v * ex
                if abs(det) < NEAR:
                    continue
                way = ((x0 - x) * ey - (y0 - y) * ex) / det
                at = ((x0 - x) * v - (y0 - y) * u) / det
                if 0 <= at < 1:
                    length = math.hypot(ex, ey)
                    yield way, ey / length, -ex / length


def follow(
    prisms: list[Prism], at: tuple[float, float, float], u: float, v: float, up: int
) -> tuple[float, float, float, int, float, float, float]:
    """Follow a ray to a face, the stage (z = 0, index -1), the sky (-2) or a wall.

    Returns
    -------
    x, y, z, index, weight, u, v
        The end; weight 0 if it is lost.
    """
    x, y, z = at
    weight = 1.0
    while True:
        heights = [h for p in prisms for h in (p.low, p.high)]
        step = min([up * (h - z) for h in heights if up * (h - z) > NEAR], default=1e9)
        if up < 0:
            step = min(step, z)
        wall = first_wall(prisms, (x, y, z + up * step / 2), u, v, step)
        if wall is not None:
            way, i, nx, ny = wall
            weight *= prisms[i].wall
            if weight < 1e-4:
                return x, y, z, i, 0.0, u, v
            x, y, z = x + way * u, y + way * v, z + up * way
            dot = u * nx + v * ny
            u, v = u - 2 * dot * nx, v - 2 * dot * ny
            continue
        if step == 1e9:
            return x, y, z, -2, weight, u, v
        x, y, z = x + step * u, y + step * v, z + up * step
        for i, p in enumerate(prisms):
            if abs((p.low if up > 0 else p.high) - z) < NEAR and inside(p, x, y):
                return x, y, z, i, weight if up < 0 else 0.0, u, v
        if up < 0 and z < NEAR:
            return x, y, 0.0, -1, weight, u, v


def first_wall(
    prisms: list[Prism], at: tuple[float, float, float], u: float, v: float, step: float
) -> tuple[float, int, float, float] | None:
    """Return the way to the first wall within a step, whose it is, and its normal."""
    x, y, middle = at
    first: tuple[float, int, float, float] | None = None
    for i, p in enumerate(prisms):
        if p.low < middle < p.high:
            for way, nx, ny in crossings(p, x, y, u, v):
                if NEAR < way < step and (first is None or way < first[0]):
                    first = (way, i, nx, ny)
    return first


def directions(aperture: float, count: int, seed: int) -> list[tuple[float, float]]:
    """Return slopes of rays, even over the pupil's sines: rings with shaken angles."""
    random.seed(seed)
    found = []
    for k in range(count):
        r = aperture * math.sqrt((k + random.random()) / count)
        a = 2 * math.pi * ((k * 0.7548776662466927 + seed * 0.31) % 1)
        t = r / math.sqrt(1 - r * r)
        found.append((t * math.cos(a), t * math.sin(a)))
    return found


def seen(
    prisms: list[Prism],
    point: tuple[float, float, float],
    aperture: float,
    stage: float,
    *,
    rays: int,
    lamp: int,
    share: float,
) -> float:
    """Return the mean radiance that the pupil sees at a point of the focal plane."""
    x, y, z = point
    top = max(p.high for p in prisms) + 1
    total = 0.0
    for k, (u, v) in enumerate(directions(aperture, rays, 0)):
        start = (x - (top - z) * u, y - (top - z) * v, top)
        hx, hy, hz, i, weight, du, dv = follow(prisms, start, u, v, -1)
        if weight == 0:
            continue
        reflectance, finish = (stage, 0.0) if i < 0 else (
            prisms[i].reflectance, prisms[i].finish)  # fmt: skip
        lit = 1.0
        if share:
            lit = 0.0
            if finish < 1:
                cone = directions(aperture * share, lamp, k + 1)
                ends = [follow(prisms, (hx, hy, hz), a, b, 1) for a, b in cone]
                lit += (1 - finish) * sum(e[4] for e in ends if e[3] == -2) / lamp
            if finish > 0:
                end = follow(prisms, (hx, hy, hz), du, dv, 1)
                lit += finish * end[4] * (end[3] == -2)
        total += weight * reflectance * lit
    return total / rays
