"""A camera: response curve, noise by level, fixed pattern; dust and uneven light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from validation.twins.scenes import Floats

Counts = npt.NDArray[np.uint16]


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """Counts of light 0..1 are black + (white - black) (gain light)**gamma.

    Noise is that of electrons in a full well and of reading, or else a table.
    """

    bits: int = 8
    gain: float = 1.0  # multiplies light; 1: light 1 is white
    black: float = 0.0  # counts of no light; below 0 the dark is cut off
    white: float = 255.0
    gamma: float = 1.0
    read_noise: float = 0.0  # sd, counts
    full_well: float | None = None  # electrons of light 1; None: no noise of light
    noise_table: Sequence[tuple[float, float]] | None = None  # level, variance: counts
    pattern: float = 0.0  # sd of a pixel's own offset, counts
    pattern_seed: int = 0

    def __post_init__(self) -> None:
        """Refuse two statements of the noise, and more bits than a file holds."""
        own = self.full_well is not None or self.read_noise > 0
        if self.noise_table is not None and own:
            raise ValueError("a table of noise holds all of it: give it alone")
        if not 1 <= self.bits <= 16:
            raise ValueError("a camera has 1 to 16 bits")

    @property
    def top(self) -> int:
        """Return the largest count."""
        return int(2**self.bits) - 1

    def level(self, light: Floats) -> Floats:
        """Return the counts that light gives without noise, neither cut nor whole."""
        curve = np.clip(light * self.gain, 0, None) ** self.gamma
        found: Floats = self.black + (self.white - self.black) * curve
        return found

    def variance(self, light: Floats) -> Floats:
        """Return the variance of counts, to first order, without rounding and cuts."""
        if self.noise_table is not None:
            at, variance = np.array(sorted(self.noise_table), dtype=np.float64).T
            return np.asarray(np.interp(self.level(light), at, variance))
        found = np.full(light.shape, float(self.read_noise**2))
        if self.full_well is not None:
            lit = np.maximum(light, 1 / self.full_well)
            slope = (self.level(lit) - self.black) * self.gamma / lit
            found += slope**2 * lit / self.full_well
        return found

    def offsets(self, size: tuple[int, int]) -> Floats:
        """Return each pixel's own offset (rows, columns), alike in all frames."""
        rng = np.random.default_rng(self.pattern_seed)
        return self.pattern * rng.standard_normal(size)


def exposed(light: Floats, camera: Camera, rng: np.random.Generator) -> Counts:
    """Return counts of light (rows, columns), cut to 0..top."""
    caught = light
    spread = np.full(light.shape, float(camera.read_noise))
    if camera.noise_table is not None:
        spread = np.sqrt(camera.variance(light))
    elif camera.full_well is not None:
        electrons = np.clip(light, 0, None) * camera.full_well
        caught = rng.poisson(electrons) / camera.full_well
    noise = spread * rng.standard_normal(light.shape)
    rows, columns = light.shape
    counts = camera.level(caught) + noise + camera.offsets((rows, columns))
    return np.clip(np.rint(counts), 0, camera.top).astype(np.uint16)


def dusted(
    light: Floats,
    specks: int,
    rng: np.random.Generator,
    radius_px: float = 2.0,
    depth: float = 0.5,
) -> Floats:
    """Return light behind dark blobs at random, their radii half to twice as given."""
    rows, columns = light.shape
    row, column = np.arange(rows)[:, None], np.arange(columns)[None, :]
    found = light.copy()
    for _ in range(specks):
        y, x = rng.uniform(-0.5, rows - 0.5), rng.uniform(-0.5, columns - 0.5)
        radius = radius_px * 2 ** rng.uniform(-1, 1)
        away = ((row - y) ** 2 + (column - x) ** 2) / radius**2
        found *= 1 - depth * rng.uniform() * np.exp(-(away**2))
    return found


def graded(light: Floats, across: float, up: float = 0.0) -> Floats:
    """Return light that changes by these shares over the width, and the height."""
    rows, columns = light.shape
    x = (np.arange(columns) + 0.5) / columns - 0.5
    y = 0.5 - (np.arange(rows) + 0.5) / rows
    found: Floats = light * (1 + across * x[None, :] + up * y[:, None])
    return found
