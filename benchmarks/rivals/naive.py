"""The rival: the script one would write in an afternoon.

The gear as a polygon, filled into a supersampled raster, convolved with the squared
transform of a defocused pupil, and averaged over the pixels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.signal import fftconvolve

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Outline, flatten
from microplan.optics.transfer.microscope import Microscope

_FINE_UM = 0.3  # the raster step it aims for, below half a wavelength / (2 A)
_CHORD_UM = 0.05
_TAIL_UM = 20.0  # of the kernel beyond the blur circle


@dataclass(frozen=True, slots=True, kw_only=True)
class Naive:
    """The naive renderer of one outline."""

    outline: Outline
    microscope: Microscope

    def image(self, z_um: float) -> FloatArray:
        """Return the frame of a white part over black, (rows, columns)."""
        m = self.microscope
        samples = max(1, math.ceil(m.um_per_px / _FINE_UM))
        kernel = point_spread(m, z_um, m.um_per_px / samples)
        fine = self._mask(samples, kernel.shape[0] - 1)
        blurred = fftconvolve(fine, kernel, mode="valid")
        shape = (m.height_px, samples, m.width_px, samples)
        image: FloatArray = blurred.reshape(shape).mean(axis=(1, 3))
        return image

    def _mask(self, samples: int, border: int) -> FloatArray:
        """Return the raster, 1 inside the polygon, `border` wider than the frame."""
        m = self.microscope
        rows, columns = (n * samples + border for n in (m.height_px, m.width_px))
        mask = np.zeros((rows, columns), dtype=np.uint8)
        scale = m.px_per_um * samples
        rings = []
        for ring in self.outline.rings:
            points = flatten(ring, _CHORD_UM) * (scale, -scale)
            points += ((columns - 1) / 2, (rows - 1) / 2)
            rings.append(np.round(points).astype(np.int32))
        cv2.fillPoly(mask, rings, 1)
        return mask.astype(np.float64)


def point_spread(microscope: Microscope, z_um: float, step_um: float) -> FloatArray:
    """Return the intensity of a point `z_um` out of focus, (N, N), sum 1."""
    reach_um = microscope.blur_diameter_um(z_um) + 2 * _TAIL_UM
    count = 2 * math.ceil(reach_um / step_um / 2) + 1
    f = np.fft.fftfreq(count, step_um) * microscope.wavelength_um
    sine2 = f**2 + f[:, None] ** 2
    inside = sine2 <= microscope.aperture**2
    axial = np.sqrt(np.maximum(microscope.medium_index**2 - sine2, 0))
    phase = 2 * np.pi / microscope.wavelength_um * z_um * axial
    field = np.fft.fftshift(np.fft.ifft2(inside * np.exp(1j * phase)))
    spread = np.abs(field) ** 2
    shares: FloatArray = spread / spread.sum()
    return shares
