"""How far diffraction from body to body moves a look's chain: no image has it.

Here it is added at every pixel, by the waves that the ledger predicts it from.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.truth.compiler_side import (
    Surface,
    TrialCase,
    task_of,
    trial_cases,
    wave_changes_at,
)
from benchmarks.truth.examples import GEAR, plan_of
from microplan.arrays import FloatArray
from microplan.executor.record.plan_file import read_plan
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.perturb import still
from microplan.featuresel.look.scenario import LookCase, moved_layers, render_look
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.trials import measure_picture, prepare
from microplan.optics.layers.coaxial_light import pixel_axes_um

BLACK = Surface(wall=0.0)  # what mirrors has waves of its own: they are left to rays
AWAY = (1.0, 0.5)  # standard deviations that the target lies off, in x and in y


def name_of(look: str) -> str:
    """Return the figure's name of a look."""
    return f"truth.waves.{look}.moved_nm"


def moved_um(made: TrialCase, chain: Chain) -> float:
    """Return how far diffraction moves a chain's answer, um; nan: it gives none."""
    case = made.case
    dx, dy = (case.promised.pose_sigma_xy_um * sigmas for sigmas in AWAY)
    trial = Trial(
        index=0, dx_um=dx, dy_um=dy, dtheta_rad=0.0, model=case.model, seed=(0,)
    )
    by_rays = render_look(case, moved_layers(case, dx, dy, 0.0), still(case, trial))
    change = wave_changes_at(made, _pixels_um(case), (dx, dy))
    ready = prepare(case, (chain,))
    answers = [
        _place_um(*measure_picture(case, ready, trial, image))
        for image in (by_rays, by_rays + change.reshape(by_rays.shape))
    ]
    return math.dist(*answers)


def _pixels_um(case: LookCase) -> FloatArray:
    """Return where the pixels of a look's region look, row by row, (N, 2) um."""
    axes = pixel_axes_um(case.microscope, case.window, (0.0, 0.0))
    x, y = (first + step * np.arange(count) for first, step, count in axes)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _place_um(answer: Outcome) -> tuple[float, float]:
    return answer.world_um or (math.nan, math.nan)


def _moved_nm(plan_file: Path, look_id: str) -> float:
    """Return it for the chain that a plan has chosen, nm."""
    plan = read_plan(plan_file).plan
    look = next(k for step in plan.steps for k in step.looks if k.id == look_id)
    ((_, made),) = trial_cases(task_of(GEAR.file, BLACK), {look_id: look})
    return 1e3 * moved_um(made, tuple(each.id for each in look.measure.chain))


def _measure(options: Options) -> Iterator[Figure]:
    with (
        plan_of(GEAR, options) as plan_file,
        ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool,
    ):
        found = pool.map(_moved_nm, [plan_file] * len(GEAR.looks), GEAR.looks)
        for look, value in zip(GEAR.looks, found, strict=True):
            yield Figure(name=name_of(look), value=value, unit="nm")


BENCHMARK = Benchmark(names=tuple(map(name_of, GEAR.looks)), measure=_measure)
