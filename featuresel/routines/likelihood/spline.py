"""The target alone as a cubic spline over position, focus and rotation of the pixels.

A template is rendered at points; a pixel's square is laid over it afterwards. For one
turned by phi the square's transform is a0 + a4 cos 4(alpha + phi) + ... over the
direction alpha of a frequency, so three planes give the light of a pixel at any
rotation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray

Floats = TypeVar("Floats", FloatArray, npt.NDArray[np.float32])

_ANGLES = 64  # of the mean over directions: exact to 1e-12 up to 3 cycles a pixel
_RADII = 512  # of the table of a0 and a4
_POLE = 1 / 3  # a cubic B-spline's samples have the transform 2/3 + cos(w)/3


@dataclass(frozen=True, slots=True, kw_only=True)
class Basis:
    """Four neighbouring coefficients' weights at a position, and their slopes."""

    first: int  # index of the first of the four
    weights: FloatArray  # (4,)
    slopes: FloatArray  # (4,) per unit of the index


def basis(place: float, count: int) -> Basis:
    """Return the cubic B-spline's weights at a fractional index, clamped to the range.

    Between the second and the last but one of `count` nodes all four neighbours exist.
    """
    place = min(max(place, 1.0), count - 2.0)
    first = min(int(place), count - 3) - 1
    t = place - first - 1
    weights, slopes = cubic_weights(np.array([t]))
    return Basis(first=first, weights=weights[:, 0], slopes=slopes[:, 0])


def cubic_weights(t: Floats) -> tuple[Floats, Floats]:
    """Return weights and slopes, (4, N), of the four neighbours for t in 0..1."""
    r = 1 - t
    t2, r2 = t * t, r * r
    weights, slopes = np.empty((4, *t.shape), t.dtype), np.empty((4, *t.shape), t.dtype)
    weights[0], weights[3] = r2 * r / 6, t2 * t / 6
    weights[1] = (4 - 3 * t2 * (2 - t)) / 6
    weights[2] = (4 - 3 * r2 * (2 - r)) / 6
    slopes[0], slopes[3] = -r2 / 2, t2 / 2
    slopes[1] = t * (3 * t - 4) / 2
    slopes[2] = r * (4 - 3 * r) / 2
    return weights, slopes


def plane_coefficients(
    template: FloatArray, *, over: int, side: float, turns: bool
) -> FloatArray:
    """Return the spline's coefficients of the light that pixels collect.

    Parameters
    ----------
    template : (rows, columns) float array
        Light at points, `over` a pixel.
    over : int
        Samples per pixel.
    side : float
        Of the pixel's sensitive square over the pitch.
    turns : bool
        Whether the pixels may lie at any angle to the template.

    Returns
    -------
    (1 or 3, rows, columns) float64 array
        Planes for 1, cos 4 phi and sin 4 phi, phi being the template's rotation
        counter-clockwise against the pixels; the first alone for pixels along its axes.
        What leaves one border comes in at the other.
    """
    rows, columns = template.shape
    padded = _mirrored(template)
    fy = -np.fft.fftfreq(padded.shape[0])[:, None]  # y goes up, rows down
    fx = np.fft.rfftfreq(padded.shape[1])[None, :]
    samples = (2 * _POLE + _POLE * np.cos(2 * math.pi * fy)) * (
        2 * _POLE + _POLE * np.cos(2 * math.pi * fx)
    )
    light = np.fft.rfft2(padded) / samples
    if not turns:
        gains = [np.sinc(over * side * fx) * np.sinc(over * side * fy)]
    else:
        even, fourth = _harmonics(np.hypot(fx, fy) * over * side)
        alpha = 4 * np.arctan2(fy, fx)
        gains = [even, fourth * np.cos(alpha), -fourth * np.sin(alpha)]
    return np.stack(
        [np.fft.irfft2(light * g, s=padded.shape)[:rows, :columns] for g in gains]
    )


def depth_coefficients(values: FloatArray) -> FloatArray:
    """Return a natural spline's coefficients, (K + 2, ...), through even samples."""
    count = len(values)
    matrix = np.eye(count)
    for k in range(1, count - 1):
        matrix[k, k - 1 : k + 2] = (1 / 6, 2 / 3, 1 / 6)
    flat = np.asarray(np.linalg.solve(matrix, values.reshape(count, -1)))
    return flat.reshape(values.shape)


def runout_coefficients(values: FloatArray) -> FloatArray:
    """Return the coefficients, (K + 2, ...), of a spline through K samples.

    Its ends are parabolas: the second slope is right there too.
    """
    count = len(values) + 2
    matrix = np.zeros((count, count))
    matrix[0, :4] = matrix[-1, -4:] = (1, -3, 3, -1)
    for k in range(1, count - 1):
        matrix[k, k - 1 : k + 2] = (1 / 6, 2 / 3, 1 / 6)
    ends = np.zeros((1, values[0].size))
    flat = np.concatenate((ends, values.reshape(len(values), -1), ends))
    return np.asarray(np.linalg.solve(matrix, flat)).reshape(count, *values.shape[1:])


def _mirrored(template: FloatArray) -> FloatArray:
    """Return the template followed by its mirror images, so that borders meet alike.

    Its last values go on before, to a length that transforms fast.
    """
    more = [(0, cv2.getOptimalDFTSize(size) - size) for size in template.shape]
    template = np.pad(template, more, mode="edge")
    wide = np.concatenate((template, template[:, ::-1]), axis=1)
    return np.concatenate((wide, wide[::-1]), axis=0)


def _harmonics(f: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a0 and a4 of a unit square's transform at frequencies f, cycles a side."""
    table = np.linspace(0.0, float(f.max()) * 1.001 + 1e-9, _RADII)
    angle = (np.arange(_ANGLES) + 0.5) * (math.pi / 2 / _ANGLES)
    square = np.sinc(np.outer(table, np.cos(angle))) * np.sinc(
        np.outer(table, np.sin(angle))
    )
    even = square.mean(axis=1)
    fourth = 2 * (square * np.cos(4 * angle)).mean(axis=1)
    return np.interp(f, table, even), np.interp(f, table, fourth)
