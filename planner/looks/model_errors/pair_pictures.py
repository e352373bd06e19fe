"""Pictures of a look by its own model and by better ones, pose by pose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.features.feature import contour_px
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.perturb import as_tried, noisier, sampling_at, shifted
from microplan.featuresel.look.scenario import LookCase, moved_layers, render_look
from microplan.featuresel.look.static_layers import fresh
from microplan.optics.layers.occlusion import occluded
from microplan.optics.lens.distorted_scene import lens_scene
from microplan.optics.lens.sensor import CountArray, ends, expose, linear, quantised
from microplan.optics.render.scene import Scene, Window
from microplan.planner.looks.model_errors.better_models import BetterModel

_MARGIN_PX = 12  # of a crop around the target's contour
# Rays a pixel: as many as their time allows. `occluded` errs by .0022 rms with 128 and
# by .0042 with 64 over the shaft, where it errs most.
_SAMPLES, _FEWEST, _MOST = 1 << 20, 64, 128
_MOST_BYTES = 1 << 25  # of pictures that are kept, of some models


@dataclass(frozen=True, slots=True, kw_only=True)
class BetterPicture:
    """A better model's part of the region at a pose."""

    model: int
    end: int
    counts: CountArray  # (rows, columns) of the part
    image_error: float  # as in `PairedAnswer`


@dataclass(frozen=True, slots=True, kw_only=True)
class PosePictures:
    """All pictures of a look at one pose, as the camera's counts."""

    counts: CountArray  # (rows, columns) of the region, as trials have it
    part: tuple[slice, slice]  # the rows and columns that better ones show
    better: tuple[BetterPicture, ...]

    @property
    def size(self) -> int:
        """Return how many bytes they take."""
        return self.counts.nbytes + sum(each.counts.nbytes for each in self.better)


@dataclass(slots=True)
class PairPictures:
    """Pictures of a look's pairs by trial, for further chains; it changes no result."""

    made: dict[int, PosePictures] = field(default_factory=dict)

    def keep(self, trial: int, pictures: PosePictures) -> None:
        """Keep a pose's pictures, if there is room."""
        if sum(each.size for each in self.made.values()) + pictures.size <= _MOST_BYTES:
            self.made[trial] = pictures


def pose_pictures(
    case: LookCase,
    models: tuple[BetterModel, ...],
    part: tuple[slice, slice],
    trial: Trial,
) -> PosePictures:
    """Return the pictures of all pairs at one pose."""
    sensor = noisier(case.sensor, trial.noise)
    tried = as_tried(case)
    usual = posed_image(tried, trial, case.window)
    noise = np.random.default_rng(np.random.SeedSequence(trial.seed))
    counts = expose(usual, sensor, noise)
    shown = linear(counts[part], sensor)
    least, _ = ends(sensor)
    if least > 0:  # no count tells how dark it is where darkness is cut off
        dark = np.minimum(shown, sensor.gain * usual[part])
        shown = np.where(counts[part] == 0, dark, shown)
    crop = case.window.part(*part)
    known = [(tried, usual[part])]
    better: list[BetterPicture] = []
    for number, model in enumerate(models):
        for end in _ends(model, trial):
            change = _change(model, end, trial, crop, known)
            better.append(
                BetterPicture(
                    model=number,
                    end=end,
                    counts=quantised(shown + sensor.gain * change, sensor),
                    image_error=float(abs(change).max()),
                )
            )
    return PosePictures(counts=counts, part=part, better=tuple(better))


def _change(
    better: BetterModel,
    end: int,
    trial: Trial,
    crop: Window,
    known: list[tuple[LookCase, FloatArray]],
) -> FloatArray:
    """Return the difference of a better image of a crop, (rows, columns).

    `known` has images of the crop that are made, and takes what it is better than.
    """
    against = known[0][0] if better.against is None else better.against
    rest = next((image for case, image in known if case == against), None)
    if rest is None:
        rest = posed_image(against, trial, crop)
        known.append((against, rest))
    other = better.ends[end]
    change = np.zeros((crop.rows, crop.columns))
    for weight, case in other.cases:
        if other.is_traced or case != against:
            image = posed_image(case, trial, crop, is_traced=other.is_traced)
            change += weight * (image - rest)
    return change


def _ends(better: BetterModel, trial: Trial) -> tuple[int, ...]:
    """Return the ends that are imaged at a pose.

    Where they alternate, a pose and its mirror image have the same one, and as many on
    the rim as elsewhere.
    """
    count = len(better.ends)
    if not better.alternates or count == 1:
        return tuple(range(count))
    return (((trial.index // 2 + 1) // 2) % count,)


def posed_image(
    case: LookCase, trial: Trial, window: Window, *, is_traced: bool = False
) -> FloatArray:
    """Return the noise-free image of a look in a trial, (rows, columns).

    Shares of full scale, with the case's rays.
    """
    owner = case.target.name.partition(".")[0]
    turns = tuple(zip(case.spread.turning, trial.turns_rad, strict=False))
    focus_um = case.focus_um + trial.dz_um
    seen = replace(
        case,
        window=window,
        static=shifted(case.static, owner, trial.occluder_um, turns),
        microscope=case.zoomed(trial.magnification),
        focus_um=focus_um,
        light=case.lit(trial.gain, trial.gradient_x, trial.gradient_y),
        sampling=sampling_at(case, focus_um, case.sampling.rays),
    )
    moved = moved_layers(case, trial.dx_um, trial.dy_um, trial.dtheta_rad)
    if not is_traced:
        return render_look(seen, moved, fresh(seen, seen.static))
    shown = Scene(
        layers=seen.static + moved,
        background=seen.background,
        background_z_um=seen.background_z_um,
    )
    return occluded(
        lens_scene(shown, seen.microscope, seen.lens, seen.focus_um),
        seen.microscope,
        focus_um=seen.focus_um,
        window=window,
        light=seen.light,
        samples=_rays(window),
        step_um=seen.microscope.um_per_px,
        lamp_aperture=seen.lamp_aperture,
    )


def _rays(window: Window) -> int:
    """Return how many rays a pixel gets, a power of two."""
    share = max(_SAMPLES // (window.rows * window.columns), 1)
    return min(max(1 << (share.bit_length() - 1), _FEWEST), _MOST)


def common_part(case: LookCase, trials: Sequence[Trial]) -> tuple[slice, slice]:
    """Return the rows and columns of the region that show the target in any trial."""
    parts = [_part(case, trial) for trial in trials]
    return _around([rows for rows, _ in parts]), _around([cut for _, cut in parts])


def _part(case: LookCase, trial: Trial) -> tuple[slice, slice]:
    """Return the rows and columns of the region that show the target in a trial."""
    window, target = case.window, case.target
    if not target.contour:
        return slice(0, window.rows), slice(0, window.columns)
    there = replace(
        target,
        column=target.column + target.px_per_um * trial.dx_um,
        row=target.row - target.px_per_um * trial.dy_um,
        theta_rad=target.theta_rad + trial.dtheta_rad,
    )
    column, row = contour_px(there)
    return _slice(row, window.rows), _slice(column, window.columns)


def _around(found: Sequence[slice]) -> slice:
    """Return the smallest slice that holds all of some."""
    return slice(min(s.start for s in found), max(s.stop for s in found))


def _slice(at_px: FloatArray, size: int) -> slice:
    """Return the pixels about some positions; all where they lie outside."""
    first = max(math.floor(at_px.min()) - _MARGIN_PX, 0)
    last = min(math.ceil(at_px.max()) + _MARGIN_PX + 1, size)
    return slice(first, last) if first < last else slice(0, size)
