"""Diffraction from face to face in single points of an image, by waves.

The wave that the pupil would send to a point goes down from face to face. What it
brings to a face comes back, by reciprocity, as that face's light in the point; the rest
goes on. Of that the blend of faces is taken off, each by its own wave, and what rays
change of the same blend.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from microplan.arrays import Float32Array, FloatArray
from microplan.optics.layers.diffraction.pupil_grid import (
    SIDE,
    WaveLevel,
    carry,
    directions,
    height_of,
    level,
    places,
    pupil,
    transfer,
)
from microplan.optics.layers.ray_probes import Probed
from microplan.optics.transfer.microscope import Microscope

_IN_FOCUS = 0.05  # n wavelength / A**2: rays meet a face in one place


@dataclass(frozen=True, slots=True, kw_only=True)
class _Met:
    """A face at the points of a wave or of rays: all of it, and what it sends."""

    covers: Float32Array  # (SIDE, SIDE), 0..1
    sends: Float32Array  # (SIDE, SIDE), 0..1

    def means(self, weight: Float32Array) -> tuple[float, float]:
        """Return the means of both by weights (SIDE, SIDE)."""
        w = weight.ravel()
        return float(w @ self.covers.ravel()), float(w @ self.sends.ravel())


def wave_changes(
    faces: Sequence[Probed],
    light: FloatArray,
    background: float,
    microscope: Microscope,
    at_um: FloatArray,
) -> FloatArray:
    """Return what waves change of an image whose faces hide one another by rays.

    Parameters
    ----------
    faces : sequence of Probed
        The lowest first.
    light : (faces, N) float array
        Share of the light that reaches each face as a point sees it.
    background : float
        Reflectance of what lies below all faces.
    at_um : (N, 2) float array
        Points in the plane in focus.

    Returns
    -------
    (N,) float64 array
        Share of full scale, of either sign. Rays meet a face near focus where the Airy
        pattern displaces them, for each face anew: of two faces near focus more is
        found than there is.
    """
    ways = [level(height_of(microscope, face.z_um)) for face in faces]
    airy = microscope.wavelength_um / microscope.aperture
    found = []
    for at, lit in zip(at_um, light.T, strict=True):
        each = [
            _met(face, way, at, airy, float(share))
            for face, way, share in zip(faces, ways, lit, strict=True)
        ]
        waves = _seen_by_waves(ways, [w for w, _ in each], background)
        rays = _seen_by_rays([r for _, r in each], background)
        found.append(waves - rays)
    return np.array(found)


def _seen_by_waves(
    ways: Sequence[WaveLevel], met: Sequence[_Met], background: float
) -> float:
    """Return what a point sees of faces, less the blend of each one's own wave."""
    wave, seen, rest = ways[-1].whole, 0.0, 0.0
    for k in range(len(ways) - 1, -1, -1):
        power = wave.real**2 + wave.imag**2
        seen += met[k].means(power)[1]
        free = np.maximum(1 - met[k].covers, 0)  # bodies side by side round up
        if k == 0:
            rest = float(power.ravel() @ free.ravel())
        else:
            # of a cell in part covered that part of the power is stopped
            wave = carry(wave * np.sqrt(free), ways[k], ways[k - 1])
    alone = [m.means(way.power) for m, way in zip(met, ways, strict=True)]
    return seen + background * rest - _blend(alone, background)


def _seen_by_rays(met: Sequence[_Met], background: float) -> float:
    """Return what rays see of faces, less the blend of their means."""
    free, seen = pupil(), 0.0
    for each in met[::-1]:
        seen += each.means(free)[1]
        free = free * (1 - each.covers)
    alone = [each.means(pupil()) for each in met]
    return seen + background * float(free.sum()) - _blend(alone, background)


def _blend(alone: Sequence[tuple[float, float]], background: float) -> float:
    """Return faces blended by their mean coverages, the lowest first."""
    seen = background
    for covers, sends in alone:
        seen = seen * (1 - covers) + sends
    return seen


def _met(
    face: Probed, way: WaveLevel, at_um: FloatArray, airy_um: float, light: float
) -> tuple[_Met, _Met]:
    """Return a face as the wave through a point meets it, and as its rays do."""
    by_wave = _read(face, at_um, airy_um * way.aside, light)
    if way.is_far:
        return by_wave, by_wave
    aside = way.height * directions()
    if abs(way.height) <= _IN_FOCUS:
        return by_wave, _read(face, at_um, airy_um * aside, light)
    both = fft.fft2(by_wave.covers + 1j * by_wave.sends) * transfer()
    at = np.rint(aside / places()[1]).astype(np.intp) % SIDE
    softened = fft.ifft2(both)[np.ix_(at, at)]
    by_rays = _Met(
        covers=np.clip(softened.real, 0.0, 1.0), sends=np.maximum(softened.imag, 0.0)
    )
    return by_wave, by_rays


def _read(face: Probed, at_um: FloatArray, aside_um: FloatArray, light: float) -> _Met:
    """Return a face at all places so far aside of a point along both axes."""
    rows, columns = face.covers.shape
    x = (at_um[0] + aside_um - face.left_um) / face.step_um - 0.5
    y = (face.top_um - at_um[1] - aside_um) / face.step_um - 0.5
    column, row = (
        np.clip(np.rint(v), 0, count - 1).astype(np.intp)
        for v, count in ((x, columns), (y, rows))
    )
    covers, tone = face.covers[row][:, column], face.tone[row][:, column]
    return _Met(covers=covers, sends=covers * tone * np.float32(light))
