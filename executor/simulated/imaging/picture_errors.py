"""How real pictures differ from any image: along edges, over faces, pixel by pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from microplan.arrays import FloatArray

_WAVES = 96  # of a field: as good as normal
_SPAN = 4.0  # of wavelength over aperture: an edge not far out of focus lies within
_BASE_PX = 2.0  # that slopes are taken over
# Of wavelength over aperture: all of a line's light over its brightest, in focus
# (a round pupil's, in incoherent light: 1 over the integral of its transfer).
_LINE = 3 * math.pi / 16
_STRONG = 0.5  # of a picture's largest step: its usual edges are stronger


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureErrors:
    """Standard deviations of pictures about images, and the seed that they come from.

    One draw stays with all pictures of a region of one size at one setting of the lens:
    another look has another region, or setting.
    """

    edge: float  # of the step at an edge, in its middle
    flat: float  # of the light, smooth
    pixel: float  # white, of the picture's usual step
    seed: int

    def of(
        self, image: FloatArray, blur_px: float, setting: tuple[float, float]
    ) -> FloatArray:
        """Return what a picture shows besides its image, (rows, columns).

        Parameters
        ----------
        image : (rows, columns) float array
            Share of full scale, without noise.
        blur_px : float
            Wavelength over aperture, pixels.
        setting : (magnification, um)
            Zoom and focus, as they are commanded.

        Notes
        -----
        Light changes along an edge as if that lay a share of its width beside its
        place: by its slope there times that width, the step from the least to the most
        light over the steepest slope nearby. Both slopes are taken over two pixels,
        which makes sharp edges wider than the lens does; none is sharper than the lens.
        """
        words = [np.float64(value).view(np.uint64).item() for value in setting]
        rng = np.random.default_rng(
            np.random.SeedSequence([self.seed, *words, *image.shape])
        )
        longest_px = max(min(image.shape) / 2, blur_px)
        along_px = blur_px * (longest_px / blur_px) ** rng.uniform()
        steps = local_steps(image, blur_px)
        slope = slopes(image)
        steepest = most_near(slope, blur_px)
        wide = np.divide(steps, steepest, out=np.zeros_like(slope), where=steepest > 0)
        width_px = np.sqrt(np.maximum(wide**2 - _BASE_PX**2, (_LINE * blur_px) ** 2))
        found: FloatArray = self.edge * slope * width_px
        found *= waves(image.shape, along_px, rng)
        found += self.flat * image * waves(image.shape, longest_px, rng)
        usual = float(np.median(steps[steps >= _STRONG * steps.max()]))
        found += self.pixel * usual * rng.normal(size=image.shape)
        return found


def slopes(image: FloatArray) -> FloatArray:
    """Return lengths of gradients, (rows, columns) a pixel; 0 beyond the rim."""
    wide = np.pad(image, 1, mode="edge")
    found: FloatArray = np.hypot(
        wide[1:-1, 2:] - wide[1:-1, :-2], wide[2:, 1:-1] - wide[:-2, 1:-1]
    )
    return found / 2


def local_steps(image: FloatArray, blur_px: float) -> FloatArray:
    """Return the range of light about each pixel, as far as an edge reaches."""
    return most_near(image, blur_px) + most_near(-image, blur_px)


def most_near(values: FloatArray, blur_px: float) -> FloatArray:
    """Return the largest of values (rows, columns) as far as an edge reaches."""
    half = max(1, round(_SPAN * blur_px / 2))
    found = np.pad(values, half, mode="edge")
    for axis in (0, 1):
        found = sliding_window_view(found, 2 * half + 1, axis=axis).max(axis=-1)
    return found


def waves(
    shape: tuple[int, ...], length_px: float, rng: np.random.Generator
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
