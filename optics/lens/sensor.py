"""The camera's sensor: image to counts, with noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray

CountArray = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """Numbers of one sensor; at gain 1 full well is full scale of the counts."""

    full_well_e: float
    read_noise_e: float  # one standard deviation
    bits: int
    gain: float = 1.0  # full well over the electrons that give the top count [1]

    def __post_init__(self) -> None:
        if not (self.full_well_e > 0 and math.isfinite(self.full_well_e)):
            raise ValueError(f"full_well_e must be positive, got {self.full_well_e}")
        if not (self.read_noise_e >= 0 and math.isfinite(self.read_noise_e)):
            raise ValueError(
                f"read_noise_e must be finite and >= 0, got {self.read_noise_e}"
            )
        if not 1 <= self.bits <= 16:
            raise ValueError(f"bits must be in 1..16, got {self.bits}")
        if not (self.gain > 0 and math.isfinite(self.gain)):
            raise ValueError(f"gain must be positive and finite, got {self.gain}")

    @property
    def top_count(self) -> int:
        """Return the largest count, 2**bits - 1."""
        return int(2**self.bits - 1)


def expose(image: FloatArray, sensor: Sensor, rng: np.random.Generator) -> CountArray:
    """Return one noisy frame.

    ValueError if the image holds a nan or infinity.

    Parameters
    ----------
    image : (...) float array
        Share of full well; below 0 counts as 0, above 1 saturates.
    rng : numpy.random.Generator
        Source of the noise; two arrays of the image's size are drawn from it.

    Returns
    -------
    (...) uint8 or uint16 array
        Counts 0..2**bits - 1, uint8 up to 8 bits. Above gain 1 the top count is reached
        at 1 / gain of full well; below it the well is full at gain times the top.
    """
    if not np.isfinite(image).all():
        raise ValueError("image must be finite")
    light = np.clip(image, 0.0, 2.0)  # twice full well saturates just the same
    electrons = rng.poisson(light * sensor.full_well_e).astype(np.float64)
    if sensor.gain < 1:  # else the converter is at its top before
        electrons = np.minimum(electrons, sensor.full_well_e)
    electrons += sensor.read_noise_e * rng.standard_normal(np.shape(image))
    counts = np.rint(electrons / sensor.full_well_e * sensor.gain * sensor.top_count)
    counts = np.clip(counts, 0, sensor.top_count)
    return counts.astype(np.uint8) if sensor.bits <= 8 else counts.astype(np.uint16)


def to_unit(counts: CountArray, bits: int) -> FloatArray:
    """Return counts (...) as float64 shares of full scale, 0..1."""
    if not 1 <= bits <= 16:
        raise ValueError(f"bits must be in 1..16, got {bits}")
    unit: FloatArray = np.asarray(counts, dtype=np.float64) / (2**bits - 1)
    return unit
