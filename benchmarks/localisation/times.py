"""CPU time of a fix from the last one, of one from nothing, and of a single step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import fft

from benchmarks.localisation.scenes import draws, gear
from benchmarks.localisation.trials import NEAR_PX, SEED, near, prepared, timed
from benchmarks.timing import cpu_s
from microplan.arrays import FloatArray
from microplan.featuresel.routines.chain import measure_chain
from microplan.featuresel.routines.contract import Artifact, Failure, Guess, Measurement
from microplan.featuresel.trials.trials import start

_Z_UM = 2.0
_TIMED = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Times:
    """Medians, and the shortest 640 x 480 real FFT pair, ms of one thread."""

    warm_ms: float  # the fit from its last answer, off by `NEAR_PX` in both axes
    cold_ms: float  # Otsu's threshold and the fit, the angle unknown
    step_ms: float  # one step, all known and nearly right
    floor_ms: float


def times() -> Times:
    """Return CPU times at the gear, m 6.9, 2 um out of focus."""
    cv2.setNumThreads(1)
    case = gear()
    stages = prepared(case, ("otsu", "likelihood", "one_step"))
    rng = np.random.default_rng(SEED)
    image = rng.random((480, 640))
    cold, warm, step, floor = [], [], [], []
    for drawn in draws(case, _Z_UM, _TIMED, SEED):
        first, taken = _fix(drawn.image, stages[:2], start(case))
        cold.append(taken)
        last = Guess(
            column=first.column + NEAR_PX,
            row=first.row - NEAR_PX,
            theta_rad=first.theta_rad,
            z_um=first.z_um,
            zoom=first.zoom,
        )
        warm.append(_fix(drawn.image, stages[1:2], last)[1])
        step.append(_fix(drawn.image, stages[2:], near(case, drawn, rng))[1])
        floor.append(cpu_s(lambda: fft.irfft2(fft.rfft2(image), s=image.shape)))
    return Times(
        warm_ms=1e3 * float(np.median(warm)),
        cold_ms=1e3 * float(np.median(cold)),
        step_ms=1e3 * float(np.median(step)),
        floor_ms=1e3 * min(floor),
    )


def _fix(
    image: FloatArray, stages: Sequence[tuple[str, Artifact]], at: Guess
) -> tuple[Measurement, float]:
    """Return a fix and its CPU time, s."""
    found, taken = timed(lambda: measure_chain(image, stages, at))
    if isinstance(found, Failure):
        raise TypeError(found.message)
    return found, taken
