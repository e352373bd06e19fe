"""Light in the plane that is nearest to focus: sharp regions, light by direction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import numpy.typing as npt

from microplan.arrays import Box, FloatArray
from microplan.executor.simulated.imaging.imaging_view import RaySampling
from microplan.executor.simulated.imaging.plane_light import (
    RegionLight,
    plane_lattice,
    region_light,
)
from microplan.executor.simulated.imaging.rays.lattice import PointLattice
from microplan.executor.simulated.imaging.rays.marching import Reals32
from microplan.executor.simulated.imaging.rays.ray_picture import RayPicture
from microplan.executor.simulated.imaging.rays.regions import (
    CUT,
    PlaneRegion,
    regions_of,
)

EXACT_UM = 1.0  # from a border: above a quick look-up's error and a step of the grid


@dataclass(frozen=True, eq=False)
class SharpPlane:
    """Light through a plane, from the image's middle; rows go up.

    In each region of the plane (in a body, on a face, open) the light of every
    direction is smooth: it is known on a lattice, continued beyond the region's border.
    """

    at_um: float  # world height
    x_um: FloatArray  # (columns,), of the fine grid
    y_um: FloatArray  # (rows,)
    step_um: float
    radiance: FloatArray  # (rows, columns), mean over directions
    uncut: FloatArray  # the same without bodies that the plane cuts
    regions: tuple[PlaneRegion, ...]  # front to back
    lights: tuple[RegionLight, ...]  # of each
    slopes: FloatArray  # (directions, 2), um per um

    @property
    def lattice(self) -> PointLattice:
        """Return the lattice on which light is known by direction."""
        return self.lights[0].lattice

    @cached_property
    def cut_step(self) -> FloatArray:
        """Return what bodies that are cut add to `uncut`, (Y, X) shares of 1."""
        if self.regions[0].face != CUT:
            return np.zeros_like(self.uncut)
        inside = self._away[0] < 0
        shade = self.lights[0].mean(self.x_um, self.y_um)
        step: FloatArray = np.where(inside, shade - self.uncut, 0.0)
        return step

    @cached_property
    def edge_um(self) -> Reals32:
        """Return distances to the nearest border of a region, (rows, columns)."""
        least: Reals32 = np.min(np.abs(self._away), axis=0)
        return least

    @cached_property
    def region(self) -> npt.NDArray[np.uint8]:
        """Return numbers of regions, (rows, columns) without unit, each um cell's."""
        first: npt.NDArray[np.uint8]
        first = np.argmax(self._away < 0, axis=0).astype(np.uint8)
        return first

    @cached_property
    def light(self) -> Reals32:
        """Return light by direction less its mean over them, on the lattice.

        (regions, rows, columns, directions), shares of full scale.
        """
        found: Reals32 = np.array([each.dense() for each in self.lights])
        found -= found.mean(axis=3, keepdims=True, dtype=float).astype(np.float32)
        return found

    @cached_property
    def _away(self) -> Reals32:
        """Return signed distances to each region's own bodies, (regions, Y, X) um."""
        x, y = np.meshgrid(self.x_um.astype(np.float32), self.y_um.astype(np.float32))
        return np.array([_within(region, x, y) for region in self.regions])

    def cell(self, x: Reals32, y: Reals32) -> npt.NDArray[np.int32]:
        """Return the fine grid's nearest point to (...) um points, as a flat index."""
        rows, columns = self.radiance.shape
        step = np.float32(1 / self.step_um)
        i = np.clip((x - np.float32(self.x_um[0])) * step + 0.5, 0, columns - 1)
        j = np.clip((y - np.float32(self.y_um[0])) * step + 0.5, 0, rows - 1)
        index: npt.NDArray[np.int32] = j.astype(np.int32) * np.int32(columns)
        index += i.astype(np.int32)
        return index

    def towards(self, x: Reals32, y: Reals32, at: npt.NDArray[np.int32]) -> Reals32:
        """Return by how much directions are brighter at points, (N, directions).

        `x`, `y` : (N, directions) um float arrays, column k along direction k;
        `at` : their cells of the fine grid.
        """
        rows, columns, count = self.light.shape[1:]
        spacing = np.float32(1 / self.lattice.spacing_um)
        u = np.clip((x - np.float32(self.lattice.x_um[0])) * spacing, 0, columns - 1.01)
        v = np.clip((y - np.float32(self.lattice.y_um[0])) * spacing, 0, rows - 1.01)
        left, low = u.astype(np.int32), v.astype(np.int32)
        u, v = u - left.astype(np.float32), v - low.astype(np.float32)
        index = self.region.ravel().take(at).astype(np.int32) * np.int32(rows) + low
        index = (index * np.int32(columns) + left) * np.int32(count)
        index += np.arange(count, dtype=np.int32)
        flat, up = self.light.ravel(), np.int32(columns * count)
        first = flat.take(index)
        first += u * (flat.take(index + np.int32(count)) - first)
        index += up
        after = flat.take(index)
        after += u * (flat.take(index + np.int32(count)) - after)
        mixed: Reals32 = first + v * (after - first)
        return mixed


def sharp_plane(
    picture: RayPicture,
    at_um: float,
    box: Box,
    skirt_um: float,
    sampling: RaySampling,
) -> SharpPlane:
    """Return the light through a plane towards the camera.

    Parameters
    ----------
    picture : RayPicture
        The scene.
    at_um : float
        Height of the plane.
    box : Box
        What is wanted of it, from the image's middle, um.
    skirt_um : float
        Round the box: borders of regions are drawn there, light is continued.
    sampling : RaySampling
        Steps of the fine grid and of the lattice.
    """
    step_um, edge_um = sampling.fine_um, sampling.edge_um
    x, y = (
        _fine(low - skirt_um, high + skirt_um, step_um)
        for low, high in (box[::2], box[1::2])
    )
    lattice = plane_lattice(box, sampling.plane_spacing_um)
    solids = picture.solids
    regions = regions_of(solids.bodies, at_um, stage=solids.stage_um == at_um)
    lights = [
        region_light(
            region,
            lattice,
            partial(picture.in_plane, at_um=at_um, face=region.face, edge_um=edge_um),
            len(picture.slopes),
            tolerance=sampling.tolerance,
            edge_um=edge_um,
        )
        for region in regions
    ]
    shades = [light.mean(x, y) for light in lights]
    gx, gy = np.meshgrid(x.astype(np.float32), y.astype(np.float32))
    shares = [
        np.clip(np.float32(0.5) - _within(region, gx, gy) / np.float32(step_um), 0, 1)
        for region in regions
    ]
    radiance = uncut = _blended(shares, shades)
    if regions[0].face == CUT:
        uncut = _blended(shares[1:], shades[1:])
    return SharpPlane(
        at_um=at_um,
        x_um=x,
        y_um=y,
        step_um=step_um,
        radiance=radiance,
        uncut=uncut,
        regions=tuple(regions),
        lights=tuple(lights),
        slopes=picture.slopes,
    )


def _within(region: PlaneRegion, x: Reals32, y: Reals32) -> Reals32:
    """Return signed distances to a region's own bodies; the last is all the rest."""
    if not region.within:
        return np.full(x.shape, -np.inf, dtype=np.float32)
    away = [body.distance(x, y).astype(np.float32) for body in region.within]
    nearest: Reals32 = np.min(away, axis=0)
    near = np.abs(nearest) < EXACT_UM
    px, py = x[near], y[near]
    exact = [body.distance(px, py, exact=True) for body in region.within]
    nearest[near] = np.min(exact, axis=0)
    return nearest


def _blended(shares: list[Reals32], shades: list[FloatArray]) -> FloatArray:
    """Return front over back: what one region leaves of a spot is the next one's."""
    left = np.ones_like(shades[0])
    total = np.zeros_like(left)
    for share, shade in zip(shares, shades, strict=True):
        total += left * share * shade
        left = left * (1 - share)
    return total


def _fine(low: float, high: float, step_um: float) -> FloatArray:
    """Return a fine grid's coordinates over a range, as many as transforms like."""
    count = int(np.ceil((high - low) / step_um)) + 1
    places: FloatArray = low + step_um * np.arange(quick_length(count), dtype=float)
    return places


def quick_length(least: int) -> int:
    """Return the next number with no other factors than 2, 3 and 5."""
    number = least
    while True:
        rest = number
        for factor in (2, 3, 5):
            while rest % factor == 0:
                rest //= factor
        if rest == 1:
            return number
        number += 1
