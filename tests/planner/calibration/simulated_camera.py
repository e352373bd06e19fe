"""A small camera for tests of calibration: light to counts, every fault stated."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, shift

from microplan.arrays import FloatArray
from microplan.planner.calibration.response.light_levels import LightStep
from microplan.planner.calibration.still_frames import StillScene


def power(gamma: float) -> Callable[[FloatArray], FloatArray]:
    """Return a response that is a power of the light."""
    return lambda share: np.asarray(np.clip(share, 0, None) ** gamma)


STRAIGHT = power(1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """Counts are black + (white - black) response(light), with noise, cut off."""

    top: int = 4095
    white: float = 4095.0
    black: float = 100.0
    response: Callable[[FloatArray], FloatArray] = STRAIGHT
    full_well_e: float = 10_000.0
    read_e: float = 8.0
    flicker: float = 0.0  # of each frame's light
    shake_px: float = 0.0
    step: int = 1  # between counts

    def frame(self, light: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return counts (rows, columns) of light, 1: full scale."""
        if self.shake_px:
            moved = rng.normal(0, self.shake_px, 2)
            light = shift(light, moved, order=1, mode="nearest")
        light = light * (1 + rng.normal(0, self.flicker))
        electrons = rng.poisson(np.maximum(light, 0) * self.full_well_e)
        noisy = electrons + rng.normal(0, self.read_e, light.shape)
        share = noisy / self.full_well_e
        level = np.sign(share) * self.response(np.abs(share))
        counts = np.minimum(self.black + (self.white - self.black) * level, self.white)
        whole = np.rint(counts / self.step) * self.step
        return np.asarray(np.clip(whole, 0, self.top), dtype=np.float64)

    def frames(
        self, light: FloatArray, count: int, rng: np.random.Generator
    ) -> Iterator[FloatArray]:
        """Yield frames of one still scene."""
        for _ in range(count):
            yield self.frame(light, rng)

    def scene(
        self, light: FloatArray, count: int, rng: np.random.Generator
    ) -> StillScene:
        """Return frames of one still scene, added up."""
        found = StillScene.of(self.frame(light, rng), self.top)
        for frame in self.frames(light, count - 1, rng):
            found.add(frame)
        return found

    def steps(
        self,
        light: FloatArray,
        readings: FloatArray,
        rng: np.random.Generator,
        *,
        count: int = 4,
        reading_error: float = 0.0,
    ) -> list[LightStep]:
        """Return frames in several lights, whose readings err by a share of them."""
        found = []
        for reading in readings.tolist():
            true = reading * (1 + rng.normal(0, reading_error))
            found.append(
                LightStep(light=reading, scene=self.scene(light * true, count, rng))
            )
        return found


def patches(size: int = 64, across: int = 16) -> FloatArray:
    """Return a chart (size, size) of patches .03 to 1, their edges blurred."""
    light = np.random.default_rng(4).uniform(0.03, 1.0, (across, across))
    return gaussian_filter(np.kron(light, np.ones((size // across,) * 2)), 0.6)
