"""Levels of a camera that its counts alone tell: steps, and darkness."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import trim_mean

from microplan.arrays import FloatArray, IntArray
from microplan.planner.calibration.estimates import BlockEstimate, Refused, jackknife
from microplan.planner.calibration.still_frames import StillScene

_OFTEN = 20  # times: a count like it is missed by chance of exp(-20)
_FEWEST_CODES = 8  # seen often: fewer, and gaps are the scene's own
_NEAR = 4  # steps: wider gaps are between levels of the scene
_CUT = 0.001  # share of counts that a few odd pixels have
_TILES = 8  # a side, blocks of the jackknife
_TRIMMED = 0.1  # share of a tile's pixels at each end that may be hot or dead


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeUse:
    """Which counts a camera gives."""

    step: int  # between counts that occur, rounded
    true_bits: int  # of the camera
    missing: int  # counts that never occur, between neighbours that often do


def code_use(codes: IntArray, bits: int) -> CodeUse | Refused:
    """Return the step between counts, the bits that it leaves, and counts that miss.

    Counts of fewer bits in a file of more are multiples of a power of two, or, with
    high bits repeated below, nearly so. A table in the camera leaves single gaps.

    Parameters
    ----------
    codes : (N,) int array
        How often each count occurs; of a scene of many levels.
    bits : int
        Of the file.
    """
    often = np.flatnonzero(codes >= _OFTEN)
    seen = np.flatnonzero(codes)
    if often.size < _FEWEST_CODES:
        why = f"{often.size} counts occur {_OFTEN} times or more"
        return Refused(what="steps of counts", why=why, take="a scene of many levels")
    gaps = np.diff(often)
    least = int(gaps.min())
    usual = gaps <= least + (1 if least > 1 else 0)
    if 2 * usual.sum() < gaps.size and least > 1:
        why = "most gaps between counts differ: they are the scene's own"
        return Refused(what="steps of counts", why=why, take="a scene of many levels")
    step = max(round(float(gaps[usual].mean())), 1)
    few = int(np.diff(seen).min()) < least  # rare counts between those seen often
    step = 1 if few else step
    return CodeUse(
        step=step,
        true_bits=bits - round(math.log2(step)),
        missing=_missing(codes, often, step),
    )


def _missing(codes: IntArray, often: IntArray, step: int) -> int:
    """Return how many counts never occur between near ones that often do."""
    total = 0
    for low, high in itertools.pairwise(often.tolist()):
        wide = round((high - low) / step)
        if 2 <= wide <= _NEAR and not codes[low + 1 : high].any():
            total += wide - 1
    return total


def black_level(dark: StillScene) -> BlockEstimate | Refused:
    """Return the count of darkness.

    The mean over tiles, hot pixels cut off in each; its deviation is that of tiles.

    Parameters
    ----------
    dark : StillScene
        Frames taken without light.
    """
    total = int(dark.codes.sum())
    share = float(dark.codes[0] / total)
    if share > _CUT:
        why = f"{share:.1%} of the counts of darkness are 0: the level is cut off"
        take = "frames without light, the camera's offset raised"
        return Refused(what="black level", why=why, take=take)
    if float(dark.codes[dark.top :].sum() / total) > _CUT:
        why = "frames without light are saturated"
        return Refused(what="black level", why=why, take="frames without light")
    return jackknife(_mean, _tiles(dark.mean), method="tiles of frames without light")


def _tiles(mean: FloatArray) -> list[float]:
    """Return the trimmed mean of each tile of a picture (rows, columns), counts."""
    strips = (s for s in np.array_split(mean, _TILES, axis=0) if s.size)
    tiles = (t for s in strips for t in np.array_split(s, _TILES, axis=1) if t.size)
    return [float(trim_mean(tile, _TRIMMED, axis=None)) for tile in tiles]


def _mean(values: Sequence[float]) -> float:
    """Return the mean of some values."""
    return sum(values) / len(values)
