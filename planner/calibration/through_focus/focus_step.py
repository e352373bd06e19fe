"""Mean profile of a part's edges at one focus reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class FocusStep:
    """Mean profile across a part's edges at one focus reading."""

    z_um: float  # reading
    profile: FloatArray  # (L,) light


def sharpest_um(steps: Sequence[FocusStep]) -> float:
    """Return the reading of the profile that is steepest for its contrast."""
    steep = [
        float(np.abs(np.diff(s.profile)).max() / max(np.ptp(s.profile), 1e-9))
        for s in steps
    ]
    return steps[int(np.argmax(steep))].z_um


def in_light_of(step: FocusStep, meant: FloatArray) -> tuple[FloatArray, float]:
    """Return an image's profile (L,) in the light of a step's, and its contrast [1].

    Light, contrast and place are those that suit best: they are not the blur.
    """
    design = np.column_stack([np.ones(len(meant)), meant, np.gradient(meant)])
    numbers = np.linalg.lstsq(design, step.profile, rcond=None)[0]
    return np.asarray(design @ numbers), float(numbers[1])
