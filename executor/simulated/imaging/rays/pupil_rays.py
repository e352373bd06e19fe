"""Directions of light through the pupil, evenly over its area."""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.simulated.imaging.imaging_view import ImagingView

GOLDEN_RAD = math.pi * (3 - math.sqrt(5))


def pupil_slopes(
    view: ImagingView, count: int, *, turn_rad: float = 0.0, share: float = 1.0
) -> FloatArray:
    """Return slopes of rays that carry the same light, (N, 2) um per um.

    A pupil that keeps the sine condition passes light evenly over the sines; so does a
    face that scatters. The points are a spiral of sunflower seeds.

    Parameters
    ----------
    view : ImagingView
        Its aperture A; sin(angle) = rho A / n.
    count : int
        How many.
    turn_rad : float
        Rotation of the pattern.
    share : float
        Of the aperture that is used.
    """
    i = np.arange(count)
    radius = np.sqrt((i + 0.5) / count)
    sine = view.aperture * share * radius
    if sine.max(initial=0.0) >= view.medium_index:
        raise ValueError(f"an aperture of {view.aperture * share} has no angle")
    slope = sine / np.sqrt(view.medium_index**2 - sine**2)
    angle = GOLDEN_RAD * i + turn_rad
    slopes: FloatArray = slope[:, None] * np.c_[np.cos(angle), np.sin(angle)]
    return slopes


def beam_spread(view: ImagingView, count: int, *, share: float = 1.0) -> float:
    """Return the width of one of `count` rays' cells, um per um of height."""
    sine = min(view.aperture * share, 0.999 * view.medium_index)
    steepest = sine / math.sqrt(view.medium_index**2 - sine**2)
    return steepest * math.sqrt(math.pi / count)


def within_lamp(view: ImagingView, speed: FloatArray) -> FloatArray:
    """Return 1 where a ray of (N,) um per um lies in the lamp's cone, else 0."""
    sine = view.aperture * min(view.lamp_share, view.medium_index / view.aperture)
    steepest = sine / math.sqrt(max(view.medium_index**2 - sine**2, 1e-12))
    inside: FloatArray = (speed <= steepest * (1 + 1e-5)).astype(float)
    return inside
