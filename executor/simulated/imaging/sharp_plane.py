"""Light in the plane that is nearest to focus: sharp regions, light by direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from microplan.arrays import BoolArray, Box, FloatArray
from microplan.executor.simulated.imaging.rays.lattice import (
    PointLattice,
    filled,
    lattice_over,
)
from microplan.executor.simulated.imaging.rays.marching import Reals32
from microplan.executor.simulated.imaging.rays.ray_picture import RayPicture
from microplan.executor.simulated.imaging.rays.regions import (
    CUT,
    PlaneRegion,
    regions_of,
)

REACH = 2.5  # spacings round a border within which light is computed at each point
SPARSE = 3  # elsewhere at each so many-th, between them it is straight


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
    cut_step: FloatArray  # (rows, columns), in bodies: what they add to `uncut`
    edge_um: Reals32  # (rows, columns), distance to the nearest border of a region
    region: npt.NDArray[np.uint8]  # (rows, columns), number of the region
    lattice: PointLattice
    # (regions, rows, columns, directions), on the lattice, less the mean of directions
    light: Reals32
    slopes: FloatArray  # (directions, 2), um per um

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
        u, v = u - left, v - low
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
    step_um: float,
    spacing_um: float,
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
    step_um, spacing_um : float
        Of the fine grid and of the lattice.
    """
    x, y = (
        _fine(low - skirt_um, high + skirt_um, step_um)
        for low, high in (box[::2], box[1::2])
    )
    lattice = lattice_over(box, spacing_um)
    solids = picture.solids
    regions = regions_of(solids.bodies, at_um, stage=solids.stage_um == at_um)
    shape = (len(regions), len(lattice.y_um), len(lattice.x_um), len(picture.slopes))
    light = np.empty(shape, dtype=np.float32)
    means = []
    for k, region in enumerate(regions):
        light[k] = _light(picture, region, at_um, lattice)
        means.append(light[k].mean(axis=2, dtype=float))
        light[k] -= means[k][:, :, None].astype(np.float32)
    shades = [lattice.smooth(mean, x, y) for mean in means]
    gx, gy = np.meshgrid(x.astype(np.float32), y.astype(np.float32))
    away = [_within(region, gx, gy) for region in regions]
    shares = [np.clip(0.5 - a / step_um, 0.0, 1.0) for a in away]
    first = 1 if regions[0].face == CUT else 0
    uncut = _blended(shares[first:], shades[first:])
    return SharpPlane(
        at_um=at_um,
        x_um=x,
        y_um=y,
        step_um=step_um,
        radiance=_blended(shares, shades),
        uncut=uncut,
        cut_step=np.where((away[0] < 0) & (first == 1), shades[0] - uncut, 0.0),
        edge_um=np.min([np.abs(a) for a in away], axis=0),
        region=np.argmax(np.array(away) < 0, axis=0).astype(np.uint8),
        lattice=lattice,
        light=light,
        slopes=picture.slopes,
    )


def _within(region: PlaneRegion, x: Reals32, y: Reals32) -> Reals32:
    """Return signed distances to a region's own bodies; the last is all the rest."""
    if not region.within:
        return np.full(x.shape, -np.inf, dtype=np.float32)
    away = [body.distance(x, y, exact=True) for body in region.within]
    nearest: Reals32 = np.min(away, axis=0).astype(np.float32)
    return nearest


def _blended(shares: list[FloatArray], shades: list[FloatArray]) -> FloatArray:
    """Return front over back: what one region leaves of a spot is the next one's."""
    left = np.ones_like(shades[0])
    total = np.zeros_like(left)
    for share, shade in zip(shares, shades, strict=True):
        total += left * share * shade
        left = left * (1 - share)
    return total


def _light(
    picture: RayPicture, region: PlaneRegion, at_um: float, lattice: PointLattice
) -> Reals32:
    """Return the light in a region on the lattice, (rows, columns, directions).

    Far from the region's borders every third point is enough: what bends light there is
    a body's height away.
    """
    shape = (len(lattice.y_um), len(lattice.x_um), len(picture.slopes))
    px, py = lattice.points()
    away = region.distance(px, py)
    row, column = np.divmod(np.arange(len(px)), shape[1])
    sparse = (row % SPARSE == 0) & (column % SPARSE == 0)
    border = np.abs(away) < REACH * lattice.spacing_um
    reach = away < REACH * SPARSE * lattice.spacing_um
    near = np.flatnonzero(border | (sparse & reach))
    qx, qy, good = region.drawn_in(px[near], py[near])
    near, qx, qy = near[good], qx[good], qy[good]
    light = np.zeros((len(px), shape[2]), dtype=np.float32)
    known = np.zeros(len(px), dtype=bool)
    if len(near):
        light[near] = picture.in_plane(qx, qy, at_um, region.face)
        known[near] = True
    return _spread_out(light.reshape(shape), known.reshape(shape[:2]))


def _spread_out(light: Reals32, known: BoolArray) -> Reals32:
    """Return light at all points of a lattice, known at some; others lie between."""
    coarse = filled(light[::SPARSE, ::SPARSE], known[::SPARSE, ::SPARSE])
    row, column = np.nonzero(~known)
    v, u = row / SPARSE, column / SPARSE
    low = np.minimum(v.astype(int), max(coarse.shape[0] - 2, 0))
    left = np.minimum(u.astype(int), max(coarse.shape[1] - 2, 0))
    v, u = (np.minimum(w, 1.0)[:, None].astype(np.float32) for w in (v - low, u - left))
    up = np.minimum(low + 1, coarse.shape[0] - 1)
    right = np.minimum(left + 1, coarse.shape[1] - 1)
    first = (1 - u) * coarse[low, left] + u * coarse[low, right]
    after = (1 - u) * coarse[up, left] + u * coarse[up, right]
    whole = light.copy()
    whole[row, column] = (1 - v) * first + v * after
    return whole


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
