"""Levels of one still scene's pixels in several lights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import BoolArray, FloatArray, IntArray
from microplan.optics.lens.sensor import ROUNDING
from microplan.planner.calibration.still_frames import StillScene

CLEAR = 3.0  # deviations of a frame from a cut-off end: a mean errs by .0004 of one
_UNKNOWN = 0.02  # of full scale: that deviation where single frames do not tell it
_READING = 0.005  # of a level: error of light readings that weights allow for
_PIXELS = 1200  # fitted
_BINS = 24  # of level, from which pixels are taken alike
_CANDIDATES = 60_000  # pixels looked at, evenly over the picture
_FEWEST_LEVELS = 3  # of a pixel: one more than its exposure and the black level


@dataclass(frozen=True, slots=True, kw_only=True)
class LightStep:
    """Frames of the scene in one light."""

    light: float  # reading, in any unit proportional to the light
    scene: StillScene


@dataclass(frozen=True, slots=True, kw_only=True)
class LightLevels:
    """Levels of chosen pixels in each light."""

    lights: FloatArray  # (K,), the largest 1
    means: FloatArray  # (N, K) counts
    sigmas: FloatArray  # (N, K) standard deviations of a frame, counts
    weights: FloatArray  # (N, K), 1 / count; 0: cut off
    frames: FloatArray  # (K,)

    def without(self, light: int) -> LightLevels:
        """Return the levels with those of one light left out."""
        weights = self.weights.copy()
        weights[:, light] = 0.0
        return replace(self, weights=weights)


def chosen_levels(steps: Sequence[LightStep], white: float) -> LightLevels | None:
    """Return the levels of even pixels of all brightnesses; None if too few are clear.

    Even are those whose neighbours are about as bright: vibration moves them least.
    """
    scenes = [step.scene for step in steps]
    total = np.sum([scene.mean for scene in scenes], axis=0)
    every = max(total.size // _CANDIDATES, 1)
    pixels = np.arange(0, total.size, every)
    means = np.stack([scene.mean.ravel()[pixels] for scene in scenes], axis=1)
    sigmas = _sigmas(scenes, pixels, means, white)
    lights = np.array([step.light for step in steps], dtype=np.float64)
    clear = (means > CLEAR * sigmas) & (means < white - CLEAR * sigmas)
    several = np.flatnonzero((clear & (lights > 0)).sum(axis=1) >= _FEWEST_LEVELS)
    if not several.size:
        return None
    steep = np.sum([scene.slopes for scene in scenes], axis=0)
    slopes = np.sum(steep**2, axis=0).ravel()[pixels][several]
    taken = several[_even(total.ravel()[pixels][several], slopes)]
    found = LightLevels(
        lights=lights / lights.max(),
        means=means[taken],
        sigmas=sigmas[taken],
        weights=np.zeros((taken.size, lights.size)),
        frames=np.array([float(scene.frames) for scene in scenes]),
    )
    return weighted(found, clear[taken])


def weighted(levels: LightLevels, clear: BoolArray) -> LightLevels:
    """Return levels with the weights of those that are clear, (N, K), 1 / counts."""
    variance = levels.sigmas**2 / levels.frames + ROUNDING
    weights = clear / np.sqrt(variance + (_READING * levels.means) ** 2)
    return replace(levels, weights=weights)


def _sigmas(
    scenes: Sequence[StillScene], pixels: IntArray, means: FloatArray, white: float
) -> FloatArray:
    """Return the usual deviation of a frame at each level (N, K), counts."""
    some = [k for k, scene in enumerate(scenes) if scene.frames > 1]
    if not some:
        return np.full(means.shape, _UNKNOWN * white)
    level = means[:, some].ravel()
    own = np.concatenate([[scenes[k].variance.ravel()[pixels]] for k in some]).T.ravel()
    edges = np.quantile(level, np.linspace(0, 1, _BINS + 1)[1:-1])
    which = np.searchsorted(edges, level)
    count = np.bincount(which, minlength=_BINS)
    held = count > 0
    middle = np.bincount(which, level, _BINS)[held] / count[held]
    variance = np.bincount(which, own, _BINS)[held] / count[held]
    found: FloatArray = np.sqrt(np.interp(means, middle, variance) + ROUNDING)
    return found


def _even(bright: FloatArray, slopes: FloatArray) -> IntArray:
    """Return which of N pixels are the most even ones of each brightness."""
    taken = []
    for part in np.array_split(np.argsort(bright, kind="stable"), _BINS):
        order = np.argsort(slopes[part], kind="stable")
        taken.append(part[order[: _PIXELS // _BINS]])
    return np.sort(np.concatenate(taken))
