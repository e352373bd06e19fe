"""Occluders of a target's light, read at any focus from maps made once.

Its position is known to some um and its angle may be any, while its blur is wide: what
it then changes is a sum of few images, the principal ones of its covariance. A fit that
frees their amounts learns from the image where the occluder really is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import Float32Array, FloatArray, IntArray
from microplan.featuresel.routines.contract import LookModel
from microplan.featuresel.routines.likelihood.appearance import ImagePose
from microplan.featuresel.routines.likelihood.spline import basis

_FAINTEST = 0.5  # of what noise makes of it in all pixels: less moves no answer as far
_OCCLUDER_MODES_MOST = 8
# Power by which changes of surfaces fade far off: half as far again 6e-5 is left, for
# a fit makes use of the faintest.
_FADING = 24


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeMaps:
    """Changes by one standard deviation each of independent amounts of mean 0."""

    light: FloatArray  # (S, rows, columns)
    through: FloatArray  # (S, rows, columns)


def mode_maps(model: LookModel, image: FloatArray) -> ModeMaps:
    """Return the changes by likely errors of the static scene, (S, rows, columns).

    In shares of full scale; none if they change nothing.

    Parameters
    ----------
    model : LookModel
        The look.
    image : (rows, columns) float array
        The nominal image.

    """
    changes = model.occluder_modes()
    if not changes:
        none = np.zeros((0, *image.shape))
        return ModeMaps(light=none, through=none)
    shown = np.stack([change.shown for change in changes])
    through = np.stack([change.through for change in changes])
    kept = principal(shown / np.sqrt(model.camera.variance(image)))
    through = np.tensordot(kept, through, 1)
    light = np.tensordot(kept, shown, 1) - through * model.alone()
    return ModeMaps(light=light, through=through)


def principal(changes: FloatArray) -> FloatArray:
    """Return the few sums of changes that matter, as weights of theirs.

    Parameters
    ----------
    changes : (C, rows, columns) float array
        Of an image over its pixels' noise, by one standard deviation each of C
        independent amounts.

    Returns
    -------
    (S, C) float64 array
        Rows of weights, the strongest first. The sums that they make are again of one
        standard deviation of S independent amounts: with D = U S V^T the covariance is
        D^T D, and row k of S V^T is U^T D (Karhunen and Loeve).
    """
    mix, strength, _ = np.linalg.svd(
        changes.reshape(len(changes), -1), full_matrices=False
    )
    kept = mix[:, :_OCCLUDER_MODES_MOST][
        :, strength[:_OCCLUDER_MODES_MOST] > _FAINTEST
    ].T
    largest = np.abs(kept).argmax(axis=1)[:, None]
    signed: FloatArray = kept * np.sign(np.take_along_axis(kept, largest, axis=1))
    return signed  # whose signs are free else


@dataclass(frozen=True, slots=True, kw_only=True)
class Veiled:
    """What N pixels show: light + through x target alone."""

    light: FloatArray  # (N,)
    through: FloatArray  # (N,)
    light_slopes: FloatArray  # (2 + S, N) by the numbers of a `OccluderBlur`
    through_slopes: FloatArray  # (2 + S, N)
    by_place: FloatArray  # (2, N) light by the target's place, per px


@dataclass(frozen=True, slots=True, kw_only=True)
class Front:
    """The target's occluder at some focus heights, as maps of the region."""

    light: Float32Array  # (K + 2, rows, columns), a spline's coefficients
    through: Float32Array  # (K + 2, rows, columns)
    core_light: Float32Array  # (K + 2, rows, columns) what less blur changes them by
    core_through: Float32Array  # (K + 2, rows, columns)
    reach_um: (
        float  # the K heights are from -reach to reach off nominal, at equal steps
    )
    axis_px: tuple[float, float]  # column and row that zoom leaves alone
    # (S, rows, columns) what each occluder mode changes them by; zoom and focus do not
    # move them
    mode_light: Float32Array
    mode_through: Float32Array
    # (M, 2, rows, columns) what the target's place, px right and down from nominal,
    # changes the light of the last M modes by: these are of surfaces
    mode_moved: Float32Array | None = None
    place_px: tuple[float, float] = (0.0, 0.0)  # column and row that is nominal
    far_px: float = 0.0  # beyond such a displacement the change is that of it

    def at(self, pose: ImagePose, columns: IntArray, rows: IntArray) -> Veiled:
        """Return what pixels show, (N,), as the pose has it in front.

        A cubic spline through the heights, linear between pixels.
        """
        front = pose.occluder_blur
        four, (value, by_focus) = self._heights(front.focus_um)
        seen, slopes = [], []
        cells = rows * self.light.shape[2] + columns
        places = self._places(pose.zoom, columns, rows)
        for maps, cores, occluder_modes in (
            (self.light, self.core_light, self.mode_light),
            (self.through, self.core_through, self.mode_through),
        ):
            near = places.read(maps[four])
            core = value @ places.read(cores[four])
            displaced = occluder_modes.reshape(
                len(occluder_modes), self.light[0].size
            ).take(cells, axis=1)
            if self.mode_moved is not None:
                displaced[-self.surfaces :] *= np.float32(self._known(pose))
            shown = value @ near + front.core * core
            if front.occluder_modes:
                shown += np.array(front.occluder_modes, np.float32) @ displaced
            seen.append(shown)
            slopes.append(
                np.concatenate((np.stack((by_focus @ near, core)), displaced))
            )
        by_place = np.zeros((2, len(cells)))
        if self.mode_moved is not None:
            moved = self.mode_moved.reshape(*self.mode_moved.shape[:2], -1)
            near = moved.take(cells, axis=2)
            off = np.subtract((pose.column, pose.row), self.place_px)
            more = np.tensordot(np.clip(off, -self.far_px, self.far_px), near, (0, 1))
            near, more = self._known(pose) * near, self._known(pose) * more
            slopes[0][-len(more) :] += more
            if front.occluder_modes:
                amounts = np.array(front.occluder_modes[-len(more) :])
                seen[0] = seen[0] + amounts @ more
                by_place = np.tensordot(amounts, near, 1)
        return Veiled(
            light=seen[0],
            through=seen[1],
            light_slopes=slopes[0],
            through_slopes=slopes[1],
            by_place=by_place,
        )

    def _known(self, pose: ImagePose) -> float:
        """Return the share of surfaces' changes that is believed at a place, 0..1.

        Far from where they were made a fit must not make use of them.
        """
        off = np.subtract((pose.column, pose.row), self.place_px)
        return float(min(1.0, self.far_px / max(np.hypot(*off), 1e-9)) ** _FADING)

    def plain(
        self, pose: ImagePose, columns: IntArray, rows: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return light and share let through at pixels, (...), by focus alone."""
        four, (value, _) = self._heights(pose.occluder_blur.focus_um)
        places = self._places(pose.zoom, columns, rows)
        light, through = (
            np.tensordot(value, places.read(m[four]), 1)
            for m in (self.light, self.through)
        )
        return light, through

    @property
    def surfaces(self) -> int:
        """Return how many of the modes are of surfaces, the last ones."""
        return 0 if self.mode_moved is None else len(self.mode_moved)

    @property
    def planned(self) -> Front:
        """Return the same in its planned place, without occluder modes."""
        none = self.mode_light[:0]
        return replace(self, mode_light=none, mode_through=none, mode_moved=None)

    def _heights(self, focus_um: float) -> tuple[slice, FloatArray]:
        """Return four coefficients and their weights, (2, 4): of value and slope."""
        count = len(self.light) - 2
        share = min(max(focus_um / self.reach_um, -1.0), 1.0)
        at = basis((share + 1) * (count - 1) / 2 + 1, count + 2)
        slopes = at.slopes * (count - 1) / 2 / self.reach_um
        return slice(at.first, at.first + 4), np.stack((at.weights, slopes))

    def clear(self, columns: IntArray, rows: IntArray) -> FloatArray:
        """Return the share let through at (N,) pixels at nominal focus and zoom."""
        four, (value, _) = self._heights(0.0)
        return np.asarray(value @ self.through[four, rows, columns])

    def _places(self, zoom: float, columns: IntArray, rows: IntArray) -> _Places:
        """Return what the zoom shows in pixels, as positions of the maps."""
        if zoom == 1.0:
            return _Places(left=columns, top=rows)
        return _Places.between(
            self.light.shape[1:],
            np.asarray(self.axis_px[0] + (columns - self.axis_px[0]) / zoom),
            np.asarray(self.axis_px[1] + (rows - self.axis_px[1]) / zoom),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Places:
    """Positions of maps, (...): at pixels, or between four of them."""

    left: IntArray
    top: IntArray
    # shares of the way to the next column and row, 0..1; None: at pixels
    share: tuple[FloatArray, FloatArray] | None = None

    @classmethod
    def between(cls, shape: tuple[int, ...], x: FloatArray, y: FloatArray) -> _Places:
        """Return positions that need not be at pixels; at the border, the border."""
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
