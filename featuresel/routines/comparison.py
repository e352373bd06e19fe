"""Images of a look against what its target should look like, pixel by pixel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from featuresel.routines import Camera, FloatArray
from featuresel.routines.appearance import Appearance, Pose

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.intp]

FEWEST = 40  # pixels
REJECT = 12.0  # deviations beyond which a pixel is not the target's
_SOME = 300  # pixels, enough to tell a wrong start
_LOOSE = 3.0  # times the spread, that focus and zoom are held to: images tell more
_IN_VIEW = 0.2  # of the cells, that a turn is judged by
_CLEAR = 0.02  # share of the target's light that must come through


@dataclass(frozen=True, slots=True, kw_only=True)
class Front:
    """What stands before the target at some focus heights, as maps of the region."""

    light: FloatArray  # (K, rows, columns), K odd
    through: FloatArray  # (K, rows, columns)
    reach_um: float  # heights are from -reach to reach off nominal, at equal steps
    axis_px: tuple[float, float]  # column and row that zoom leaves alone

    def at(
        self, pose: Pose, columns: IntArray, rows: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return light and share let through at pixels, at the pose's focus and zoom.

        A parabola through the nearest three heights, linear between pixels.
        """
        half = len(self.light) // 2
        place = min(max(pose.z_um / self.reach_um, -1.0), 1.0) * half + half
        k = min(max(round(place), 1), 2 * half - 1)
        t = place - k
        weights = np.array([t * (t - 1) / 2, 1 - t * t, t * (t + 1) / 2])
        light: FloatArray = np.tensordot(weights, self.light[k - 1 : k + 2], axes=1)
        through: FloatArray = np.tensordot(weights, self.through[k - 1 : k + 2], axes=1)
        if pose.zoom == 1.0:
            return light[rows, columns], through[rows, columns]
        x = np.asarray((columns - self.axis_px[0]) / pose.zoom, dtype=np.float64)
        y = np.asarray((rows - self.axis_px[1]) / pose.zoom, dtype=np.float64)
        x, y = self.axis_px[0] + x, self.axis_px[1] + y
        return _between(light, x, y), _between(through, x, y)


@dataclass(frozen=True, slots=True, kw_only=True)
class Free:
    """What the fit may change besides the place, and how far it is likely to."""

    turn: bool
    z_sigma_um: float  # 0: the focus is nominal
    zoom_sigma: float  # 0: the zoom is nominal
    gradient: bool  # whether the light may have one

    @property
    def chosen(self) -> BoolArray:
        """Return which of column, row, turn, z, zoom, gain and gradients are free."""
        z, zoom = self.z_sigma_um > 0, self.zoom_sigma > 0
        return np.array(
            [True, True, self.turn, z, zoom, True, self.gradient, self.gradient]
        )

    def precision(self, *, squared: bool) -> FloatArray:
        """Return the weights that draw focus (or its square) and zoom to nominal, (8,).

        Only so much that what cannot be seen stays nominal.
        """
        weights, z = np.zeros(8), _LOOSE * self.z_sigma_um
        for k, sigma in ((3, z**2 if squared else z), (4, self.zoom_sigma)):
            if sigma > 0:
                weights[k] = 1 / (_LOOSE * sigma) ** 2
        return weights


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """One image, taken `dz_um` off the focus that is to be found."""

    image: FloatArray  # (rows, columns), 0..1 of full scale
    dz_um: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """Images of one target and everything they are compared with."""

    views: tuple[View, ...]  # of one size
    looks: Appearance
    front: Front | None
    camera: Camera
    free: Free

    @property
    def shape(self) -> tuple[int, ...]:
        """Return (rows, columns) of the region."""
        return self.views[0].image.shape

    @property
    def squared(self) -> bool:
        """Return whether the square of the focus is fitted: its sign does not show."""
        return self.looks.is_even and len(self.views) == 1

    def focus(self, pose: Pose) -> float:
        """Return what is fitted for the focus: its height or, see above, the square."""
        return pose.z_um**2 if self.squared else pose.z_um


@dataclass(frozen=True, slots=True)
class Seen:
    """What pixels show and what the model says they should."""

    value: FloatArray  # (N,) of the image
    target: FloatArray  # (N, 3): light by gain, and by gradients
    slopes: FloatArray  # (N, 5) by the pose, in even light
    place: FloatArray  # (N, 2) across the region, -.5 to .5


def pixels_of(job: Job, pose: Pose) -> tuple[tuple[IntArray, IntArray], ...]:
    """Return for each view (columns, rows) that tell the pose and can be seen."""
    return tuple(_pixels(job, at(pose, view)) for view in job.views)


def at(pose: Pose, view: View) -> Pose:
    """Return the pose with the focus that a view has of it."""
    return pose if view.dz_um == 0 else replace(pose, z_um=pose.z_um + view.dz_um)


def see(job: Job, view: View, pose: Pose, pixels: tuple[IntArray, IntArray]) -> Seen:
    """Return the pixels' values and the model's in one view."""
    here, (columns, rows) = at(pose, view), pixels
    looks = job.looks.light(here, columns, rows)
    focus = looks.focus
    if job.looks.is_even and not job.squared:  # by the height, not by its square
        focus = 2 * here.z_um * focus
    slopes = np.stack((looks.across, looks.down, looks.turn, focus, looks.grow), axis=1)
    mean = looks.value
    if job.front is not None:
        light, through = job.front.at(here, columns, rows)
        mean, slopes = light + through * mean, through[:, None] * slopes
    place = _place(job, columns, rows)
    value = view.image[rows, columns]
    return Seen(value, _lit(mean, place), slopes, place)


def fitted_light(value: FloatArray, target: FloatArray, free: Free) -> FloatArray:
    """Return gain and gradients, (3,), by plain least squares."""
    columns = target if free.gradient else target[:, :1]
    normal = columns.T @ columns
    # so little more that a black image has a solution
    normal.flat[:: len(normal) + 1] += 1e-12 * len(value)
    light: FloatArray = np.zeros(3)
    light[: len(normal)] = np.linalg.solve(normal, columns.T @ value)
    return light


def misfits(
    job: Job, pose: Pose, turns: FloatArray, cells: IntArray | None = None
) -> FloatArray:
    """Return chi squared a pixel at some turns under the best light, of some cells.

    Infinite where nearly all of them are out of view.
    """
    if cells is None:
        cells = job.looks.some_cells(pose.z_um, _SOME)
    values, targets, weights = [], [], []
    for view in job.views:
        here = at(pose, view)
        seen = job.looks.turned(here, turns, cells, job.shape)
        mean = seen.value
        if job.front is not None:
            light, through = job.front.at(here, seen.columns, seen.rows)
            mean = light + through * mean
        values.append(view.image[seen.rows, seen.columns])
        targets.append(_lit(mean, _place(job, seen.columns, seen.rows)))
        weights.append(seen.inside.astype(np.float64))
    value, weight = np.concatenate(values, axis=1), np.concatenate(weights, axis=1)
    target = np.concatenate(targets, axis=1)
    light = _lights(value, target, weight, job.free)
    mean = np.einsum("tnk,tk->tn", target, light)
    left = np.minimum((value - mean) ** 2 / job.camera.variance(mean), REJECT**2)
    count = weight.sum(axis=1)
    found = (left * weight).sum(axis=1) / np.maximum(count, 1)
    return np.asarray(np.where(count < _IN_VIEW * value.shape[1], math.inf, found))


def try_each(
    job: Job,
    pose: Pose,
    *,
    turns: Sequence[float],
    depths: Sequence[float],
    zooms: Sequence[float],
) -> Pose:
    """Return the pose with the turn, focus and zoom that fit best, first of equals."""
    best, least = pose, math.inf
    for z_um in depths:
        cells = job.looks.some_cells(z_um, _SOME)
        for zoom in zooms:
            here = replace(pose, z_um=z_um, zoom=zoom)
            found = misfits(job, here, np.array(turns), cells)
            k = int(np.argmin(found))
            if found[k] < least:
                best, least = replace(here, turn_rad=turns[k]), float(found[k])
    return best


def _lights(
    value: FloatArray, target: FloatArray, weight: FloatArray, free: Free
) -> FloatArray:
    """Return gain and gradients at each turn, (T, 3), by plain least squares."""
    columns = target if free.gradient else target[:, :, :1]
    weighted = columns * weight[:, :, None]
    normal = np.einsum("tnj,tnk->tjk", weighted, columns)
    size = normal.shape[1]
    normal += 1e-12 * value.shape[1] * np.eye(size)  # so that black has a solution
    right = np.einsum("tnj,tn->tj", weighted, value)
    light: FloatArray = np.zeros((len(value), 3))
    light[:, :size] = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
    return light


def _pixels(job: Job, pose: Pose) -> tuple[IntArray, IntArray]:
    """Return the pixels that tell the pose and can be seen."""
    columns, rows = job.looks.pixels(pose, job.shape)
    if job.front is None:
        return columns, rows
    middle = len(job.front.through) // 2
    clear = job.front.through[middle, rows, columns] > _CLEAR
    return columns[clear], rows[clear]


def _place(job: Job, columns: IntArray, rows: IntArray) -> FloatArray:
    """Return where pixels lie in the region, (..., 2), -.5 to .5."""
    height, width = job.shape
    return np.stack((columns / width - 0.5, rows / height - 0.5), axis=-1)


def _lit(mean: FloatArray, place: FloatArray) -> FloatArray:
    """Return (..., 3): the pixels' light by gain, and by gradients."""
    return np.stack((mean, mean * place[..., 0], mean * place[..., 1]), axis=-1)


def _between(values: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return a map's values between its pixels, linear; at the border, the border's."""
    height, width = values.shape
    x = np.asarray(np.clip(x, 0, width - 1.001), dtype=np.float64)
    y = np.asarray(np.clip(y, 0, height - 1.001), dtype=np.float64)
    left, top = x.astype(np.intp), y.astype(np.intp)
    u, v = x - left, y - top
    above = (1 - u) * values[top, left] + u * values[top, left + 1]
    below = (1 - u) * values[top + 1, left] + u * values[top + 1, left + 1]
    mean: FloatArray = (1 - v) * above + v * below
    return mean
