"""Trials of one look against the script one would write in an afternoon.

The script does the same trials: each body's polygon in a supersampled raster, blurred
by the transform of a defocused pupil, laid over the one below, averaged over pixels,
the same camera's noise; then the nominal image's patch is matched, and the peak's place
is refined by a shift of phases. It knows no shade: `unshaded` leaves that out of our
images too, and nothing else. Times are of CPU, a trial.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np
from scipy import fft
from scipy.signal import fftconvolve
from skimage.feature import match_template
from skimage.registration import phase_cross_correlation

from benchmarks.example import TASK
from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.rivals.naive import point_spread
from benchmarks.timing import cpu_s
from microplan.arrays import FloatArray
from microplan.featuresel.look.design import Trial, design
from microplan.featuresel.look.perturb import counts, image
from microplan.featuresel.look.scenario import LookCase, scene
from microplan.featuresel.selection.evaluate import make_ready
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.trials import (
    PreparedRoutines,
    measure_picture,
    prepare,
)
from microplan.optics.lens.sensor import expose, to_unit
from microplan.optics.outline.outline import flatten
from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.scenario import build_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.views.requests import requests
from microplan.planner.views.target_views import views

TRIALS = 24  # of ours; every other of these by the script, which takes long
CHAIN = ("ncc",)  # matching the nominal image's patch, too
_SAMPLES = 4  # a pixel and axis
_CHORD_UM = 0.05
_HALF_UM = 58.0  # of the patch: the gear and a little of what is about it


def gear_look() -> LookCase:
    """Return the example's look at the gear between the fingers.

    Raises
    ------
    RuntimeError
        If the example cannot be read.
    """
    report = Report()
    task = load_task(str(TASK), report)
    if task is None:
        raise RuntimeError(f"the example is at fault: {report.found}")
    states = unfold(task, report)
    index = next(k for k, s in enumerate(states) if s.step.id == "gear_in_fingers")
    (request,) = requests(task, states, index, None)
    low, _ = task.workcell.optics.magnification
    (view, *_) = views(task, request, low, report)
    case, _ = build_case(task, request, view, task.optimise.image_error("balanced"))
    return case


def script_counts(case: LookCase, trial: Trial, *, noisy: bool = True) -> FloatArray:
    """Return a trial's picture as the script makes it, (rows, columns) 0..1."""
    m = replace(
        case.microscope,
        magnification=case.microscope.magnification * trial.magnification,
    )
    step_um = m.um_per_px / _SAMPLES
    shown = scene(case, trial.dx_um, trial.dy_um, trial.dtheta_rad)
    w = case.window
    image = np.full((w.rows * _SAMPLES, w.columns * _SAMPLES), shown.background)
    focus_um = case.focus_um + trial.dz_um
    for layer in sorted(shown.layers, key=lambda each: each.z_um):
        kernel = point_spread(m, layer.z_um - focus_um, step_um)
        border = kernel.shape[0] // 2
        mask = np.zeros(np.add(image.shape, 2 * border), dtype=np.uint8)
        corner = np.array(
            [
                border - 0.5 + _SAMPLES * (m.width_px / 2 - w.column),
                border - 0.5 + _SAMPLES * (m.height_px / 2 - w.row),
            ]
        )
        rings = [
            np.round(flatten(ring, _CHORD_UM) / step_um * (1, -1) + corner)
            for ring in layer.outline.rings
        ]
        cv2.fillPoly(mask, [np.clip(r, -1e6, 1e6).astype(np.int32) for r in rings], 1)
        covered = fftconvolve(mask.astype(np.float64), kernel, mode="valid")
        image += covered * (layer.reflectance - image)
    light = case.light.gain * trial.gain
    blocks = image.reshape(w.rows, _SAMPLES, w.columns, _SAMPLES)
    seen: FloatArray = light * blocks.mean(axis=(1, 3))
    if not noisy:
        return seen
    rng = np.random.default_rng(trial.seed)
    return to_unit(expose(seen, case.sensor, rng), case.sensor.bits)


def script_place(picture: FloatArray, patch: FloatArray) -> tuple[float, float]:
    """Return (column, row) of a patch's middle by matching, then by phases."""
    found: FloatArray = match_template(picture, patch)  # type: ignore[no-untyped-call]  # skimage has no types
    row, column = np.unravel_index(int(found.argmax()), found.shape)
    part = picture[row : row + patch.shape[0], column : column + patch.shape[1]]
    (down, right), *_ = phase_cross_correlation(  # type: ignore[no-untyped-call]  # as above
        part, patch, upsample_factor=50, normalization=None
    )
    middle = (np.array(patch.shape) - 1) / 2
    return float(column + middle[1] + right), float(row + middle[0] + down)


def script_error_um(case: LookCase, trial: Trial, patch: FloatArray) -> float:
    """Return how far off the script finds a trial's target, um."""
    column, row = script_place(script_counts(case, trial), patch)
    x, y = case.frame.to_world(column, row)
    return math.hypot(x - case.x_um - trial.dx_um, y - case.y_um - trial.dy_um)


def nominal_patch(case: LookCase) -> FloatArray:
    """Return the script's template, centred on the target to half a pixel."""
    still = replace(
        design(case, 1, 0)[0], dx_um=0.0, dy_um=0.0, dtheta_rad=0.0, dz_um=0.0,
        magnification=1.0, gain=1.0, occluder_um=(0.0, 0.0),
    )  # fmt: skip
    image = script_counts(case, still, noisy=False)
    room = case.target.search_px + 2  # that the patch leaves on all sides
    column, row = round(case.target.column), round(case.target.row)
    half = min(
        int(_HALF_UM * case.microscope.px_per_um),
        *(int(v - room) for v in (column, row)),
        int(image.shape[1] - 1 - column - room),
        int(image.shape[0] - 1 - row - room),
    )
    return image[row - half : row + half + 1, column - half : column + half + 1]


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _measure(_options: Options) -> Iterator[Figure]:
    case = gear_look()
    yield from _against(case, "rival")
    yield from _against(replace(case, lamp_aperture=None), "rival_unshaded")
    yield from _trial_cost(case, make_ready(case), design(case, TRIALS, 1998))


def _against(case: LookCase, name: str) -> Iterator[Figure]:
    """Yield time and error of our trials, the script's as their rivals."""
    one = prepare(case, (CHAIN,))
    trials = design(case, TRIALS, 1998)
    few = trials[::2]
    _measured(case, one, trials[0])  # tables warm
    ours: list[float] = []
    ours_s = cpu_s(lambda: ours.extend(_errors(case, one, few))) / len(few)
    patch = nominal_patch(case)
    theirs: list[float] = []
    theirs_s = cpu_s(
        lambda: theirs.extend(script_error_um(case, t, patch) for t in few)
    ) / len(few)
    yield Figure(name=f"compile.{name}_ratio", value=ours_s, unit="s", rival=theirs_s)
    yield Figure(
        name=f"compile.{name}_error_um", value=_rms(ours), unit="um", rival=_rms(theirs)
    )


def _measured(
    case: LookCase, ready: PreparedRoutines, trial: Trial
) -> tuple[Outcome, ...]:
    """Return what each chain says of one trial's image."""
    return measure_picture(case, ready, trial, image(case, trial))


def _errors(
    case: LookCase, ready: PreparedRoutines, trials: Sequence[Trial]
) -> Iterator[float]:
    for trial in trials:
        (found,) = _measured(case, ready, trial)
        yield found.distance_um


def _trial_cost(
    case: LookCase, ready: PreparedRoutines, trials: Sequence[Trial]
) -> Iterator[Figure]:
    """Yield the time of a trial; the floor is its routines and one transform pair."""
    made = cpu_s(lambda: [counts(case, t) for t in trials]) / len(trials)
    whole = cpu_s(lambda: [_measured(case, ready, t) for t in trials]) / len(trials)
    shape = case.window.rows, case.window.columns
    noise = np.random.default_rng(0).random(shape)
    pair = cpu_s(lambda: [fft.irfft2(fft.rfft2(noise), s=shape) for _ in range(100)])
    yield Figure(
        name="compile.trial_s",
        value=whole,
        unit="s",
        floor=max(whole - made, 0.0) + pair / 100,
    )


BENCHMARK = Benchmark(
    names=(
        "compile.rival_ratio",
        "compile.rival_error_um",
        "compile.rival_unshaded_ratio",
        "compile.rival_unshaded_error_um",
        "compile.trial_s",
    ),
    measure=_measure,
)
