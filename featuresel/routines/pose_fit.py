"""The pose, focus, zoom and light under which a target's image is the most likely."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from featuresel.routines import Camera, Failure, FloatArray
from featuresel.routines.appearance import Appearance, Light, Pose
from featuresel.routines.sampling import median

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.intp]

_ROUNDS = 20  # of Gauss-Newton; it settles in 3 to 8
_SETTLED = 1e-3  # squared length of a step in standard deviations: nothing is gained
_FAR_PX = 1.5  # the most that one step may move the image
_FAR_DEPTHS = 1.0  # the most that one step may change the focus, steps of the planes
_AGAIN_PX = 0.5  # a move after which the pixels are chosen anew
_REJECT = 8.0  # robust deviations beyond which a pixel is not the target's
_FULL = 0.99  # of full scale, where the camera may have clipped
_FEWEST = 40  # pixels
_SOME = 400  # pixels, enough to tell a wrong start
_LOOSE = 3.0  # times the spread, that focus and zoom are held to: images tell more
_CLEAR = 0.02  # share of the target's light that must come through


@dataclass(frozen=True, slots=True, kw_only=True)
class Front:
    """What stands before the target at three focus heights, as maps of the region."""

    light: FloatArray  # (3, rows, columns)
    through: FloatArray  # (3, rows, columns)
    reach_um: float  # heights are -reach, 0 and reach off nominal

    def at(
        self, z_um: float, columns: IntArray, rows: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return light and share let through at pixels, a parabola over the focus."""
        t = min(max(z_um / self.reach_um, -1.0), 1.0)
        weights = np.array([t * (t - 1) / 2, 1 - t * t, t * (t + 1) / 2])
        return (
            np.tensordot(weights, self.light[:, rows, columns], axes=1),
            np.tensordot(weights, self.through[:, rows, columns], axes=1),
        )


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

    def precision(self, looks: Appearance) -> FloatArray:
        """Return the weights that draw focus and zoom to nominal, (8,).

        Only so much that what cannot be seen stays nominal.
        """
        weights, z = np.zeros(8), _LOOSE * self.z_sigma_um
        for k, sigma in ((3, z**2 if looks.is_even else z), (4, self.zoom_sigma)):
            if sigma > 0:
                weights[k] = 1 / (_LOOSE * sigma) ** 2
        return weights


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseFit:
    """What fits best."""

    pose: Pose
    light: tuple[float, float, float]  # gain, and its changes across and down
    covariance: FloatArray  # (8, 8) of column, row, turn, focus, zoom and light; where
    # both sides of focus look alike, of its square
    is_even: bool
    chi2: float  # of the pixels used, each: 1 if only noise is left
    used: float  # share of the pixels that are the target's
    pixels: int

    @property
    def sigma(self) -> FloatArray:
        """Return standard deviations of column, row, turn, z and zoom, (5,).

        What the model leaves unexplained counts as more noise.
        """
        sigma = np.sqrt(np.diag(self.covariance)[:5] * max(1.0, self.chi2))
        if self.is_even:  # of the square: about focus its root spreads as the root
            off_um = abs(self.pose.z_um)
            sigma[3] = sigma[3] / max(2 * off_um, math.sqrt(sigma[3]), 1e-12)
        return sigma


@dataclass(frozen=True, slots=True)
class Job:
    """An image and everything it is compared with."""

    image: FloatArray
    looks: Appearance
    front: Front | None
    camera: Camera
    free: Free


def fit_pose(job: Job, start: Pose) -> PoseFit | Failure:
    """Return the likeliest pose near `start`, by weighted Gauss-Newton steps.

    Pixels weigh by the noise that the model predicts, and those that are far off what
    most pixels are do not count (Tukey's weights).

    References
    ----------
    Baker & Matthews (2004), forwards additive; Beaton & Tukey (1974).
    """
    state = _State(pose=start, light=None)
    chosen = _pixels(job, start)
    last = start
    for _ in range(_ROUNDS):
        if _moved(last, state.pose) > _AGAIN_PX or _refocused(job, last, state.pose):
            chosen, last = _pixels(job, state.pose), state.pose
        if len(chosen[0]) < _FEWEST:
            return Failure(code="outside", message=f"{len(chosen[0])} pixels in view")
        step = _step(job, state, chosen)
        if isinstance(step, Failure):
            return step
        state = step.after
        if step.length < _SETTLED:
            return step.result(state)
    return Failure(code="diverged", message=f"not settled after {_ROUNDS} rounds")


def misfit(job: Job, pose: Pose) -> float:
    """Return chi squared a pixel at a pose under the best light, on few pixels."""
    columns, rows = job.looks.some_pixels(pose, job.image.shape, _SOME)
    if len(columns) < _FEWEST:
        return math.inf
    seen = _seen(job, pose, columns, rows)
    light = _fitted_light(seen, job.free.gradient)
    mean = seen.target @ light
    left = (seen.value - mean) ** 2 / job.camera.variance(mean)
    return float(np.minimum(left, _REJECT**2).mean())


@dataclass(frozen=True, slots=True)
class _State:
    """Where the fit stands."""

    pose: Pose
    light: FloatArray | None  # gain and gradients; None before the first step


@dataclass(frozen=True, slots=True)
class _Seen:
    """What pixels show and what the model says they should under even light."""

    value: FloatArray  # (N,) of the image
    target: FloatArray  # (N, 3): light by gain, and by gradients
    slopes: FloatArray  # (N, 5) by the pose, in even light
    place: FloatArray  # (N, 2) across the region, -.5 to .5


@dataclass(frozen=True, slots=True)
class _Step:
    """One step of Gauss-Newton."""

    after: _State
    length: float  # squared, in standard deviations
    normal: FloatArray  # (8, 8)
    chosen: BoolArray
    is_even: bool
    chi2: float
    used: float
    pixels: int

    def result(self, state: _State) -> PoseFit:
        """Return the fit that ends here."""
        pick = np.flatnonzero(self.chosen)
        covariance = np.zeros((8, 8))
        covariance[np.ix_(pick, pick)] = np.linalg.pinv(self.normal[np.ix_(pick, pick)])
        light = np.zeros(3) if state.light is None else state.light
        return PoseFit(
            pose=state.pose,
            light=(float(light[0]), float(light[1]), float(light[2])),
            covariance=covariance,
            is_even=self.is_even,
            chi2=self.chi2,
            used=self.used,
            pixels=self.pixels,
        )


def _pixels(job: Job, pose: Pose) -> tuple[IntArray, IntArray]:
    """Return the pixels that tell the pose and can be seen."""
    columns, rows = job.looks.pixels(pose, job.image.shape)
    if job.front is None:
        return columns, rows
    clear = job.front.through[1, rows, columns] > _CLEAR
    return columns[clear], rows[clear]


def _seen(job: Job, pose: Pose, columns: IntArray, rows: IntArray) -> _Seen:
    """Return the pixels' values and the model's."""
    looks: Light = job.looks.light(pose, columns, rows)
    slopes = np.stack(
        (looks.across, looks.down, looks.turn, looks.focus, looks.grow), axis=1
    )
    mean = looks.value
    if job.front is not None:
        light, through = job.front.at(pose.z_um, columns, rows)
        mean, slopes = light + through * mean, through[:, None] * slopes
    height, width = job.image.shape
    place = np.stack((columns / width - 0.5, rows / height - 0.5), axis=1)
    target = np.concatenate((mean[:, None], mean[:, None] * place), axis=1)
    return _Seen(job.image[rows, columns], target, slopes, place)


def _fitted_light(seen: _Seen, gradient: bool) -> FloatArray:  # noqa: FBT001
    """Return the light by plain least squares."""
    columns = seen.target if gradient else seen.target[:, :1]
    solved = np.linalg.lstsq(columns, seen.value)[0]
    light: FloatArray = np.zeros(3)
    light[: len(solved)] = solved
    return light


def _step(
    job: Job, state: _State, pixels: tuple[IntArray, IntArray]
) -> _Step | Failure:
    """Return the next state from the present one."""
    seen = _seen(job, state.pose, *pixels)
    light = state.light
    if light is None:
        light = _fitted_light(seen, job.free.gradient)
    lit = light[0] + seen.place @ light[1:]
    mean = seen.target @ light
    if not (np.isfinite(light).all() and light[0] > 0):
        return Failure(code="no_contrast", message="no light fits the image")
    noise = np.sqrt(job.camera.variance(mean))
    residual = (seen.value - mean) / noise
    scale = max(1.0, 1.4826 * median(np.abs(residual)))
    ratio = residual / (_REJECT * scale)
    trusted = (np.abs(ratio) < 1) & (seen.value < _FULL) & (mean < _FULL)
    if trusted.sum() < _FEWEST:
        return Failure(code="misfit", message=f"{int(trusted.sum())} pixels fit")
    weight = np.where(trusted, (1 - ratio**2) ** 2, 0.0)
    design = np.concatenate((seen.slopes * lit[:, None], seen.target), axis=1)
    design /= noise[:, None]
    chosen, pull = job.free.chosen, job.free.precision(job.looks)
    normal = (design * weight[:, None]).T @ design + np.diag(pull)
    right = design.T @ (weight * residual)
    right[3] += pull[3] * -_focus(job, state.pose)
    right[4] += pull[4] * (1 - state.pose.zoom)
    pick = np.flatnonzero(chosen)
    part = normal[np.ix_(pick, pick)]
    move = np.zeros(8)
    try:
        move[pick] = np.linalg.solve(part, right[pick])
    except np.linalg.LinAlgError:
        return Failure(code="no_contrast", message="the image does not tell the pose")
    move *= _shortened(job, state.pose, move)
    after = _after(job, state.pose, move)
    move[3] = _focus(job, after) - _focus(job, state.pose)
    return _Step(
        after=_State(pose=after, light=light + move[5:]),
        length=float(move @ normal @ move),
        normal=normal,
        chosen=chosen,
        is_even=job.looks.is_even,
        chi2=float((residual[trusted] ** 2).mean()),
        used=float(trusted.mean()),
        pixels=len(residual),
    )


def _focus(job: Job, pose: Pose) -> float:
    """Return what is fitted for the focus: its square where both sides look alike."""
    return pose.z_um**2 if job.looks.is_even else pose.z_um


def _shortened(job: Job, pose: Pose, move: FloatArray) -> float:
    """Return what a step is cut to: farther, the slopes no longer hold."""
    size = max(job.looks.shape) / 2 / job.looks.over
    far = max(math.hypot(move[0], move[1]), abs(move[2]) * size, abs(move[4]) * size)
    most = _FAR_DEPTHS * job.looks.step_um
    if job.looks.is_even:
        most *= 2 * abs(pose.z_um) + most
    deep = abs(move[3]) / most
    return float(1 / max(1.0, far / _FAR_PX, deep))


def _after(job: Job, pose: Pose, move: FloatArray) -> Pose:
    """Return the pose after a step; focus stays where planes are."""
    reach = job.looks.reach_um
    if job.looks.is_even:
        z_um = math.sqrt(max(pose.z_um**2 + float(move[3]), 0.0))
    else:
        z_um = pose.z_um + float(move[3])
    return Pose(
        column=pose.column + float(move[0]),
        row=pose.row + float(move[1]),
        turn_rad=pose.turn_rad + float(move[2]),
        z_um=min(max(z_um, -reach), reach),
        zoom=min(max(pose.zoom + float(move[4]), 0.8), 1.25),
    )


def _moved(one: Pose, other: Pose) -> float:
    return math.hypot(one.column - other.column, one.row - other.row)


def _refocused(job: Job, one: Pose, other: Pose) -> bool:
    """Return whether other pixels tell most at the new focus."""
    return abs(one.z_um - other.z_um) > job.looks.step_um


def try_each(job: Job, poses: Sequence[Pose]) -> Pose:
    """Return the pose that fits best of some, the first of equals."""
    found = [misfit(job, pose) for pose in poses]
    return poses[int(np.argmin(found))]
