"""Pixels about a point, or a disc too small to be seen as one, in a picture."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, special

from microplan.arrays import BoolArray, FloatArray
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import tabulate
from microplan.optics.transfer.wavefront import most_defocus_um, transfer_change
from microplan.planner.calibration.through_focus.lens_picture import TriedLens

_STEEPEST = 0.99  # of the medium's index: no lens is wider
_PERIOD = 2  # pictures a side that an image is periodic in: it ends within
_ALIKE_PX = 0.05  # by which pictures with the same slopes lie apart at most


@dataclass(frozen=True, slots=True, kw_only=True)
class PointPicture:
    """One picture of a point."""

    z_um: float  # reading
    scope: Microscope  # of a camera as large as what is shown
    radius_um: float  # of the disc
    at_px: tuple[float, float]  # right and down of the middle pixel
    shown: FloatArray  # (rows, columns) light, 0..1
    used: BoolArray  # (rows, columns)

    @property
    def depth_um(self) -> float:
        """Return the depth of field by the stated aperture."""
        return self.scope.wave_depth_um

    @property
    def seen_px(self) -> tuple[float, float]:
        """Return column and row of where the point is expected."""
        rows, columns = self.shown.shape
        return self.at_px[0] + columns // 2, self.at_px[1] + rows // 2

    def image(self, lens: TriedLens) -> FloatArray:
        """Return the image that a lens makes, (rows, columns); its sum is about 1.

        Of apertures and defocus beyond what images are made for, that at the end.
        """
        aperture = min(lens.aperture, _STEEPEST * self.scope.medium_index)
        scope = replace(self.scope, aperture=aperture, wavefront=lens.terms)
        most_um = _STEEPEST * most_defocus_um(scope)
        # of the body over the plane in focus
        z_um = min(max(-lens.defocus_um(self.z_um), -most_um), most_um)
        rows, columns = self.shown.shape
        size, k = (_PERIOD * rows, _PERIOD * columns), scope.um_per_px
        across, up = fft.rfftfreq(size[1], k), -fft.fftfreq(size[0], k)
        u, v = across[None, :], up[:, None]
        f = np.hypot(u, v)
        x = np.minimum(f / scope.cutoff_per_um, 1.0)
        table = tabulate("exact", replace(scope, wavefront=()), abs(z_um))
        seen = np.where(x < 1, table.read(x), 0.0).astype(np.complex128)
        if lens.terms:
            seen += transfer_change(scope, z_um, across, up)
        seen *= np.sinc(u * k) * np.sinc(v * k) * _disc(f * self.radius_um)
        right, down = self.seen_px
        seen *= np.exp(-2j * np.pi * k * (u * right - v * down))
        found: FloatArray = fft.irfft2(seen, size)[:rows, :columns]
        return found

    def design(self, image: FloatArray) -> FloatArray:
        """Return what else changes an image (rows, columns), (N, 4) of N used pixels.

        Light, shift along columns and rows, level.
        """
        down, right = np.gradient(image)
        each = (image, right, down, np.ones_like(image))
        return np.stack([np.asarray(a)[self.used] for a in each], axis=1)

    def moved(self, right_px: float, down_px: float) -> PointPicture:
        """Return the picture with its point expected elsewhere."""
        right, down = self.at_px
        return replace(self, at_px=(right + right_px, down + down_px))

    def is_alike(self, other: PointPicture) -> bool:
        """Return whether two pictures show a point at nearly the same place."""
        alike = self.shown.shape == other.shown.shape
        return alike and math.dist(self.at_px, other.at_px) < _ALIKE_PX


def _disc(cycles: FloatArray) -> FloatArray:
    """Return the transfer of a disc at frequencies times its radius."""
    q = 2 * np.pi * np.maximum(cycles, 1e-9)
    return np.asarray(2 * special.j1(q) / q)
