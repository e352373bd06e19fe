"""What stands in front of a target, read at any focus and zoom from maps made once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import Float32Array, FloatArray, IntArray
from microplan.featuresel.routines.likelihood.appearance import ImagePose
from microplan.featuresel.routines.likelihood.spline import basis


@dataclass(frozen=True, slots=True, kw_only=True)
class Veiled:
    """What N pixels show: light + through x target alone."""

    light: FloatArray  # (N,)
    through: FloatArray  # (N,)
    light_slopes: FloatArray  # (2 + S, N) by the numbers of a `Veiling`
    through_slopes: FloatArray  # (2 + S, N)


@dataclass(frozen=True, slots=True, kw_only=True)
class Front:
    """What stands before the target at some focus heights, as maps of the region."""

    light: Float32Array  # (K + 2, rows, columns), a spline's coefficients
    through: Float32Array  # (K + 2, rows, columns)
    core_light: Float32Array  # (K + 2, rows, columns) what less blur changes them by
    core_through: Float32Array  # (K + 2, rows, columns)
    reach_um: (
        float  # the K heights are from -reach to reach off nominal, at equal steps
    )
    axis_px: tuple[float, float]  # column and row that zoom leaves alone
    # (S, rows, columns) what each sway changes them by; zoom and focus do not move them
    sway_light: Float32Array
    sway_through: Float32Array

    def at(self, pose: ImagePose, columns: IntArray, rows: IntArray) -> Veiled:
        """Return what pixels show, (N,), as the pose has it in front.

        A cubic spline through the heights, linear between pixels.
        """
        front = pose.veiling
        four, (value, by_focus) = self._heights(front.focus_um)
        seen, slopes = [], []
        cells = rows * self.light.shape[2] + columns
        places = self._places(pose.zoom, columns, rows)
        for maps, cores, occluder_modes in (
            (self.light, self.core_light, self.sway_light),
            (self.through, self.core_through, self.sway_through),
        ):
            near = places.read(maps[four])
            core = value @ places.read(cores[four])
            swayed = occluder_modes.reshape(
                len(occluder_modes), self.light[0].size
            ).take(cells, axis=1)
            shown = value @ near + front.core * core
            if front.occluder_modes:
                shown += np.array(front.occluder_modes, np.float32) @ swayed
            seen.append(shown)
            slopes.append(np.concatenate((np.stack((by_focus @ near, core)), swayed)))
        return Veiled(
            light=seen[0],
            through=seen[1],
            light_slopes=slopes[0],
            through_slopes=slopes[1],
        )

    def plain(
        self, pose: ImagePose, columns: IntArray, rows: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return light and share let through at pixels, (...), by focus alone."""
        four, (value, _) = self._heights(pose.veiling.focus_um)
        places = self._places(pose.zoom, columns, rows)
        light, through = (
            np.tensordot(value, places.read(m[four]), 1)
            for m in (self.light, self.through)
        )
        return light, through

    @property
    def steady(self) -> Front:
        """Return the same in its planned place, without sways."""
        none = self.sway_light[:0]
        return replace(self, sway_light=none, sway_through=none)

    def _heights(self, focus_um: float) -> tuple[slice, FloatArray]:
        """Return four coefficients and their weights, (2, 4): of value and slope."""
        count = len(self.light) - 2
        share = min(max(focus_um / self.reach_um, -1.0), 1.0)
        at = basis((share + 1) * (count - 1) / 2 + 1, count + 2)
        slopes = at.slopes * (count - 1) / 2 / self.reach_um
        return slice(at.first, at.first + 4), np.stack((at.weights, slopes))

    def clear(self, columns: IntArray, rows: IntArray) -> FloatArray:
        """Return the share let through at N pixels at nominal focus and zoom."""
        four, (value, _) = self._heights(0.0)
        return np.asarray(value @ self.through[four, rows, columns])

    def _places(self, zoom: float, columns: IntArray, rows: IntArray) -> _Places:
        """Return what the zoom shows in pixels, as places of the maps."""
        if zoom == 1.0:
            return _Places(left=columns, top=rows)
        return _Places.between(
            self.light.shape[1:],
            np.asarray(self.axis_px[0] + (columns - self.axis_px[0]) / zoom),
            np.asarray(self.axis_px[1] + (rows - self.axis_px[1]) / zoom),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Places:
    """Places of maps, (...): at pixels, or between four of them."""

    left: IntArray
    top: IntArray
    # shares of the way to the next column and row, 0..1; None: at pixels
    share: tuple[FloatArray, FloatArray] | None = None

    @classmethod
    def between(cls, shape: tuple[int, ...], x: FloatArray, y: FloatArray) -> _Places:
        """Return places that need not be at pixels; at the border, the border."""
        height, width = shape
        x = np.asarray(np.clip(x, 0, width - 1.001))
        y = np.asarray(np.clip(y, 0, height - 1.001))
        left, top = x.astype(np.intp), y.astype(np.intp)
        return cls(left=left, top=top, share=(x - left, y - top))

    def read(self, maps: Float32Array) -> FloatArray:
        """Return maps' values there, (maps, ...), between pixels linear."""
        if self.share is None:
            return np.asarray(maps[:, self.top, self.left], dtype=np.float64)
        # one place of all maps after the other: fewer of them are out of the cache
        flat = np.ascontiguousarray(maps.reshape(len(maps), -1).T)
        width = maps.shape[2]
        first = self.top * width + self.left
        u, v = (share[..., None] for share in self.share)
        above, below = (
            (1 - u) * flat.take(at, axis=0) + u * flat.take(at + 1, axis=0)
            for at in (first, first + width)
        )
        return np.moveaxis((1 - v) * above + v * below, -1, 0)
