"""The pose, focus, zoom and light under which images of a target are the likeliest."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import BoolArray, FloatArray, IntArray
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.likelihood.appearance import (
    ImagePose,
)
from microplan.featuresel.routines.likelihood.comparison import (
    FEWEST,
    LIGHT,
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
from microplan.featuresel.routines.likelihood.pose_moves import (
    is_elsewhere,
    modes_of,
    pose_after,
    shortened,
)

_ROUNDS = 30  # of Gauss-Newton; it settles in 2 to 8, far out of focus in more
_SETTLED = 0.05  # squared length of the next step, in standard deviations, over chi^2
_NEARLY = 100.0  # and of this one: farther off nothing is known of the next
_FAR_DEPTHS = 1.0  # the most that one step may change the focus, steps of the planes
_FULL = 0.99  # of full scale, where the camera may have clipped
_SURFACE_ROUNDS = 2  # amounts and light multiply each other


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseFit:
    """What fits best."""

    pose: ImagePose
    light: FloatArray  # (L,) see `comparison.LIGHT`
    covariance: FloatArray  # (P + L, P + L) of the pose's P numbers and of light
    squared: bool  # the covariance is of the square of the focus
    quality: FitQuality
    pixels: int
    # whether the other side of focus is refuted, or none is left beside this one
    is_signed: bool = False

    @property
    def gain(self) -> float:
        """Return the light, from black to full scale, over the nominal one."""
        return float(self.light[0] + self.light[4])

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
        if is_elsewhere(job, last, pose):
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
        pose, light = pose_after(job, pose, move), linear.light + move[-LIGHT:]
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
    pick = np.arange(job.free.numbers - count, job.free.numbers + LIGHT)
    for _ in range(_SURFACE_ROUNDS):
        linear = _linear(job, pose, light, chosen)
        if isinstance(linear, Failure):
            return start
        move = np.zeros(job.free.numbers + LIGHT)
        pick = pick[job.free.chosen[pick]]
        move[pick] = np.linalg.solve(linear.normal[np.ix_(pick, pick)],
                                     linear.right[pick])  # fmt: skip
        pose, light = pose_after(job, pose, move), linear.light + move[-LIGHT:]
    return pose


def excess(job: ImageComparison, fit: PoseFit, other: PoseFit) -> float:
    """Return chi squared of another fit less that of a fit; inf where it fits nothing.

    Far residuals are cut, as in `fit_quality`; over the pixels that tell most at either
    of both.
    """
    pixels = tuple(
        _either(*both, job.shape[1])
        for both in zip(
            pixels_of(job, fit.pose), pixels_of(job, other.pose), strict=True
        )
    )
    there = _linear(job, other.pose, other.light, pixels)
    here = _linear(job, fit.pose, fit.light, pixels)
    if isinstance(there, Failure) or isinstance(here, Failure):
        return math.inf if isinstance(there, Failure) else -math.inf
    return float(there.quality.left - here.quality.left) * len(here.residual)


def _either(
    one: tuple[IntArray, IntArray], other: tuple[IntArray, IntArray], width: int
) -> tuple[IntArray, IntArray]:
    """Return the (columns, rows), (N,) each, that are of either set of pixels."""
    cells = [rows * width + columns for columns, rows in (one, other)]
    rows, columns = np.divmod(np.union1d(*cells), width)
    return columns, rows


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
    end, after = pose_after(job, start, move), linear.after(move)
    # a step too long leaves most at few pixels, where light bends: all of them count
    strict = replace(after.quality, chi2=after.quality.left)
    last = replace(after, quality=strict)
    return last.result(job, end, linear.light + move[-LIGHT:])


@dataclass(frozen=True, slots=True)
class _Linear:
    """The linear least-squares problem at one pose."""

    light: FloatArray  # (L,) that it starts from
    normal: FloatArray  # (P + L, P + L)
    noise: FloatArray  # (P + L, P + L), of that what noise alone gives
    right: FloatArray  # (P + L,)
    quality: FitQuality
    residual: FloatArray  # (N,), in standard deviations
    design: FloatArray  # (P + L, N), its slopes
    clear: BoolArray  # (N,), neither cut off nor saturated

    def move(
        self, job: ImageComparison, pose: ImagePose, depths: float
    ) -> tuple[FloatArray, float] | None:
        """Return the step, (P + L,), and the share of it that may be believed.

        The step is cut to that; None if there is none.
        """
        pick = np.flatnonzero(job.free.chosen)
        move = np.zeros(job.free.numbers + LIGHT)
        try:
            move[pick] = np.linalg.solve(
                self.normal[np.ix_(pick, pick)], self.right[pick]
            )
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(move).all():
            return None
        share = shortened(job, pose, move, depths)
        move *= share
        # the focus stays where planes are, its square positive
        after = pose_after(job, pose, move)
        move[3] = job.focus(after) - job.focus(pose)
        if job.free.front_sigmas is not None:
            move[5] = after.occluder_blur.focus_um - pose.occluder_blur.focus_um
            move[6] = after.occluder_blur.core - pose.occluder_blur.core
            move[POSE:-LIGHT] = modes_of(job, after.occluder_blur) - modes_of(
                job, pose.occluder_blur
            )
        return move, share

    def after(self, move: FloatArray) -> _Linear:
        """Return the problem with its pixels as a step leaves them."""
        left = self.residual - move @ self.design
        return replace(
            self, residual=left, quality=quality(left, self.clear, self.design[:2])
        )

    def result(
        self, job: ImageComparison, pose: ImagePose, light: FloatArray
    ) -> PoseFit:
        """Return the fit that ends at a pose."""
        pick = np.ix_(*2 * (np.flatnonzero(job.free.chosen),))
        covariance = np.zeros((job.free.numbers + LIGHT,) * 2)
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
    ends = seen.target[0].min(), seen.target[0].max()
    steepness = light[0] + 2 * light[4] * np.array(ends)
    if not (np.isfinite(light).all() and (steepness > 0).all()):  # brighter is brighter
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
    lit = light[0] + light[1:3] @ seen.place + 2 * light[4] * seen.target[0]
    design = np.concatenate((seen.slopes * lit, seen.target)) / noise
    pull = job.free.precision(squared=job.squared)
    right = design @ (weight * residual)
    front = pose.occluder_blur
    off = (job.focus(pose), pose.zoom - 1, front.focus_um, front.core)
    right[3:-LIGHT] -= pull[3:-LIGHT] * np.append(off, modes_of(job, front))
    right[-LIGHT:] -= pull[-LIGHT:] * light
    return _Linear(
        light=light,
        normal=(design * weight) @ design.T + np.diag(pull),
        noise=(design * (weight * own)) @ design.T + np.diag(pull),
        right=right,
        quality=quality(residual, clear, design[:2]),
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
