"""Straight edges of known place: lines across each, and the line through its edges."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.sampling import find_edges, line_samples, median

FAINT = 0.04  # step height below which an edge is not trusted
LINES_PX = 1.5  # between neighbouring lines: closer ones share their pixels
_WEAKEST = 0.3  # of the predicted step
_ROUNDS = 8  # of trimming
_FEWEST = 0.5  # of a face's lines must meet its edge, and of those half must fit


@dataclass(frozen=True, slots=True, kw_only=True)
class JawFace:
    """A straight edge in the grip's frame, px with y up: a normal and a stretch."""

    normal: tuple[float, float]  # points out of the finger
    offset_px: float  # of the face along the normal
    low_px: float  # ends of the stretch, along the normal turned by +90 degrees
    high_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredFace:
    """A face as measured: where, against the one predicted."""

    offset_px: float  # at the middle of the stretch, along the normal
    slope: float  # of the edge over the stretch
    middle_px: float
    rms_px: float
    lines: int


def measure_face(
    image: FloatArray,
    numbers: Mapping[str, float],
    at: tuple[float, float, float],
    half_px: float,
    *,
    sparse: int = 1,
) -> MeasuredFace | None:
    """Return the straight line through the edges on every `sparse`-th line, or None."""
    face = JawFace(
        normal=(numbers["normal_x"], numbers["normal_y"]),
        offset_px=numbers["offset_px"],
        low_px=numbers["low_px"],
        high_px=numbers["high_px"],
    )
    along = np.arange(face.low_px, face.high_px, LINES_PX * sparse)
    offsets = line_samples(half_px, numbers["width_px"])
    columns, rows = points(face, at, along, offsets)
    edges = find_edges(image, columns, rows, width_px=numbers["width_px"], rising=False)
    good = edges.found & (edges.strength > max(_WEAKEST * numbers["step"], FAINT / 2))
    if good.sum() < max(5, _FEWEST * len(along)):
        return None
    middle = (face.low_px + face.high_px) / 2
    fitted = _line(along[good] - middle, edges.offset_px[good])
    if fitted is None:
        return None
    intercept, slope, rms, used = fitted
    return MeasuredFace(
        offset_px=face.offset_px + intercept,
        slope=slope,
        middle_px=middle,
        rms_px=rms,
        lines=used,
    )


def points(
    face: JawFace, at: tuple[float, float, float], along: FloatArray, out: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return (columns, rows), (N, L), of lines across the face, outwards."""
    column, row, theta = at
    nx, ny = face.normal
    normal = face.offset_px + out
    x = nx * normal - ny * along[:, None]
    y = ny * normal + nx * along[:, None]
    c, s = math.cos(theta), math.sin(theta)
    return column + c * x - s * y, row - s * x - c * y


def _line(x: FloatArray, y: FloatArray) -> tuple[float, float, float, int] | None:
    """Return (intercept, slope, rms, used) of a trimmed line; None if half strays."""
    # a turn of .09 rad spreads true points this far about their median
    used = np.abs(y - median(y)) <= max(3.0, 0.09 * float(np.ptp(x)))
    for _ in range(_ROUNDS):
        if used.sum() < max(5, _FEWEST * len(x)):
            return None
        intercept, slope = _least_squares(x[used], y[used])
        residual = y - intercept - slope * x
        robust = 1.4826 * median(np.abs(residual[used]))
        before, used = used, np.abs(residual) <= max(3 * robust, 0.1)
        if np.array_equal(used, before):  # so would be every round from here
            break
    rms = float(np.sqrt(np.mean(residual[used] ** 2)))
    return intercept, slope, rms, int(used.sum())


def _least_squares(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Return (intercept, slope) of the line through points (N,), N >= 2."""
    mean_x, mean_y = float(x.mean()), float(y.mean())
    away = x - mean_x
    slope = float(away @ (y - mean_y)) / float(away @ away)
    return mean_y - slope * mean_x, slope
