"""How real pictures differ from any image: along edges, over faces, pixel by pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from microplan.arrays import FloatArray

_WAVES = 96  # of a field: as good as normal
_FLATTEST = 4.0  # of the sensor's smaller side over the largest correlation length
# slope of an edge in its middle, in steps times aperture over wavelength, in focus and
# incoherent light
_STEEPEST = 16 / (3 * math.pi)


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureErrors:
    """Standard deviations of pictures about images, and the seed that they come from.

    Fields stay on the sensor; each setting of the lens has its own.
    """

    edge: float  # of the step at an edge, in its middle
    flat: float  # of the light, smooth
    pixel: float  # white, of the contrast: twice the picture's own standard deviation
    shape: tuple[int, int]  # rows and columns of the sensor
    seed: int

    def of(
        self,
        image: FloatArray,
        corner: tuple[int, int],
        blur_px: float,
        setting: tuple[float, float],
    ) -> FloatArray:
        """Return what a picture shows besides its image, (rows, columns).

        Parameters
        ----------
        image : (rows, columns) float array
            Share of full scale, without noise.
        corner : (row, column)
            Of its first pixel on the sensor.
        blur_px : float
            Wavelength over aperture, pixels.
        setting : (magnification, um)
            Zoom and focus, as they are commanded.

        Notes
        -----
        An edge of the step s in focus is as steep as 16 A s / (3 pi wavelength): the
        gradient times wavelength over that is s in its middle.
        """
        longest_px = max(min(self.shape) / _FLATTEST, blur_px)
        made = _drawn(self.seed, setting, self.shape, blur_px, longest_px)
        rows = slice(corner[0], corner[0] + image.shape[0])
        columns = slice(corner[1], corner[1] + image.shape[1])
        slope = np.hypot(*np.gradient(image))
        found: FloatArray = self.edge * made.edges[rows, columns] * slope
        found *= blur_px / _STEEPEST
        found += self.flat * made.faces[rows, columns] * image
        found += self.pixel * 2 * image.std() * made.pixels[rows, columns]
        return found


@dataclass(frozen=True, slots=True)
class _Fields:
    """Fields of variance 1 over the sensor, (rows, columns) each."""

    edges: FloatArray
    faces: FloatArray
    pixels: FloatArray


@lru_cache(maxsize=2)
def _drawn(
    seed: int,
    setting: tuple[float, float],
    shape: tuple[int, int],
    shortest_px: float,
    longest_px: float,
) -> _Fields:
    """Return the fields of one setting of the lens."""
    words = [np.float64(value).view(np.uint64).item() for value in setting]
    rng = np.random.default_rng(np.random.SeedSequence([seed, *words]))
    between = shortest_px * (longest_px / shortest_px) ** rng.uniform()
    return _Fields(
        edges=waves(shape, between, rng),
        faces=waves(shape, longest_px, rng),
        pixels=rng.normal(size=shape),
    )


def waves(
    shape: tuple[int, int], length_px: float, rng: np.random.Generator
) -> FloatArray:
    """Return a sum of plane waves of any phase, (rows, columns), of variance 1.

    Wave vectors are normal: over many draws the covariance at the distance d is
    exp(-d^2 / (2 length_px^2)).
    """
    down, across = rng.normal(0.0, 1 / length_px, (2, _WAVES))
    phase = rng.uniform(0, 2 * math.pi, _WAVES)
    rows = np.exp(1j * (np.outer(np.arange(shape[0]), down) + phase))
    columns = np.exp(1j * np.outer(across, np.arange(shape[1])))
    found: FloatArray = math.sqrt(2 / _WAVES) * (rows @ columns).real
    return found
