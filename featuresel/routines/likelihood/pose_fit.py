"""The pose, focus, zoom and light under which images of a target are the likeliest."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import BoolArray, FloatArray, IntArray
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.likelihood.appearance import (
    AGAIN_PX,
    ImagePose,
    OccluderBlur,
)
from microplan.featuresel.routines.likelihood.comparison import (
    FEWEST,
    POSE,
    REJECT,
    ImageComparison,
    PixelComparison,
    fitted_light,
    pixels_of,
    see,
)
from microplan.featuresel.routines.likelihood.fit_quality import (
    FitQuality,
    quality,
    usual_size,
)

_ROUNDS = 30  # of Gauss-Newton; it settles in 2 to 8, far out of focus in more
_SETTLED = 0.05  # squared length of the next step, in standard deviations, over chi^2
_NEARLY = 100.0  # and of this one: farther off nothing is known of the next
_FAR_PX = 1.5  # the most that one step may move the image
_FAR_DEPTHS = 1.0  # the most that one step may change the focus, steps of the planes
_FULL = 0.99  # of full scale, where the camera may have clipped
_MOST_CORE = 0.3  # beyond, it would stand for another focus of the occluder
_MOST_MODE = 5.0  # standard deviations: what lies farther off was not planned for
_SURFACE_ROUNDS = 2  # amounts and light multiply each other
_ZOOMS = (0.8, 1.25)  # beyond, nothing that starts near nominal gets


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseFit:
    """What fits best."""

    pose: ImagePose
    light: FloatArray  # (3,) gain, and its changes across and down the region
    covariance: FloatArray  # (P + 3, P + 3) of the pose's P numbers and of light
    squared: bool  # the covariance is of the square of the focus
    quality: FitQuality
    pixels: int

    @property
    def z_um(self) -> float:
        """Return the focus, with the sign that the occluder has, if any."""
        pose = self.pose
        if not self.squared or pose.front is None:
            return pose.z_um
        return math.copysign(pose.z_um, pose.front.focus_um)

    @property
    def sigma(self) -> FloatArray:
        """Return standard deviations of column, row, rotation, z and zoom, (5,).

        What the model leaves unexplained counts as more noise.
        """
        sigma = np.sqrt(np.diag(self.covariance)[:5] * max(1.0, self.quality.chi2))
        if self.squared:  # about focus its root spreads as the root
            off_um = abs(self.pose.z_um)
            sigma[3] = sigma[3] / max(2 * off_um, math.sqrt(sigma[3]), 1e-12)
        return np.asarray(sigma)


def fit_pose(job: ImageComparison, start: ImagePose) -> PoseFit | Failure:
    """Return the likeliest pose near `start`, by weighted Gauss-Newton steps.

    Pixels weigh by the noise that the model predicts, and those that are far off what
    most pixels are do not count (Tukey's weights).

    References
    ----------
    Baker & Matthews (2004), forwards additive; Beaton & Tukey (1974).
    """
    pose, light, depths, before = start, None, _FAR_DEPTHS, 0.0
    shorter = math.inf
    chosen, last = pixels_of(job, start), start
    for _ in range(_ROUNDS):
        if _is_elsewhere(job, last, pose):
            chosen, last = pixels_of(job, pose), pose
        linear = _linear(job, pose, light, chosen)
        if isinstance(linear, Failure):
            return linear
        step = linear.move(job, pose, depths)
        if step is None:
            return Failure("no_contrast", "the image tells no pose")
        move, share = step
        if move[3] * before < 0:  # about focus slopes vanish, and steps go to and fro
            depths /= 2
        before = float(move[3])
        pose, light = _after(job, pose, move), linear.light + move[-3:]
        length = float(move @ linear.normal @ move)
        if depths == _FAR_DEPTHS:  # a step that is short because it was cut is long
            length /= share**2
        # steps shrink by squares at the end: the next one over this is, squared too,
        # this one over the last
        least = length * min(1.0, length / shorter) ** 2
        if least < _SETTLED * max(1.0, linear.quality.chi2) and length < _NEARLY:
            return linear.after(move).result(job, pose, light)
        shorter = max(length, 1e-300)
    return Failure("diverged", f"not settled after {_ROUNDS} rounds")


def surfaces_first(job: ImageComparison, start: ImagePose) -> ImagePose:
    """Return a start with what surfaces not known change of the image, if they do.

    The pose stays: with black walls a target is so much darker than planned that the
    first steps of the pose would be far too long.
    """
    count = 0 if job.front is None else job.front.surfaces
    if count == 0:
        return start
    pose, light, chosen = start, None, pixels_of(job, start)
    pick = np.arange(job.free.numbers - count, job.free.numbers + 3)
    for _ in range(_SURFACE_ROUNDS):
        linear = _linear(job, pose, light, chosen)
        if isinstance(linear, Failure):
            return start
        move = np.zeros(job.free.numbers + 3)
        pick = pick[job.free.chosen[pick]]
        move[pick] = np.linalg.solve(linear.normal[np.ix_(pick, pick)],
                                     linear.right[pick])  # fmt: skip
        pose, light = _after(job, pose, move), linear.light + move[-3:]
    return pose


def step_once(job: ImageComparison, start: ImagePose) -> PoseFit | Failure:
    """Return the pose one Gauss-Newton step from `start`, as `fit_pose` would step.

    Chi squared is what the linear problem leaves, of all pixels.
    """
    linear = _linear(job, start, None, pixels_of(job, start))
    if isinstance(linear, Failure):
        return linear
    step = linear.move(job, start, _FAR_DEPTHS)
    if step is None:
        return Failure("no_contrast", "the image tells no pose")
    move, _ = step
    end, after = _after(job, start, move), linear.after(move)
    # a step too long leaves most at few pixels, where light bends: all of them count
    strict = replace(after.quality, chi2=after.quality.left)
    last = replace(after, quality=strict)
    return last.result(job, end, linear.light + move[-3:])


@dataclass(frozen=True, slots=True)
class _Linear:
    """The linear least-squares problem at one pose."""

    light: FloatArray  # (3,) that it starts from
    normal: FloatArray  # (P + 3, P + 3)
    noise: FloatArray  # (P + 3, P + 3), of that what noise alone gives
    right: FloatArray  # (P + 3,)
    quality: FitQuality
    residual: FloatArray  # (N,), in standard deviations
    design: FloatArray  # (P + 3, N), its slopes
    clear: BoolArray  # (N,), neither cut off nor saturated

    def move(
        self, job: ImageComparison, pose: ImagePose, depths: float
    ) -> tuple[FloatArray, float] | None:
        """Return the step, (P + 3,), and the share of it that may be believed.

        The step is cut to that; None if there is none.
        """
        pick = np.flatnonzero(job.free.chosen)
        move = np.zeros(job.free.numbers + 3)
        try:
            move[pick] = np.linalg.solve(
                self.normal[np.ix_(pick, pick)], self.right[pick]
            )
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(move).all():
            return None
        share = _shortened(job, pose, move, depths)
        move *= share
        # the focus stays where planes are, its square positive
        after = _after(job, pose, move)
        move[3] = job.focus(after) - job.focus(pose)
        if job.free.front_sigmas is not None:
            move[5] = after.occluder_blur.focus_um - pose.occluder_blur.focus_um
            move[6] = after.occluder_blur.core - pose.occluder_blur.core
            move[POSE:-3] = _modes(job, after.occluder_blur) - _modes(
                job, pose.occluder_blur
            )
        return move, share

    def after(self, move: FloatArray) -> _Linear:
        """Return the problem with its pixels as a step leaves them."""
        left = self.residual - move @ self.design
        return replace(self, residual=left, quality=quality(left, self.clear))

    def result(
        self, job: ImageComparison, pose: ImagePose, light: FloatArray
    ) -> PoseFit:
        """Return the fit that ends at a pose."""
        pick = np.ix_(*2 * (np.flatnonzero(job.free.chosen),))
        covariance = np.zeros((job.free.numbers + 3,) * 2)
        inverse = np.linalg.pinv(self.normal[pick], hermitian=True)
        covariance[pick] = inverse @ self.noise[pick] @ inverse
        return PoseFit(
            pose=pose,
            light=light,
            covariance=covariance,
            squared=job.squared,
            quality=self.quality,
            pixels=len(self.residual),
        )


def _linear(
    job: ImageComparison,
    pose: ImagePose,
    light: FloatArray | None,
    pixels: tuple[tuple[IntArray, IntArray], ...],
) -> _Linear | Failure:
    """Return the problem at a pose; without a light, at the one that fits best."""
    if sum(len(columns) for columns, _ in pixels) < FEWEST:
        return Failure("outside", "the target is not in view")
    seen = _together(
        [see(job, v, pose, p) for v, p in zip(job.views, pixels, strict=True)]
    )
    if light is None:
        light = fitted_light(seen.value, seen.target, job.free)
    if not (np.isfinite(light).all() and light[0] > 0):
        return Failure("no_contrast", "no light fits the image")
    mean = light @ seen.target
    variance = job.camera.variance(mean)
    own, noise = job.camera.noise_variance(mean) / variance, np.sqrt(variance)
    residual = (seen.value - mean) / noise
    ratio = residual / (REJECT * usual_size(residual))
    least, most = job.camera.floor, min(job.camera.ceiling, _FULL)
    clear = (seen.value < most) & (mean < most)
    if least > 0:  # darkness is cut off: less light gives the same count
        clear &= (seen.value > least) & (mean > least)
    trusted = (np.abs(ratio) < 1) & clear
    if trusted.sum() < FEWEST:
        return Failure("misfit", f"{int(trusted.sum())} pixels fit")
    weight = np.where(trusted, (1 - ratio**2) ** 2, 0.0)
    lit = light[0] + light[1:] @ seen.place
    design = np.concatenate((seen.slopes * lit, seen.target)) / noise
    pull = job.free.precision(squared=job.squared)
    right = design @ (weight * residual)
    front = pose.occluder_blur
    off = (job.focus(pose), pose.zoom - 1, front.focus_um, front.core)
    right[3:-3] -= pull[3:-3] * np.append(off, _modes(job, front))
    return _Linear(
        light=light,
        normal=(design * weight) @ design.T + np.diag(pull),
        noise=(design * (weight * own)) @ design.T + np.diag(pull),
        right=right,
        quality=quality(residual, clear),
        residual=residual,
        design=design,
        clear=clear,
    )


def _together(seen: list[PixelComparison]) -> PixelComparison:
    """Return the pixels of all views in one."""
    if len(seen) == 1:
        return seen[0]
    return PixelComparison(
        value=np.concatenate([s.value for s in seen]),
        target=np.concatenate([s.target for s in seen], axis=1),
        slopes=np.concatenate([s.slopes for s in seen], axis=1),
        place=np.concatenate([s.place for s in seen], axis=1),
    )


def _shortened(
    job: ImageComparison, pose: ImagePose, move: FloatArray, depths: float
) -> float:
    """Return what a step is cut to: farther, the slopes no longer hold."""
    far = _moved_px(job, math.hypot(move[0], move[1]), move[2], move[4])
    most = depths * job.looks.step_um
    if job.squared:
        most *= 2 * abs(pose.z_um) + most
    return float(1 / max(1.0, far / _FAR_PX, abs(move[3]) / most))


def _after(job: ImageComparison, pose: ImagePose, move: FloatArray) -> ImagePose:
    """Return the pose after a step; focus stays where planes are."""
    farthest = max(abs(view.dz_um) for view in job.views)
    reach, z_um = job.looks.reach_um - farthest, job.focus(pose) + float(move[3])
    if job.squared:
        z_um = math.sqrt(max(z_um, 0.0))
    z_um = min(max(z_um, -reach), reach)
    return ImagePose(
        column=pose.column + float(move[0]),
        row=pose.row + float(move[1]),
        turn_rad=pose.turn_rad + float(move[2]),
        z_um=z_um,
        zoom=min(max(pose.zoom + float(move[4]), _ZOOMS[0]), _ZOOMS[1]),
        front=_front(job, pose, z_um, move[5:-3]),
    )


def _front(
    job: ImageComparison, pose: ImagePose, z_um: float, move: FloatArray
) -> OccluderBlur | None:
    """Return how the occluder is blurred after a step, within its maps."""
    if job.front is None:
        return pose.front
    was, reach = pose.occluder_blur, job.front.reach_um
    if job.free.front_sigmas is None:
        return OccluderBlur(
            focus_um=math.copysign(z_um, was.focus_um) if job.squared else z_um
        )
    return OccluderBlur(
        focus_um=min(max(was.focus_um + float(move[0]), -reach), reach),
        core=min(max(was.core + float(move[1]), -_MOST_CORE), _MOST_CORE),
        occluder_modes=tuple(
            np.clip(_modes(job, was) + move[2:], -_MOST_MODE, _MOST_MODE).tolist()
        ),
    )


def _modes(job: ImageComparison, front: OccluderBlur) -> FloatArray:
    """Return the occluder modes' amounts, (S,), in standard deviations."""
    return np.array(front.occluder_modes or (0.0,) * job.free.occluder_modes)


def _moved_px(
    job: ImageComparison, place_px: float, turn_rad: float, zoom: float
) -> float:
    """Return how far a move, rotation or zoom takes anything in the template."""
    rim_px = max(job.looks.shape) / 2 / job.looks.over
    return max(place_px, abs(turn_rad) * rim_px, abs(zoom) * rim_px)


def _is_elsewhere(job: ImageComparison, one: ImagePose, other: ImagePose) -> bool:
    """Return whether other pixels tell most at the other pose."""
    place_px = math.hypot(one.column - other.column, one.row - other.row)
    turn_rad, zoom = one.turn_rad - other.turn_rad, one.zoom - other.zoom
    far = _moved_px(job, place_px, turn_rad, zoom) > AGAIN_PX
    return far or abs(one.z_um - other.z_um) > job.looks.step_um
