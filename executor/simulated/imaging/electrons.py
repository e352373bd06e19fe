"""Counts of a camera: photon noise, read noise, response, fixed pattern, rounding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray

ROUNDING = 1 / 12  # variance of rounding, counts squared

Rows = tuple[tuple[float, float], ...]
CountArray = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


@dataclass(frozen=True, slots=True, kw_only=True)
class Chip:
    """What makes counts of light."""

    full_well_e: float  # electrons at full scale
    read_noise_e: float  # rms of the readout
    bits: int  # 1 to 16
    response: Rows = ()  # light, count; (): straight, from 0 to the top count
    noise: Rows = ()  # count, variance with rounding; in place of electrons' noise

    def __post_init__(self) -> None:
        if not 1 <= self.bits <= 16:
            raise ValueError(f"bits must be 1 to 16, got {self.bits}")

    @property
    def top(self) -> int:
        """Return the largest count that comes."""
        most = int(2**self.bits - 1)
        return min(most, round(self.response[-1][1])) if self.response else most

    def level(self, light: FloatArray) -> FloatArray:
        """Return the mean count (...) of light (...), not rounded."""
        if not self.response:
            return light * float(2**self.bits - 1)
        x, y = np.array(self.response).T
        # noise below darkness is counted as in the first piece, or as on the whole
        below = np.minimum(light, 0.0) * max((y[1] - y[0]) / x[1], y[-1] - y[0])
        found: FloatArray = np.interp(light, x, y) + below
        return found


@dataclass(frozen=True, slots=True)
class PixelPattern:
    """How each pixel differs from the mean one, whatever the frame."""

    gain: FloatArray  # (rows, columns) of the sensor
    counts: FloatArray  # (rows, columns) of the sensor

    @classmethod
    def drawn(
        cls,
        shape: tuple[int, int],
        gain: float,
        counts: float,
        rng: np.random.Generator,
    ) -> PixelPattern:
        """Return a pattern of a sensor by standard deviations of gain and offset."""
        return cls(
            1 + gain * rng.standard_normal(shape), counts * rng.standard_normal(shape)
        )

    def part(self, row: int, column: int, shape: tuple[int, ...]) -> PixelPattern:
        """Return the pattern of a window of the sensor."""
        rows, columns = slice(row, row + shape[0]), slice(column, column + shape[1])
        return PixelPattern(self.gain[rows, columns], self.counts[rows, columns])


def counted(
    image: FloatArray,
    chip: Chip,
    rng: np.random.Generator,
    pattern: PixelPattern | None = None,
) -> CountArray:
    """Return what a chip makes of an image, uint8 up to 8 bits, else uint16.

    Parameters
    ----------
    image : (rows, columns) float array
        Share of full scale, 1 being the full well.
    chip : Chip
        The sensor.
    rng : Generator
        Of the noise.
    pattern : PixelPattern, optional
        Of the same pixels.
    """
    light = np.maximum(image, 0.0)
    if pattern is not None:
        light = light * np.maximum(pattern.gain, 0.0)
    if chip.noise:
        counts = chip.level(np.minimum(light, 1.0))
        variance = np.interp(counts, *np.array(chip.noise).T)
        sigma = np.sqrt(np.maximum(variance - ROUNDING, 0.0))
        counts = rng.normal(counts, np.where(light < 1, sigma, 0.0))
    else:
        electrons = rng.poisson(chip.full_well_e * light).astype(float)
        electrons += rng.normal(0.0, chip.read_noise_e, image.shape)
        counts = chip.level(electrons / chip.full_well_e)
    if pattern is not None:
        counts = counts + pattern.counts
    whole = np.clip(np.rint(counts), 0, chip.top)
    return whole.astype(np.uint8) if chip.bits <= 8 else whole.astype(np.uint16)
