"""Images of a look against what its target should look like, pixel by pixel."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import BoolArray, FloatArray, IntArray
from microplan.featuresel.routines.contract import CameraNoise
from microplan.featuresel.routines.likelihood.appearance import (
    Appearance,
    ImagePose,
    OccluderBlur,
)
from microplan.featuresel.routines.likelihood.foreground import Front
from microplan.featuresel.routines.likelihood.joint_blur import JointBlur

FEWEST = 40  # pixels
REJECT = 12.0  # deviations beyond which a pixel is not the target's
_SOME = 300  # pixels, enough to tell a wrong start
_LOOSE = 3.0  # times the spread, that focus and zoom are held to: images tell more
_IN_VIEW = 0.2  # of the cells, that a turn is judged by
_CLEAR = 0.02  # share of the target's light that must come through
# numbers of the pose: place, turn, focus, zoom, and two of the front; its occluder
# modes follow
POSE = 7
# of light, L: gain, its changes across and down, light all over, and how the response
# bends: what the square of the light adds
LIGHT = 5
# Standard deviations of light all over, of full scale, and of the bend: black levels
# and responses that nobody stated, stray light. They keep what cannot be told from gain
# at none.
_STRAY, _BEND = 0.1, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Free:
    """What the fit may change besides the position, and how far it is likely to."""

    turn: bool
    z_sigma_um: float  # 0: the focus is nominal
    zoom_sigma: float  # 0: the zoom is nominal
    gradient: bool  # whether the light may have one
    front_sigmas: tuple[float, float] | None  # of `OccluderBlur`; None: all is clear
    occluder_modes: int = 0  # of the occluder, S
    veiled: bool = False  # whether there may be light all over, and a bent response

    @property
    def numbers(self) -> int:
        """Return how many numbers a pose has, P: `POSE` and the occluder modes."""
        return POSE + self.occluder_modes

    @property
    def chosen(self) -> BoolArray:
        """Return True where a number of the pose or of light is free, (P + L,)."""
        z, zoom, front = self.z_sigma_um > 0, self.zoom_sigma > 0, self.front_sigmas
        pose = (True, True, self.turn, z, zoom, *2 * (front is not None,))
        light = (True, self.gradient, self.gradient, self.veiled, self.veiled)
        return np.array([*pose, *self.occluder_modes * (True,), *light])

    def precision(self, *, squared: bool) -> FloatArray:
        """Return the weights, (P + L,), that hold pose and light at nominal.

        One over variances, per px^2, rad^2 and so on; only so much that what cannot be
        seen stays nominal. Occluder modes are drawn by their standard deviations: they
        are many, and images hardly determine some of them.
        """
        weights, z = np.zeros(self.numbers + LIGHT), _LOOSE * self.z_sigma_um
        fronts = self.front_sigmas or (0.0, 0.0)
        sigmas = (z**2 if squared else z, self.zoom_sigma, *fronts)
        for k, sigma in enumerate(sigmas, start=3):
            if sigma > 0:
                weights[k] = 1 / (_LOOSE * sigma) ** 2
        weights[POSE : self.numbers] = 1.0
        weights[-2:] = 1 / _STRAY**2, 1 / _BEND**2
        return weights


@dataclass(frozen=True, slots=True, kw_only=True)
class DefocusedImage:
    """One image, taken `dz_um` off the focus that is to be found."""

    image: FloatArray  # (rows, columns), 0..1 of full scale
    dz_um: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageComparison:
    """Images of one target and everything they are compared with."""

    views: tuple[DefocusedImage, ...]  # of one size
    looks: Appearance
    front: Front | None
    camera: CameraNoise
    free: Free
    symmetry: int  # order of the pattern's
    joint: JointBlur | None = None  # what target and occluder hide together

    @property
    def shape(self) -> tuple[int, ...]:
        """Return (rows, columns) of the region."""
        return self.views[0].image.shape

    @property
    def squared(self) -> bool:
        """Return whether the square of the focus is fitted: its sign does not show."""
        return self.looks.is_even and len(self.views) == 1

    @property
    def held(self) -> ImageComparison:
        """Return the job with the occluder held at the target's focus.

        And where it is planned to be.
        """
        free = replace(self.free, front_sigmas=None, occluder_modes=0)
        front = None if self.front is None else self.front.planned
        return replace(self, free=free, front=front)

    @property
    def veiled(self) -> ImageComparison:
        """Return the job with a veil: light all over, and a bent response."""
        return replace(self, free=replace(self.free, veiled=True))

    @property
    def sides(self) -> tuple[int, ...]:
        """Return the signs of the focus that only the occluders determine."""
        return (1, -1) if self.squared and self.front is not None else (1,)

    def lit(
        self,
        pose: ImagePose,
        light: FloatArray,
        columns: IntArray,
        rows: IntArray,
        amounts: FloatArray,
    ) -> FloatArray:
        """Return a target's light at (N,) pixels by (L,) numbers of light, 0..1."""
        if self.front is not None:
            front, through = self.front.plain(pose, columns, rows)
            light = front + through * light
        light = _lit(light, _place(self, columns, rows))
        shown: FloatArray = np.tensordot(amounts, light, axes=1)
        return shown

    def focus(self, pose: ImagePose) -> float:
        """Return what is fitted for the focus: its height or, see above, the square."""
        return pose.z_um**2 if self.squared else pose.z_um


@dataclass(frozen=True, slots=True)
class PixelComparison:
    """What pixels show and what the model says they should."""

    value: FloatArray  # (N,) of the image
    target: FloatArray  # (L, N): light by each number of light
    slopes: FloatArray  # (P, N) by the pose, in even light
    place: FloatArray  # (2, N) across the region, -.5 to .5


def pixels_of(
    job: ImageComparison, pose: ImagePose
) -> tuple[tuple[IntArray, IntArray], ...]:
    """Return the pixels of each view, (N,) columns and rows, that fix the pose.

    They can be seen.
    """
    return tuple(_pixels(job, at(pose, view)) for view in job.views)


def at(pose: ImagePose, view: DefocusedImage) -> ImagePose:
    """Return the pose with the focus that a view has of it."""
    if view.dz_um == 0:
        return pose
    front = pose.front
    if front is not None:
        front = replace(front, focus_um=front.focus_um + view.dz_um)
    return replace(pose, z_um=pose.z_um + view.dz_um, front=front)


def see(
    job: ImageComparison,
    view: DefocusedImage,
    pose: ImagePose,
    pixels: tuple[IntArray, IntArray],
) -> PixelComparison:
    """Return (N,) pixels' values and the model's in one view, 0..1."""
    here, (columns, rows) = at(pose, view), pixels
    looks = job.looks.light(here, columns, rows)
    focus = looks.focus
    if job.looks.is_even and not job.squared:  # by the height, not by its square
        focus = 2 * here.z_um * focus
    slopes = np.zeros((job.free.numbers, len(columns)))
    for k, slope in enumerate(
        (looks.across, looks.down, looks.turn, focus, looks.grow)
    ):
        slopes[k] = slope
    mean = looks.value
    if job.front is not None:
        front = job.front.at(here, columns, rows)
        slopes[:5] *= front.through
        slopes[:2] += front.by_place
        slopes[5:] = front.light_slopes + front.through_slopes * mean
        mean = front.light + front.through * mean
    if job.joint is not None:
        both = job.joint.light(here, columns, rows, squared=job.squared)
        mean = mean + both.value
        slopes[:5] += (both.across, both.down, both.turn, both.focus, both.grow)
    place = _place(job, columns, rows)
    value = view.image[rows, columns]
    return PixelComparison(value, _lit(mean, place), slopes, place)


def fitted_light(value: FloatArray, target: FloatArray, free: Free) -> FloatArray:
    """Return the numbers of light, (L,) dimensionless, by plain least squares.

    Of (N,) values and (L, N) target values.
    """
    weight = np.ones((1, len(value)))
    light: FloatArray = _lights(value[None], target[None], weight, free)[0]
    return light


def misfits(
    job: ImageComparison,
    pose: ImagePose,
    turns: FloatArray,
    cells: IntArray,
) -> FloatArray:
    """Return chi squared a pixel at some rotations under the best light, by some cells.

    Infinite where nearly all of them are out of view. The target's light is the rough
    one of `microplan.featuresel.routines.likelihood.appearance.Appearance.turned`.

    Parameters
    ----------
    job : Job
        The images.
    pose : Pose
        Where the target is; its rotation does not matter.
    turns : (T,) float array
        Rotations from the template, rad.
    cells : (N,) int array
        Of the template.
    """
    values, targets, weights = [], [], []
    for view in job.views:
        here = at(pose, view)
        seen = job.looks.turned(here, turns, cells, job.shape, rough=True)
        mean = seen.value
        if job.front is not None:
            light, through = job.front.plain(here, seen.columns, seen.rows)
            mean = light + through * mean
        if job.joint is not None:
            mean = mean + job.joint.values(
                here, turns, seen.columns, seen.rows, squared=job.squared
            )
        values.append(view.image[seen.rows, seen.columns])
        targets.append(_lit(mean, _place(job, seen.columns, seen.rows)))
        weights.append(seen.inside.astype(np.float64))
    value, weight = np.concatenate(values, axis=1), np.concatenate(weights, axis=1)
    target = np.concatenate(targets, axis=2).transpose(1, 0, 2)
    light = _lights(value, target, weight, job.free)
    mean = np.maximum((light[:, None] @ target)[:, 0], job.camera.floor)
    left = np.minimum((value - mean) ** 2 / job.camera.variance(mean), REJECT**2)
    count = weight.sum(axis=1)
    found = (left * weight).sum(axis=1) / np.maximum(count, 1)
    return np.asarray(np.where(count < _IN_VIEW * value.shape[1], math.inf, found))


def try_each(
    job: ImageComparison,
    pose: ImagePose,
    *,
    turns: Sequence[float],
    depths: Sequence[float],
    zooms: Sequence[float],
) -> ImagePose:
    """Return the pose with the best rotation, focus and zoom, the first of equals."""
    best, least = pose, math.inf
    for z_um in depths:
        cells = job.looks.some_cells(z_um, _SOME)
        for zoom, side in itertools.product(zooms, job.sides):
            front = None if job.front is None else OccluderBlur(focus_um=side * z_um)
            here = replace(pose, z_um=z_um, zoom=zoom, front=front)
            found = misfits(job, here, np.array(turns), cells)
            k = int(np.argmin(found))
            if found[k] < least:
                best, least = replace(here, turn_rad=turns[k]), float(found[k])
    return best


def _lights(
    value: FloatArray, target: FloatArray, weight: FloatArray, free: Free
) -> FloatArray:
    """Return the numbers of light at each rotation, (T, L), by plain least squares."""
    pick = np.flatnonzero(free.chosen[-LIGHT:])
    rows = target[:, pick]
    weighted = rows * weight[:, None]
    normal = weighted @ rows.transpose(0, 2, 1)
    # so that black, and what is as bright all over, has a solution
    normal += 1e-12 * value.shape[1] * np.eye(len(pick))
    right = weighted @ value[:, :, None]
    light: FloatArray = np.zeros((len(value), LIGHT))
    light[:, pick] = np.linalg.solve(normal, right)[:, :, 0]
    return light


def _pixels(job: ImageComparison, pose: ImagePose) -> tuple[IntArray, IntArray]:
    """Return the pixels that determine the pose and can be seen."""
    columns, rows = job.looks.pixels(pose, job.shape)
    if job.front is None:
        return columns, rows
    clear = job.front.clear(columns, rows) > _CLEAR
    return columns[clear], rows[clear]


def _place(job: ImageComparison, columns: IntArray, rows: IntArray) -> FloatArray:
    """Return where pixels lie in the region, (2, ...), -.5 to .5."""
    height, width = job.shape
    return np.stack((columns / width - 0.5, rows / height - 0.5))


def _lit(mean: FloatArray, place: FloatArray) -> FloatArray:
    """Return (L, ...): the pixels' light by each number of light."""
    even, bent = np.ones_like(mean), mean**2
    return np.stack((mean, mean * place[0], mean * place[1], even, bent))
