"""Appearance of a picture against the plan's reference: light, contrast, sharpness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray

# What an operator should see to, well before the gates notice: they pass half the
# light. The plan's trials vary the light by some percent.
REPORTED = 0.25
# A gear of 90 px across in a region of 300 x 300 has edges on .7 % of its pixels; some
# pixels must be left out, or the noise of one decides.
FEW = 2e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionStatistics:
    """Brightness, contrast and sharpness of a region, 0..1 of full scale."""

    brightness: float  # mean
    contrast: float  # darkest to brightest, `FEW` of the pixels left out on each side
    sharpness_per_px: float  # steepest edges over the contrast


@dataclass(frozen=True, slots=True, kw_only=True)
class Likeness:
    """A picture over the reference; None where the reference shows nothing."""

    brightness: float | None
    contrast: float | None
    sharpness: float | None
    words: tuple[str, ...]  # what differs by more than `REPORTED`


def appearance(image: FloatArray) -> RegionStatistics:
    """Return brightness, contrast and sharpness of (rows, columns), 0..1."""
    smooth = _smooth(image)  # noise of single pixels is no edge
    low, high = np.percentile(smooth, (100 * FEW, 100 * (1 - FEW)))
    steps = np.hypot(*np.gradient(smooth)) if min(image.shape) > 1 else np.zeros(1)
    contrast = float(high - low)
    steep = float(np.percentile(steps, 100 * (1 - FEW)))
    return RegionStatistics(
        brightness=float(image.mean()),
        contrast=contrast,
        sharpness_per_px=steep / contrast if contrast > 0 else 0.0,
    )


def likeness(found: RegionStatistics, reference: RegionStatistics) -> Likeness:
    """Return a picture's numbers over those of the reference, and what is amiss."""
    ratios = {
        "light": _ratio(found.brightness, reference.brightness),
        "contrast": _ratio(found.contrast, reference.contrast),
        "sharpness": _ratio(found.sharpness_per_px, reference.sharpness_per_px),
    }
    words = []
    for name, ratio in ratios.items():
        if ratio is not None and not 1 / (1 + REPORTED) <= ratio <= 1 + REPORTED:
            words.append(f"{name} is {ratio:.2f} of the reference's")
    return Likeness(
        brightness=ratios["light"],
        contrast=ratios["contrast"],
        sharpness=ratios["sharpness"],
        words=tuple(words),
    )


def _ratio(value: float, reference: float) -> float | None:
    return value / reference if reference > 0 else None


def _smooth(image: FloatArray) -> FloatArray:
    """Return means over 3 x 3 pixels, the border left as it is."""
    if min(image.shape) < 3:
        return image
    rows = image.shape[0] - 2
    columns = image.shape[1] - 2
    total = np.zeros((rows, columns))
    for i in range(3):
        for j in range(3):
            total += image[i : i + rows, j : j + columns]
    found = image.copy()
    found[1:-1, 1:-1] = total / 9
    return found
