"""Compiled loops over rays against cylinders in closed form, and ray by ray."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from microplan.optics.layers.solids import mirrored_rays
from microplan.optics.layers.solids.solid_bodies import SentLight
from microplan.optics.layers.solids.straight_rays import (
    Rays,
    ThickBody,
    heights_between,
    hides,
    rays_of,
)
from microplan.optics.outline.distance_field import distance_field
from microplan.optics.outline.outline import Outline
from tests.optics.shapes import disc, polygon

AREA = (-60.0, -60.0, 60.0, 60.0)
RADIUS_UM, AT = 20.0, (3.0, -2.0)
SOFT = 0.02


def post(top_um: float, under_um: float, *, is_sharp: bool = False) -> ThickBody:
    """Return a round post that mirrors."""
    field = distance_field(disc(RADIUS_UM, AT), AREA)
    assert field is not None
    return ThickBody(
        distance=field, top_um=top_um, under_um=under_um, wall_reflectance=0.5,
        is_sharp=is_sharp,
    )  # fmt: skip


def drawn(count: int = 60) -> Rays:
    """Return rays of all slopes about the post."""
    rng = np.random.default_rng(3)
    return rays_of(rng.uniform(-45, 45, (count, 2)), rng.uniform(-0.4, 0.4, (40, 2)))


def first_met(
    bodies: list[ThickBody],
    rays: Rays,
    floor_um: float,
    some: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    met = mirrored_rays.first_met(bodies, floor_um, rays, some)
    return met.z_um, met.walls


def cylinder(rays: Rays, top_um: float, low_um: float) -> np.ndarray:
    """Return where rays from above meet the post in closed form, -inf: nowhere."""
    x, y = rays.x_um - AT[0], rays.y_um - AT[1]
    dx, dy = rays.across, rays.up
    a, b = dx**2 + dy**2, x * dx + y * dy
    root = b**2 - a * (x**2 + y**2 - RADIUS_UM**2)
    with np.errstate(invalid="ignore"):
        enters = (-b + np.sqrt(root)) / a  # the higher of both: rays come down
        leaves = (-b - np.sqrt(root)) / a
    on_top = (enters >= top_um) & (leaves < top_um) & (root > 0)
    wall = (enters < top_um) & (enters > low_um) & (root > 0)
    return np.where(on_top, top_um, np.where(wall, enters, -np.inf))


def shape(rays: Rays) -> tuple[int, int]:
    return rays.x_um.shape[0], rays.across.shape[1]


@pytest.mark.parametrize("floor_um", [-80.0, -10.0, 20.0])
def test_rays_meet_a_cylinder_where_geometry_says(floor_um: float) -> None:
    """To a grid's half step over the slope; grazing ones aside."""
    rays, top, under = drawn(), 60.0, -50.0
    first, whose = first_met([post(top, under)], rays, floor_um)
    true = cylinder(rays, top, max(under, floor_um))
    both = np.isfinite(first) & np.isfinite(true)
    assert np.mean(np.isfinite(first) == np.isfinite(true)) > 0.98
    slope = np.broadcast_to(np.hypot(rays.across, rays.up), shape(rays))
    off = np.abs(first[both] - true[both]) * slope[both]
    assert np.quantile(off, 0.98) < 0.4
    assert both.mean() > 0.1
    assert ((whose >= 0) == (np.isfinite(first) & (first < top))).all()


def test_rays_that_are_left_out_meet_nothing_and_change_no_other() -> None:
    rays, bodies = drawn(), [post(-20.0, -50.0), post(60.0, 0.0)]
    every, all_whose = first_met(bodies, rays, -60.0)
    out = np.random.default_rng(4).random(shape(rays)) < 0.5
    first, whose = first_met(bodies, rays, -60.0, ~out)
    assert (whose[out] == -1).all()
    assert (whose[~out] == all_whose[~out]).all()
    assert (first[~out] == every[~out]).all()


def test_points_all_of_whose_rays_pass_or_end_on_top_are_as_others() -> None:
    """Beside rays to all sides single ones, for which other points are clear."""
    rng = np.random.default_rng(6)
    bodies = [post(-20.0, -50.0), post(8.0, -15.0), post(12.0, 10.0)]
    rays = rays_of(rng.uniform(-55, 55, (80, 2)), rng.uniform(-0.4, 0.4, (30, 2)))
    together, whose = first_met(bodies, rays, -60.0)
    for r in range(rays.across.shape[1]):
        one = replace(rays, across=rays.across[:, r : r + 1], up=rays.up[:, r : r + 1])
        alone, its = first_met(bodies, one, -60.0)
        assert (alone[:, 0] == together[:, r]).all()
        assert (its[:, 0] == whose[:, r]).all()
    assert (together[whose == -1] == 12.0).mean() > 0.05


def test_mirrored_rays_in_longer_steps_end_alike() -> None:
    """But for few that touch a wall once more or less, which changes .5 of each."""
    rays, bodies = drawn(200), [post(-20.0, -50.0), post(12.0, -15.0)]
    lamp = SentLight(reflectance=1.0, finish=0.0)
    sums = []
    for reach in (1.0, 1.9):
        own = replace(rays, reach=reach)
        met = mirrored_rays.first_met(bodies, -90.0, own)
        nothing = [None] * len(bodies)
        sums.append(mirrored_rays.mirrored(bodies, nothing, lamp, -90.0, own, met))
    assert sums[0].sum() > 100
    assert np.abs(sums[1] - sums[0]).sum() < 0.02 * sums[0].sum()


@pytest.mark.parametrize("is_sharp", [False, True])
@pytest.mark.parametrize(("from_um", "to_um"), [(60.0, -50.0), (0.0, -90.0)])
def test_what_a_wall_hides_is_its_least_distance_ray_by_ray(
    from_um: float, to_um: float, *, is_sharp: bool
) -> None:
    rays, body = drawn(20), post(from_um, to_um, is_sharp=is_sharp)
    found = hides(body, rays, SOFT, from_um=from_um, to_um=to_um)
    heights = heights_between(rays, from_um, to_um)
    widths = 1.0 + SOFT * np.abs(heights)
    expected = np.empty(shape(rays))
    for p, r in np.ndindex(*shape(rays)):
        at = (rays.x_um[p] + heights * rays.across[0, r],
              rays.y_um[p] + heights * rays.up[0, r])  # fmt: skip
        d = body.distance.at(*(each.astype(np.float32) for each in at))
        least = _approached(d, widths) if is_sharp else float((d / widths).min())
        expected[p, r] = np.clip(0.5 - least, 0.0, 1.0)
    assert 0.1 < expected.mean() < 0.9
    # a place midway between two points of the grid is rounded either way
    assert np.mean(np.abs(found - expected) > 1e-4) < 0.02


def _approached(d: np.ndarray, widths: np.ndarray) -> float:
    """Return the least distance, in widths, once a ray comes nearer; else the last."""
    nearer = np.flatnonzero(np.diff(d) < 0)
    if not nearer.size:
        return float(d[-1] / widths[-1])
    return float((d / widths)[nearer[0] + 1 :].min())


@pytest.mark.parametrize("turn_rad", [0.0, 0.3])
def test_in_the_corners_of_a_narrow_hole_rays_keep_to_both_walls(
    turn_rad: float,
) -> None:
    """A hole of 6 by 14 um: unfolded, rays go on straight and places are folded."""
    wide, long = 3.0, 7.0
    hole = _turned(
        [(-wide, -long), (-wide, long), (wide, long), (wide, -long)], turn_rad
    )
    outer = _turned([(-30, -30), (30, -30), (30, 30), (-30, 30)], turn_rad)
    field = distance_field(
        Outline(rings=(*polygon(outer).rings, *polygon(hole).rings)), AREA
    )
    assert field is not None
    body = ThickBody(distance=field, top_um=0.0, under_um=-100.0, wall_reflectance=1.0)
    rng = np.random.default_rng(5)
    start = rng.uniform(-1, 1, (2000, 2)) * (wide - 0.5, long - 0.5)
    slope = np.array([0.31, 0.23])
    rays = rays_of(
        np.array(_turned(start, turn_rad)), np.array(_turned([slope], turn_rad))
    )
    met = mirrored_rays.first_met([body], -100.0, rays)
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    straight = start - 100 * slope
    touched = met.walls[:, 0] >= 0
    for axis, size in enumerate((wide, long)):
        way = (c, s) if axis == 0 else (-s, c)
        found = mirrored_rays.mirrored([body], [None], _Place(way), -100.0, rays, met)
        folded = np.abs((straight[:, axis] - size) % (4 * size) - 2 * size) - size
        off = np.abs(found - folded)[touched]
        assert np.mean(off < 1.0) > 0.95  # five walls, each some .1 um off


@dataclass(frozen=True)
class _Place:
    """A floor that sends how far along a way rays end."""

    way: tuple[float, float]
    mirrors: float = 0.0

    def __call__(self, x: np.ndarray, y: np.ndarray, /) -> np.ndarray:
        found: np.ndarray = x * self.way[0] + y * self.way[1]
        return found


def _turned(
    points: Iterable[Iterable[float]], turn_rad: float
) -> list[tuple[float, float]]:
    """Return points turned about the origin."""
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    return [(c * x - s * y, s * x + c * y) for x, y in points]
