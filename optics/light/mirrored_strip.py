"""Strip of a rounded edge that mirrors a ring of light into a lens.

Along the axis tilts of half the light's angle mirror it. A ray of the pupil at an angle
to the axis sees tilts half that angle off: the strip is as wide as all of them, and
fades to both sides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.light.lamps import RingLamp

_TILTS = 1000  # over the rounding: ends within a two-thousandth of the radius
_ACROSS = 48  # rays of a pupil's diameter: its share within .001
# of the largest share, half way up stairs of as many: blurred, they differ from it by
# less than a tenth of one
_STAIRS = (1 / 6, 1 / 2, 5 / 6)
# height of a rounding over its width: half to twice, as etched and ground edges may be;
# a sixth of the way between two, the light is off by less than .005 of a circle's
_STEEPNESS = tuple(2 ** (k / 6) for k in range(-6, 7))


@dataclass(frozen=True, slots=True, kw_only=True)
class MirroredStrip:
    """Nested bands, in radii of a rounding inwards from the drawn edge."""

    outer: tuple[float, ...]
    inner: tuple[float, ...]
    share: float  # of the pupil that each band fills with light of the ring

    @property
    def width(self) -> float:
        """Return how many radii of the rounding the widest band takes up."""
        return max(self.inner) - min(self.outer)


@lru_cache(maxsize=64)
def mirrored_strip(lamp: RingLamp, sine: float) -> MirroredStrip:
    """Return the strip of a quarter of a circle that a lens sees the ring in.

    Parameters
    ----------
    lamp : RingLamp
        The light.
    sine : float
        Of the half angle of the lens' cone: aperture over index.
    """
    inward, share = lit_share(lamp, sine)
    half = (inward[1] - inward[0]) / 2
    ends = [inward[share >= stair * share.max()][[0, -1]] for stair in _STAIRS]
    outer = tuple(max(float(first) - half, 0.0) for first, _ in ends)
    inner = tuple(min(float(last) + half, 1.0) for _, last in ends)
    total = float(share.sum()) * 2 * half
    share_each = total / (sum(inner) - sum(outer))
    return MirroredStrip(outer=outer, inner=inner, share=share_each)


@lru_cache(maxsize=64)
def light_range(lamp: RingLamp, sine: float) -> tuple[float, float]:
    """Return the least and the most light of a rounding that may be no circle.

    Roundings are quarters of ellipses half to twice as high as wide. A point of a tilt
    sends what a circle's point of that tilt does; an ellipse has it elsewhere, on more
    or less of its width. Light is as much more as a lens sees tilted surfaces larger
    than from straight above: by 4 % of the ends at an aperture of .42.

    Parameters
    ----------
    lamp : RingLamp
        The light.
    sine : float
        Of the half angle of the lens' cone: aperture over index.

    Returns
    -------
    least, most : float
        Over the light of a circle as wide, 0..1 and 1 or more.
    """
    _, share = lit_share(lamp, sine)
    across = 1 - np.arange(_TILTS + 1) / _TILTS  # sines of the tilts between points
    along = np.sqrt(1 - across**2)
    ends = (across / np.hypot(across, steep * along) for steep in _STEEPNESS)
    light = [float(-np.diff(end) @ share) for end in ends]
    usual = float(share.mean())
    if usual == 0:  # too narrow a ring for any point to see
        return 1.0, 1.0
    return min(light) / usual, max(light) / usual


def lit_share(lamp: RingLamp, sine: float) -> tuple[FloatArray, FloatArray]:
    """Return points of a rounding, and the pupil's share that sees the ring by them.

    Returns
    -------
    inward : (N,) float64 array
        From the drawn edge, in radii.
    share : (N,) float64 array
        0..1.
    """
    inward = (np.arange(_TILTS) + 0.5) / _TILTS
    part = (np.arange(_ACROSS) + 0.5) / _ACROSS * 2 - 1
    x, y = (sine * axis.ravel() for axis in np.meshgrid(part, part))
    inside = np.hypot(x, y) <= sine
    x, y = x[inside], y[inside]
    up = np.sqrt(1 - x**2 - y**2)
    across, along = 1 - inward[:, None], np.sqrt(1 - (1 - inward[:, None]) ** 2)
    facing = x * across + up * along
    mirrored = 2 * facing * along - up  # sine of the elevation it comes from
    lit = (facing > 0) & (mirrored >= math.sin(lamp.low_rad))
    lit &= mirrored <= math.sin(lamp.high_rad)
    return inward, lit.mean(axis=1)
