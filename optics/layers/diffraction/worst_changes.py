"""Largest diffraction between faces, searched for among points of an image."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from microplan.arrays import FloatArray, IntArray
from microplan.optics.layers.diffraction.face_waves import wave_changes
from microplan.optics.layers.ray_probes import Probed, covered_shares
from microplan.optics.transfer.microscope import Microscope

_RAYS = 128  # a point, for where two faces cut the same pupil
# Of the points with the most of that, or with the highest bounds, so many are asked, as
# on an edge in focus itself nothing changes; then the nearest ones to the worst.
_LIKELY, _SOME, _ROUNDS, _BESIDE = 0.4, 14, 3, 6
# What is found is .55 to 1 of the largest change at all of the points of the examples'
# looks, .7 to 1 of it of random bars (`benchmarks.optics.layers`).
# Waves of the grid err by .004 of a step where the same edge is seen alone.
SAFE, GRID = 2.0, 0.004


def most_by_waves(
    rasters: Sequence[Probed],
    background: float,
    microscope: Microscope,
    at_um: FloatArray,
    *,
    light: FloatArray,
    steps: Sequence[float],
    bound: FloatArray,
) -> float:
    """Return the most that waves may change of what rays see, about points.

    Parameters
    ----------
    rasters : sequence of Probed
        The lowest first.
    background : float
        Reflectance of what lies below them.
    at_um : (N, 2) float array
        Points in the plane in focus, at least one.
    light : (faces, N) float array
        Share of the light that reaches what a point sees of each face.
    steps : sequence of float
        The largest step of reflectance at each face's edges.
    bound : (N,) float array
        What diffraction makes at most, share of full scale.

    Returns
    -------
    float
        Share of full scale: `SAFE` times the largest change found, and what the waves
        err by themselves.
    """
    covers = covered_shares(rasters, microscope, at_um, _RAYS)
    cut = np.sqrt(covers * (1 - covers))
    likely = np.zeros(len(at_um))
    for i, j in itertools.combinations(range(len(rasters)), 2):
        likely += steps[i] * light[i] * cut[i] * cut[j]
    some = np.union1d(_spread(likely), _spread(bound))
    found = np.full(len(at_um), -1.0)  # where not asked

    def ask(points: IntArray) -> None:
        changes = wave_changes(
            rasters, light[:, points], background, microscope, at_um[points]
        )
        found[points] = np.minimum(np.abs(changes), bound[points])

    ask(some)
    tried = np.zeros(len(at_um), dtype=np.bool_)
    for _ in range(_ROUNDS):
        worst = int(np.argmax(np.where(tried, -1.0, found)))
        tried[worst] = True
        away = np.round(np.hypot(*(at_um - at_um[worst]).T), 9)
        near = np.argsort(np.where(found < 0, away, np.inf), kind="stable")
        ask(near[: min(_BESIDE, int((found < 0).sum()))])
    return SAFE * float(found.max()) + GRID * max(steps)


def _spread(values: FloatArray) -> IntArray:
    """Return points evenly among those with the largest values, (M,)."""
    rounded = np.round(values / max(float(values.max()), 1e-12), 9)  # equals in order
    order = np.argsort(-rounded, kind="stable")
    count = max(_SOME, int(_LIKELY * len(order)))
    at = np.linspace(0, min(count, len(order)) - 1, _SOME)
    return np.unique(order[at.astype(np.intp)])
