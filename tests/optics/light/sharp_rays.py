"""Light from below and from a ring, ray by ray through sharp prisms: a slow judge.

Nothing is shared with `microplan.optics.light` but the outlines: points inside
polygons and segments across them are shapely's, pupils and rings are random numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Outline, flatten


@dataclass(frozen=True, slots=True, kw_only=True)
class SharpRounding:
    """A mirror rounded as a quarter of an ellipse, from the face down to the wall."""

    level: float  # what it sends where it mirrors the ring
    radius_um: float  # sideways
    steepness: float = 1.0  # height over `radius_um`

    def at(self, inward_um: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how far below the face it lies, um, and its tilt, rad; arrays (N,)."""
        across = np.clip(1 - inward_um / self.radius_um, 0.0, 1.0)
        along = np.sqrt(1 - across**2)
        down_um = self.steepness * self.radius_um * (1 - along)
        return down_um, np.arctan2(self.steepness * across, along)

    def inward_um(self, tilt_rad: float) -> float:
        """Return how far inside the edge it has a tilt."""
        # of the circle that, made higher or lower, is the rounding
        angle_rad = math.atan2(math.sin(tilt_rad) / self.steepness, math.cos(tilt_rad))
        return self.radius_um * (1 - math.sin(angle_rad))


@dataclass(frozen=True, slots=True, kw_only=True)
class SharpPrism:
    """A body for rays: a polygon between two heights, um."""

    polygon: BaseGeometry
    low_um: float
    top_um: float
    sends: float = 0.0  # what its face sends back dully
    clear: float = 0.0  # what it lets through
    rounding: SharpRounding | None = None  # of all edges of its face


def sharp_polygon(outline: Outline, chord_um: float = 0.01) -> BaseGeometry:
    """Return an outline as a polygon, its rings exclusive of one another."""
    rings = [shapely.Polygon(flatten(ring, chord_um)) for ring in outline.rings]
    found: BaseGeometry = rings[0]
    for ring in rings[1:]:
        found = found.symmetric_difference(ring)
    shapely.prepare(found)
    return found


def seen_from_below(
    points_um: FloatArray,
    bodies: Sequence[SharpPrism],
    *,
    focus_um: float,
    aperture: float,
    lamp_aperture: float,
    field: float,
    rays: int,
    seed: int = 1,
) -> FloatArray:
    """Return the light that reaches points of the plane in focus, (N,) shares.

    Parameters
    ----------
    points_um : (N, 2) float array
        In the plane in focus.
    field : float
        What the stage lets through.
    rays : int
        A point.
    """
    x, slopes, sine = _rays(points_um, aperture, rays, seed)
    left = np.where(sine <= lamp_aperture, field, 0.0)
    for body in bodies:
        met = _meets(body, x, slopes, focus_um)
        left = np.where(met, left * body.clear, left)
    found: FloatArray = left.reshape(len(points_um), rays).mean(axis=1)
    return found


def seen_under_ring(
    points_um: FloatArray,
    bodies: Sequence[SharpPrism],
    *,
    focus_um: float,
    aperture: float,
    elevation_rad: tuple[float, float],
    floor_um: float,
    floor: float,
    rays: int,
    to_ring: int,
    seed: int = 1,
) -> FloatArray:
    """Return what points of the plane in focus show of faces in a ring's light, (N,).

    Each ray goes down to the first face or wall that it meets; walls are black. From a
    face `to_ring` rays go up at elevations even in the squared sine from the axis; a
    rounding mirrors each ray by its own tilt, to the ring or past it.
    """
    x, slopes, _ = _rays(points_um, aperture, rays, seed)
    value, height = np.full(len(x), floor), np.full(len(x), floor_um)
    mirrored = np.zeros(len(x))
    for body in sorted(bodies, key=lambda b: b.top_um):
        met = _meets(body, x, slopes, focus_um)
        at_top = x + slopes * (body.top_um - focus_um)
        face = met & shapely.contains_xy(body.polygon, *at_top.T)
        value = np.where(met, np.where(face, body.sends, 0.0), value)
        height = np.where(met, body.top_um, height)
        mirrored[met] = 0.0
        mirrored[face] = _mirrored(
            body, at_top[face], slopes[face], elevation_rad, bodies
        )
    where = x + slopes * (height - focus_um)[:, None]
    rng = np.random.default_rng(seed + 1)
    low, high = (math.cos(e) ** 2 for e in elevation_rad)
    shown = np.zeros(len(x))
    for _ in range(to_ring):
        sine = np.sqrt(rng.uniform(high, low, len(x)))
        angle = rng.uniform(0, 2 * math.pi, len(x))
        tangent = sine / np.sqrt(1 - sine**2)
        way = np.column_stack([tangent * np.cos(angle), tangent * np.sin(angle)])
        shown += _free(bodies, where, height, way)
    each = (value * shown / to_ring + mirrored).reshape(len(points_um), rays)
    found: FloatArray = each.mean(axis=1)
    return found


def _free(
    bodies: Sequence[SharpPrism],
    where: FloatArray,
    height_um: FloatArray,
    slopes: FloatArray,
) -> np.ndarray:
    """Return which rays from points of heights pass all bodies on their way up."""
    free = np.ones(len(where), dtype=np.bool_)
    for body in bodies:
        low_um = np.maximum(body.low_um - height_um, 0.0)
        high_um = body.top_um - height_um
        ends = [where + slopes * end[:, None] for end in (low_um, high_um)]
        line = shapely.linestrings(np.stack(ends, axis=1))
        stops = shapely.intersects(body.polygon, line) & (high_um > 0)
        free &= ~stops
    return free


def _mirrored(
    body: SharpPrism,
    at_top: FloatArray,
    slopes: FloatArray,
    elevation_rad: tuple[float, float],
    bodies: Sequence[SharpPrism],
) -> FloatArray:
    """Return what rays that pass points of a face's height find in its rounding."""
    found, rounding = np.zeros(len(at_top)), body.rounding
    if rounding is None or not len(at_top):
        return found
    rim, at = shapely.boundary(body.polygon), at_top
    for _ in range(3):  # the rounding lies a little below the face
        inward_um = np.asarray(shapely.distance(rim, shapely.points(at)))
        down_um, tilt = rounding.at(inward_um)
        at = at_top - slopes * down_um[:, None]
    points = shapely.points(at)
    near = shapely.get_coordinates(shapely.shortest_line(points, rim))[1::2]
    inward = shapely.contains_xy(body.polygon, *at.T)
    outwards = (near - at) / np.maximum(inward_um, 1e-9)[:, None]
    normal = np.column_stack([outwards * np.sin(tilt)[:, None], np.cos(tilt)])
    up = np.column_stack([slopes, np.ones(len(slopes))])
    up /= np.linalg.norm(up, axis=1)[:, None]
    light = 2 * (up * normal).sum(axis=1)[:, None] * normal - up
    low, high = (math.sin(e) for e in elevation_rad)
    lit = inward & (inward_um < rounding.radius_um)
    lit &= (light[:, 2] >= low) & (light[:, 2] <= high)
    way = light[lit, :2] / light[lit, 2:]
    height = np.full(int(lit.sum()), body.top_um)
    found[lit] = rounding.level * _free(bodies, at[lit], height, way)
    return found


def _rays(
    points_um: FloatArray, aperture: float, rays: int, seed: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return starts (M, 2), slopes (M, 2) and sines (M,) of rays in air."""
    rng = np.random.default_rng(seed)
    count = len(points_um) * rays
    # stratified over the radius: fewer rays for the same error
    share = (np.arange(count) % rays + rng.random(count)) / rays
    sine = aperture * np.sqrt(share)
    angle = rng.uniform(0, 2 * math.pi, count)
    tangent = sine / np.sqrt(1 - sine**2)
    way = np.column_stack([tangent * np.cos(angle), tangent * np.sin(angle)])
    return np.repeat(points_um, rays, axis=0), way, sine


def _meets(
    body: SharpPrism, x: FloatArray, slopes: FloatArray, focus_um: float
) -> np.ndarray:
    """Return which rays meet a prism: those whose way between its heights does."""
    ends = [x + slopes * (z - focus_um) for z in (body.low_um, body.top_um)]
    line = shapely.linestrings(np.stack(ends, axis=1))
    return np.asarray(shapely.intersects(body.polygon, line))


def pixel_points(
    columns: FloatArray,
    rows: FloatArray,
    um_per_px: float,
    size: tuple[int, int],
    over: int,
) -> FloatArray:
    """Return points that sample the area of pixels (N,) px, (N over**2, 2) um."""
    height, width = size
    part = (np.arange(over) + 0.5) / over - 0.5
    dx, dy = np.meshgrid(part, part)
    x = (columns[:, None] + dx.ravel() - (width - 1) / 2) * um_per_px
    y = ((height - 1) / 2 - rows[:, None] - dy.ravel()) * um_per_px
    return np.column_stack([x.ravel(), y.ravel()])
