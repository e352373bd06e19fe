"""Occluders of a target's light, read at any focus from maps made once.

Its position is known to some um and its angle may be any, while its blur is wide: what
it then changes is a sum of few images, the principal ones of its covariance. A fit that
frees their amounts learns from the image where the occluder really is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import Float32Array, FloatArray, IntArray
from microplan.featuresel.routines.contract import LookModel, Occluders, Target
from microplan.featuresel.routines.likelihood.appearance import ImagePose
from microplan.featuresel.routines.likelihood.spline import basis

_DEPTHS = 2.0  # wave depths of field between heights: what is in front is blurred
_MOST = 9  # heights: each takes a dozen images
_MOVED_PX = 1.5  # displacements that the light is compared at
_FAR = 0.5  # of the search, along both axes
_SAME = 0.002  # of full scale: an image that differs less from the target alone is it
# Of the distance to the occluder: there a tenth of its light seems to come from, by
# the exact law at an aperture of .42 against Hopkins'; .2 to .3 serve equally well.
_CORE = 0.3
_FLAT = 1e-3  # per px: what is no steeper has no edge
_DOUBT = 0.02  # of full scale: where the target varies less, the occluder decides


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontMaps:
    """Image = light + through x target alone, pixel by pixel, at some focus heights."""

    light: FloatArray  # (K, rows, columns), K odd
    through: FloatArray  # (K, rows, columns)
    core_light: FloatArray  # (K, rows, columns) what less blur of it changes them by
    core_through: FloatArray  # (K, rows, columns)


def front_maps(
    model: LookModel, target: Target, image: FloatArray, reach_um: float
) -> FrontMaps | None:
    """Return how a look differs from its target alone; None if it does not.

    Parameters
    ----------
    model : LookModel
        The look.
    target : Target
        What is to be found.
    image : (rows, columns) float array
        The nominal image.
    reach_um : float
        Heights are at equal steps from -reach to reach off nominal focus.

    Notes
    -----
    A line through what each pixel shows against the target alone, at nine positions of
    the target, near nominal and as far as it is sought: what covers or shades it, what
    is seen next to it, and what shades what. The slope is that of `LookModel.occluders`
    where the target's light hardly varies.
    """
    if float(np.abs(image - np.clip(model.alone(), 0, 1)).max()) < _SAME:
        return None
    count = 2 * math.ceil(reach_um / (_DEPTHS * model.blur.depth_um)) + 1
    heights = np.linspace(-reach_um, reach_um, min(count, _MOST))
    found = [_at_height(model, target, float(dz)) for dz in heights]
    cores = _cores(model, target, heights)
    return FrontMaps(
        light=np.stack([light for light, _ in found]),
        through=np.stack([through for _, through in found]),
        core_light=np.stack([core.light for core in cores]),
        core_through=np.stack([core.through for core in cores]),
    )


def _cores(model: LookModel, target: Target, heights: FloatArray) -> list[Occluders]:
    """Return what less blur of the occluder changes, at some focus heights."""
    near_um = _CORE * _height_um(model, target)
    found = []
    for dz in heights.tolist():
        seen, core = model.occluders(dz), model.occluders(dz + near_um)
        change = Occluders(
            light=core.light - seen.light, through=core.through - seen.through
        )
        found.append(change)
    return found


def _height_um(model: LookModel, target: Target) -> float:
    """Return how far above nominal focus the edges of the occluder are.

    An edge blurred to a disc of radius R is nowhere steeper than 2 / (pi R).
    """
    step_um = model.blur.depth_um
    below, here, above = (
        max(float(np.abs(g).max()) for g in np.gradient(model.occluders(dz).through))
        for dz in (-step_um, 0.0, step_um)
    )
    if here < _FLAT:
        return 0.0
    height_um = 2 / (math.pi * here * model.blur.cone * target.px_per_um)
    return math.copysign(height_um, above - below)


def _at_height(
    model: LookModel, target: Target, dz_um: float
) -> tuple[FloatArray, FloatArray]:
    """Return light and share let through at one focus height."""
    near = _MOVED_PX / target.px_per_um
    far = max(_FAR * target.search_px, _MOVED_PX) / target.px_per_um
    moves = [(0.0, 0.0), (near, 0.0), (-near, 0.0), (0.0, near), (0.0, -near)]
    moves += [(far, far), (-far, far), (far, -far), (-far, -far)]
    alone = np.stack([model.alone(dx_um=x, dy_um=y, dz_um=dz_um) for x, y in moves])
    seen = np.stack([model(dx_um=x, dy_um=y, dz_um=dz_um) for x, y in moves])
    assumed = model.occluders(dz_um).through
    off, shown = alone - alone.mean(axis=0), seen - seen.mean(axis=0)
    doubt = len(moves) * _DOUBT**2
    slope = (off * shown).sum(axis=0) + doubt * assumed
    through: FloatArray = slope / ((off**2).sum(axis=0) + doubt)
    light: FloatArray = seen.mean(axis=0) - through * alone.mean(axis=0)
    return light, through


_FAINTEST = 0.5  # of what noise makes of it in all pixels: less moves no answer as far
_OCCLUDER_MODES_MOST = 8


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
            shown = value @ near + front.core * core
            if front.occluder_modes:
                shown += np.array(front.occluder_modes, np.float32) @ displaced
            seen.append(shown)
            slopes.append(
                np.concatenate((np.stack((by_focus @ near, core)), displaced))
            )
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
        four, (value, _) = self._heights(pose.occluder_blur.focus_um)
        places = self._places(pose.zoom, columns, rows)
        light, through = (
            np.tensordot(value, places.read(m[four]), 1)
            for m in (self.light, self.through)
        )
        return light, through

    @property
    def planned(self) -> Front:
        """Return the same in its planned place, without occluder modes."""
        none = self.mode_light[:0]
        return replace(self, mode_light=none, mode_through=none)

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
