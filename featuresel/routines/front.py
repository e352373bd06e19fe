"""What stands in front of a target, read at any focus and zoom from maps made once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from featuresel.routines import FloatArray
from featuresel.routines.appearance import Pose

IntArray = npt.NDArray[np.intp]
Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class Veiled:
    """What pixels, (...), show: light + through x target alone."""

    light: FloatArray
    through: FloatArray
    light_slope: FloatArray  # by the focus of what stands in front, per um
    through_slope: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Front:
    """What stands before the target at some focus heights, as maps of the region."""

    light: Float32Array  # (K, rows, columns), K odd
    through: Float32Array  # (K, rows, columns)
    reach_um: float  # heights are from -reach to reach off nominal, at equal steps
    axis_px: tuple[float, float]  # column and row that zoom leaves alone

    def at(self, pose: Pose, columns: IntArray, rows: IntArray) -> Veiled:
        """Return what pixels show, at the focus and zoom that the pose has of it.

        A parabola through the nearest three heights, linear between pixels.
        """
        half, height_um = len(self.light) // 2, pose.seen_front_um
        place = min(max(height_um / self.reach_um, -1.0), 1.0) * half + half
        k = min(max(round(place), 1), 2 * half - 1)
        t = place - k
        weights = np.array([[t * (t - 1) / 2, 1 - t * t, t * (t + 1) / 2],
                            [t - 0.5, -2 * t, t + 0.5]])  # fmt: skip
        weights[1] *= half / self.reach_um
        three = slice(k - 1, k + 2)
        light, through = (
            np.tensordot(weights, self._read(m[three], pose.zoom, columns, rows), 1)
            for m in (self.light, self.through)
        )
        return Veiled(
            light=light[0],
            through=through[0],
            light_slope=light[1],
            through_slope=through[1],
        )

    def clear(self, columns: IntArray, rows: IntArray) -> FloatArray:
        """Return the share let through at nominal focus and zoom."""
        middle = self.through[len(self.through) // 2]
        return np.asarray(middle[rows, columns], dtype=np.float64)

    def _read(
        self, maps: Float32Array, zoom: float, columns: IntArray, rows: IntArray
    ) -> FloatArray:
        """Return maps' values, (maps, ...), at what the zoom shows in pixels."""
        if zoom == 1.0:
            return np.asarray(maps[:, rows, columns], dtype=np.float64)
        return _between(
            maps,
            np.asarray(self.axis_px[0] + (columns - self.axis_px[0]) / zoom),
            np.asarray(self.axis_px[1] + (rows - self.axis_px[1]) / zoom),
        )


def _between(maps: Float32Array, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return maps' values between pixels, linear; at the border, the border's."""
    height, width = maps.shape[1:]
    x = np.asarray(np.clip(x, 0, width - 1.001))
    y = np.asarray(np.clip(y, 0, height - 1.001))
    left, top = x.astype(np.intp), y.astype(np.intp)
    u, v = x - left, y - top
    above = (1 - u) * maps[:, top, left] + u * maps[:, top, left + 1]
    below = (1 - u) * maps[:, top + 1, left] + u * maps[:, top + 1, left + 1]
    return np.asarray((1 - v) * above + v * below)
