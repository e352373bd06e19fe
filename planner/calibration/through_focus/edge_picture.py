"""Pixels about a part's edges in a picture, and the image of a lens there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.optics.render.sampling import Sampling
from microplan.optics.transfer.wavefront import most_defocus_um
from microplan.planner.calibration.geometry.part_finder import seen_pixels
from microplan.planner.calibration.through_focus.edge_profile import EdgePoints
from microplan.planner.calibration.through_focus.lens_picture import TriedLens
from microplan.planner.measure.measuring import MeasuredPicture

REACH_PX = 12.0  # from an edge: its blur to some two depths of field
_FEWEST = 400  # pixels
_ALIKE_PX = 0.05  # by which parts of pictures with the same slopes lie apart at most
_STEEPEST = 0.99  # of the medium's index: no lens is wider


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgePicture:
    """One picture of a part about its edges."""

    z_um: float  # reading
    case: LookCase  # its window holds the edges
    pose: tuple[float, float, float]  # of the target from nominal, um and rad
    shown: FloatArray  # (rows, columns) light, 0..1
    used: BoolArray  # (rows, columns)
    normals: FloatArray  # (2, N) of used pixels' nearest edges, right and down

    @property
    def depth_um(self) -> float:
        """Return the depth of field by the stated aperture."""
        return self.case.microscope.wave_depth_um

    def image(self, lens: TriedLens) -> FloatArray:
        """Return the image that a lens makes of it, (rows, columns), 0..1.

        Of apertures and defocus beyond what images are made for, that at the end.
        """
        scope = self.case.microscope
        aperture = min(lens.aperture, _STEEPEST * scope.medium_index)
        scope = replace(scope, aperture=aperture, wavefront=lens.terms)
        most_um = _STEEPEST * most_defocus_um(scope)
        z_um = min(max(lens.defocus_um(self.z_um), -most_um), most_um)
        seen = replace(self.case, microscope=scope, model="exact", sampling=Sampling())
        x_um, y_um, turn = self.pose
        return nominal_render(seen)(dx_um=x_um, dy_um=y_um, theta_rad=turn, dz_um=z_um)

    def moved(self, right_px: float, down_px: float) -> EdgePicture:
        """Return the picture with its part expected elsewhere."""
        um, (x_um, y_um, turn) = self.case.microscope.um_per_px, self.pose
        pose = (x_um + right_px * um, y_um - down_px * um, turn)
        return replace(self, pose=pose)

    def is_alike(self, other: EdgePicture) -> bool:
        """Return whether two pictures show a part so nearly alike that slopes are."""
        a, b = self.case, other.case
        off_um = math.dist(self.pose[:2], other.pose[:2])
        turn_um = abs(self.pose[2] - other.pose[2]) * a.target.size_um
        apart_px = max(off_um, turn_um) / a.microscope.um_per_px
        return a.window == b.window and apart_px < _ALIKE_PX

    def design(self, image: FloatArray) -> FloatArray:
        """Return what else changes an image (rows, columns), (N, 9) of N used pixels.

        Light and its gradient over the field, level, shift along columns and rows,
        turn, scale, and the offset of all edges outwards.
        """
        down, right = np.gradient(image)
        row, column = np.indices(image.shape, dtype=np.float64)
        x, y = ((a - a.mean()) / max(np.ptp(a) / 2, 1.0) for a in (column, row))
        light, right, down, x, y = (
            np.asarray(each)[self.used] for each in (image, right, down, x, y)
        )
        columns = (
            light, right, down, np.ones_like(light), x * light, y * light,
            x * down - y * right, x * right + y * down,
            right * self.normals[0] + down * self.normals[1],
        )  # fmt: skip
        return np.stack(columns, axis=1)


def edge_picture(
    points: EdgePoints,
    seen: MeasuredPicture,
    pose: tuple[float, float, float],
    z_um: float,
    size: tuple[int, int],
) -> EdgePicture | None:
    """Return the pixels about edges in a picture, None if it has too few of them.

    Parameters
    ----------
    points : EdgePoints
        The edges.
    seen : MeasuredPicture
        The picture, as `PartFinder.found_in` has it.
    pose : (x, y, theta)
        About where the target is from nominal, um and rad.
    z_um : float
        Focus reading.
    size : (rows, columns)
        Of the whole picture, px.
    """
    case = seen.region.case
    at_px = case.frame.to_pixel(case.x_um + pose[0], case.y_um + pose[1])
    where = points.where(at_px)
    rows, columns = (
        _span(where[:, k], n) for k, n in zip((1, 0), seen.shown.shape, strict=True)
    )
    shown = seen.shown[rows, columns]
    if not shown.size:
        return None
    row, column = np.indices(shown.shape, dtype=np.float64)
    places = np.stack([column + columns.start, row + rows.start], axis=-1)
    away, nearest = cKDTree(where[:, :2]).query(places)
    used = (away < REACH_PX) & seen_pixels(seen.region, size)[rows, columns]
    used &= (shown > 0) & (shown < shown.max())  # light that is not cut off
    if used.sum() < _FEWEST:
        return None
    window = replace(
        case.window,
        row=case.window.row + rows.start,
        column=case.window.column + columns.start,
        rows=shown.shape[0],
        columns=shown.shape[1],
    )
    return EdgePicture(
        z_um=z_um,
        case=replace(case, window=window),
        pose=pose,
        shown=shown.astype(np.float32),
        used=used,
        normals=where[np.asarray(nearest)[used], 2:].T.astype(np.float32),
    )


def _span(where: FloatArray, size: int) -> slice:
    """Return the pixels of a line of `size` that lie about points (N,), px."""
    low, high = float(where.min()) - REACH_PX, float(where.max()) + REACH_PX
    return slice(max(math.floor(low), 0), min(math.ceil(high) + 1, size))
