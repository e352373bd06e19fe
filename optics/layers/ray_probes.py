"""Blending error at single points, by rays through hard layers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.special import j0, j1
from scipy.stats import qmc

from microplan.arrays import BoolArray, Box, Float32Array, FloatArray
from microplan.optics.layers.layer_edges import LayerFace
from microplan.optics.layers.rays import sheets
from microplan.optics.outline.cell_areas import cells
from microplan.optics.outline.clip import grown
from microplan.optics.transfer.microscope import Microscope

IntArray = npt.NDArray[np.int32]

# Side of a cell: a share of wavelength / A, or of the blur circle's diameter.
_FINE, _OF_BLUR = 0.1, 1 / 40
_CELLS = 1.5e6  # of one face at most
_AROUND = 5.0  # wavelengths / A around what rays of the pupil reach
_LAST = 400.0  # 2 pi A r / wavelength where the Airy pattern ends; .0016 lies beyond


@dataclass(frozen=True, slots=True, kw_only=True)
class Probed:
    """A face as a raster; its edges lie where interpolated coverage is one half."""

    z_um: float  # above the plane in focus
    left_um: float
    top_um: float
    step_um: float
    covers: Float32Array  # (rows, columns), 0..1
    tone: Float32Array  # (rows, columns), reflectance of what covers

    def read(
        self, x_um: FloatArray, y_um: FloatArray, *, fine: bool
    ) -> tuple[BoolArray, Float32Array]:
        """Return whether points (...) are covered, and their reflectance.

        Edges are right to a cell, or to a small part of it if `fine`.
        """
        x = (x_um - self.left_um) / self.step_um - 0.5
        y = (self.top_um - y_um) / self.step_um - 0.5
        column, row = np.rint(x).astype(np.int32), np.rint(y).astype(np.int32)
        at = self._at(row, column)
        tone = self.tone.ravel()[at]
        if not fine:
            return self.covers.ravel()[at] >= 0.5, tone
        left, above = np.floor(x), np.floor(y)
        right, down = x - left, y - above
        column, row = left.astype(np.int32), above.astype(np.int32)
        upper = self._mix(row, column, right)
        lower = self._mix(row + 1, column, right)
        return upper + down * (lower - upper) >= 0.5, tone

    def _mix(self, row: IntArray, column: IntArray, right: FloatArray) -> FloatArray:
        """Return coverage between two columns."""
        covers = self.covers.ravel()
        one, other = covers[self._at(row, column)], covers[self._at(row, column + 1)]
        return np.asarray(one + right * (other - one), dtype=np.float64)

    def _at(self, row: IntArray, column: IntArray) -> IntArray:
        """Return flat indices of cells; the border goes on outside."""
        rows, columns = self.covers.shape
        inside = np.minimum(np.maximum(column, 0), columns - 1)
        at: IntArray = np.minimum(np.maximum(row, 0), rows - 1) * columns + inside
        return at


def probes(
    microscope: Microscope,
    found: Sequence[LayerFace],
    at_um: FloatArray,
    *,
    are_lit: bool = False,
) -> list[Probed]:
    """Return rasters of faces wherever rays through points (N, 2) may meet them.

    Those of light too, if `are_lit`: aside as far as one face is met, and from there.
    """
    airy = microscope.wavelength_um / microscope.aperture
    x, y = at_um.T
    box = (float(x.min()), float(y.min()), float(x.max()), float(y.max()))
    more_um = _AROUND * airy
    if are_lit:  # down to a face and up again, to another one by its own blur
        more_um += 2 * max(face.blur_um for face in found)
    return [_raster(face, airy, grown(box, face.blur_um + more_um)) for face in found]


def _raster(face: LayerFace, airy: float, box: Box) -> Probed:
    """Return the raster of a face over a box."""
    left, bottom, right, top = box
    area = (right - left) * (top - bottom)
    fine = max(_FINE * airy, 2 * face.blur_um * _OF_BLUR, math.sqrt(area / _CELLS))
    shape = (math.ceil((top - bottom) / fine), math.ceil((right - left) / fine))
    hard = [cells(o.outline, left, top, fine, shape) for o in face.layers]
    (sheet,) = sheets(face.layers, hard)
    return Probed(
        z_um=face.z_um,
        left_um=left,
        top_um=top,
        step_um=fine,
        covers=np.asarray(sheet.covers, dtype=np.float32),
        tone=np.divide(
            sheet.sends,
            sheet.covers,
            dtype=np.float32,
            casting="same_kind",
            out=np.full(shape, face.layers[0].reflectance, dtype=np.float32),
            where=sheet.covers > 0,
        ),
    )


def probe_error(
    rasters: Sequence[Probed],
    background: float,
    microscope: Microscope,
    at_um: FloatArray,
    count: int,
    *,
    fine: bool,
) -> FloatArray:
    """Return the blending error at points, by rays.

    Parameters
    ----------
    rasters : sequence of Probed
        The lowest first.
    at_um : (N, 2) float array
        Points in the plane in focus.
    count : int
        Rays a point, a power of 2.
    fine : bool
        Whether edges are placed to a small part of a cell.

    Returns
    -------
    (N,) float64 array
        |mean of what rays see - blend of the means of each face|, >= 0. Rays fill the
        pupil, and start from points distributed like the Airy pattern around each
        point.
    """
    slope, spread = rays(microscope, count)
    seen = np.full((len(at_um), count), background, dtype=np.float32)
    blended = np.full(len(at_um), background)
    for face in rasters:
        side = spread + face.z_um * slope
        x, y = (at_um[:, [i]] + side[:, i] for i in (0, 1))
        covered, tone = face.read(x, y, fine=fine)
        np.copyto(seen, tone, where=covered)
        blended *= 1 - covered.mean(axis=1)
        blended += np.mean(tone * covered, axis=1, dtype=np.float64)
    error: FloatArray = np.abs(seen.mean(axis=1, dtype=np.float64) - blended)
    return error


def covered_shares(
    rasters: Sequence[Probed], microscope: Microscope, at_um: FloatArray, count: int
) -> FloatArray:
    """Return the share of points' rays that meet each face alone, (faces, N), 0..1.

    `at_um` is (N, 2) in the plane in focus; `count` is of rays a point, a power of 2.
    """
    slope, spread = rays(microscope, count)
    shares = np.empty((len(rasters), len(at_um)))
    for k, face in enumerate(rasters):
        side = spread + face.z_um * slope
        x, y = (at_um[:, [i]] + side[:, i] for i in (0, 1))
        shares[k] = face.read(x, y, fine=False)[0].mean(axis=1)
    return shares


def light_shares(
    rasters: Sequence[Probed],
    microscope: Microscope,
    lamp_aperture: float,
    at_um: FloatArray,
    count: int,
) -> FloatArray:
    """Return the share of coaxial light on faces as points see them, by rays.

    Parameters
    ----------
    rasters : sequence of Probed
        The lowest first, as far as they are lit.
    lamp_aperture : float
        Numerical aperture of the light, at most that of the lens.
    at_um : (N, 2) float array
        Points in the plane in focus.
    count : int
        Rays a point, a power of 2.

    Returns
    -------
    (faces, N) float64 array
        What higher faces leave of the light, mean over where a point's rays meet each
        face, hidden or not.
    """
    slope, _ = rays(microscope, count)
    lamp, _ = rays(replace(microscope, aperture=lamp_aperture), count)
    lamp = lamp[_shuffled(count)]
    shares = np.ones((len(rasters), len(at_um)))
    for i, face in enumerate(rasters):
        free = np.ones((len(at_um), count), dtype=np.bool_)
        for higher in rasters[i + 1 :]:
            side = face.z_um * slope + (higher.z_um - face.z_um) * lamp
            x, y = (at_um[:, [k]] + side[:, k] for k in (0, 1))
            free &= ~higher.read(x, y, fine=False)[0]
        shares[i] = free.mean(axis=1)
    return shares


def _shuffled(count: int) -> npt.NDArray[np.intp]:
    """Return an order of rays that has nothing to do with their own."""
    return np.random.default_rng(0).permutation(count)


@lru_cache(maxsize=8)
def rays(microscope: Microscope, count: int) -> tuple[FloatArray, FloatArray]:
    """Return slopes of rays and displacements of their origins, (N, 2) each.

    There are N = `count`. Slopes, dimensionless, fill the pupil by its area;
    displacements, um, follow the Airy pattern, of which 1 - J0(v)**2 - J1(v)**2 lies
    within v = 2 pi A r / wavelength.

    References
    ----------
    Born & Wolf, Principles of Optics, section 8.5.2, for the encircled energy.
    """
    unit = qmc.Sobol(4, scramble=False).random_base2(int(math.log2(count)))
    unit = unit + 0.5 / count  # the sequence starts at 0
    sine = microscope.aperture * np.sqrt(unit[:, 0])
    tangent = sine / np.sqrt(microscope.medium_index**2 - sine**2)
    v = np.linspace(0, _LAST, 20_001)
    within = 1 - j0(v) ** 2 - j1(v) ** 2
    radius = np.interp(unit[:, 2], within, v) * (
        microscope.wavelength_um / (2 * math.pi * microscope.aperture)
    )
    return _polar(tangent, unit[:, 1]), _polar(radius, unit[:, 3])


def _polar(radius: FloatArray, turns: FloatArray) -> FloatArray:
    angle = 2 * np.pi * turns
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
