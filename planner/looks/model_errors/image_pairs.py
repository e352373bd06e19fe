"""Chains on pairs of images: one as trials have it, one by a better model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.features.feature import contour_px
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.perturb import noisier, shifted
from microplan.featuresel.look.scenario import LookCase, moved_layers, render_look
from microplan.featuresel.look.static_layers import fresh
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.trials import (
    Map,
    PreparedRoutines,
    is_wrong,
    measure_picture,
    period_rad,
)
from microplan.optics.layers.occlusion import occluded
from microplan.optics.lens.distorted_scene import lens_scene
from microplan.optics.lens.sensor import Sensor, expose, to_unit
from microplan.optics.render.scene import Scene, Window
from microplan.planner.looks.model_errors.better_models import BetterModel

_MARGIN_PX = 12  # of a crop around the target's contour
# Rays a pixel: as many as their time allows. `occluded` errs by .0022 rms with 128 and
# by .0042 with 64 over the shaft, where it errs most.
_SAMPLES, _FEWEST, _MOST = 1 << 20, 64, 128


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedAnswer:
    """What a chain said of a pair of images."""

    chain: Chain
    model: int  # which better model
    end: int  # which of its ends
    trial: int
    at_um: tuple[float, float]  # displacement of the target
    # the better image's answer less the other's, target's frame; None: not both answer
    off_um: tuple[float, float] | None
    turn_rad: float | None  # None: no angle is measured
    failure: str  # of the better image where the other one is answered; "": none
    image_error: float  # largest difference of the images, share of full scale


def image_pairs(
    case: LookCase,
    prepared: PreparedRoutines,
    models: tuple[BetterModel, ...],
    trials: tuple[Trial, ...],
    *,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
) -> tuple[PairedAnswer, ...]:
    """Return what chains say of pairs of images at some poses, pose by pose.

    Both images of a pair have the same pose, focus, light and noise. A better image is
    made of the part of the region that shows the target.

    Parameters
    ----------
    case : LookCase
        The look as trials image it.
    prepared : PreparedRoutines
        Its chains and artifacts.
    models : tuple of BetterModel
        The other sides of the pairs.
    trials : tuple of Trial
        Poses.
    map : callable
        As in `microplan.featuresel.trials.trials.run`.
    """
    parts = [_part(case, trial) for trial in trials]
    common = _around([rows for rows, _ in parts]), _around([cut for _, cut in parts])
    work = partial(_at_pose, case, prepared, models, common)
    return tuple(answer for found in map(work, trials) for answer in found)


def _at_pose(
    case: LookCase,
    prepared: PreparedRoutines,
    models: tuple[BetterModel, ...],
    part: tuple[slice, slice],
    trial: Trial,
) -> list[PairedAnswer]:
    """Return what chains say of all pairs at one pose."""
    sensor = noisier(case.sensor, trial.noise)
    usual = posed_image(case, trial, case.window)
    noise = np.random.default_rng(np.random.SeedSequence(trial.seed))
    picture = to_unit(expose(usual, sensor, noise), sensor.bits)
    before = measure_picture(case, prepared, trial, picture)
    crop = case.window.part(*part)
    known = [(case, usual[part])]
    found = []
    for model, better in enumerate(models):
        for end in _ends(better, trial):
            change = _change(better, end, trial, crop, known)
            changed = picture.copy()
            changed[part] = _seen(picture[part] + sensor.gain * change, sensor)
            after = measure_picture(case, prepared, trial, changed)
            found += [
                _answer(case, (model, end), trial, pair, float(abs(change).max()))
                for pair in zip(before, after, strict=True)
            ]
    return found


def _seen(image: FloatArray, sensor: Sensor) -> FloatArray:
    """Return an image as counts have it, (rows, columns), 0..1."""
    top = sensor.top_count
    found: FloatArray = np.rint(np.clip(image, 0.0, 1.0) * top) / top
    return found


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
    """Return the noise-free image of a look in a trial, (rows, columns)."""
    owner = case.target.name.partition(".")[0]
    turns = tuple(zip(case.spread.turning, trial.turns_rad, strict=False))
    seen = replace(
        case,
        window=window,
        static=shifted(case.static, owner, trial.occluder_um, turns),
        microscope=case.zoomed(trial.magnification),
        focus_um=case.focus_um + trial.dz_um,
        light=case.lit(trial.gain, trial.gradient_x, trial.gradient_y),
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


def _answer(
    case: LookCase,
    where: tuple[int, int],
    trial: Trial,
    pair: Sequence[Outcome],
    image_error: float,
) -> PairedAnswer:
    """Return the difference of two answers at a model's end in a trial."""
    before, after = pair
    model, end = where
    off, turn, failure = None, None, ""
    one, other = before.target_um, after.target_um
    if one is not None and not is_wrong(case, before):
        if other is None or is_wrong(case, after):
            failure = after.failure or "wrong"
        else:
            off = (other[0] - one[0], other[1] - one[1])
            turn = _turned(case, before, after)
    return PairedAnswer(
        chain=before.chain, model=model, end=end, trial=trial.index,
        at_um=(trial.dx_um, trial.dy_um), off_um=off,
        turn_rad=turn, failure=failure, image_error=image_error,
    )  # fmt: skip


def _turned(case: LookCase, before: Outcome, after: Outcome) -> float | None:
    """Return the difference of two angles, rad, None where one is not measured."""
    if before.theta_rad is None or after.theta_rad is None:
        return None
    return math.remainder(after.theta_rad - before.theta_rad, period_rad(case))
