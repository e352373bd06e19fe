"""Do a plan's looks keep their sigma and bias? Fresh images of another renderer.

Each look of the gear example is compiled; its chain then measures images that no trial
was: other draws at the uncertainties of the workcell, rendered by the exact defocus law
with a band and a margin ten times finer than the compiler's, or (`traced`) ray by ray
through all layers. Of every right answer counts

    (e - b)**2 / (sigma**2 + B**2 / 3)

on each axis of the target's frame: e its error, b the bias that random trials found, B
its half-width, sigma the standard deviation. The mean is 1 where trials are believed
rightly. Their images are the compiler's own: what these have wrong, nobody sees here.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.example import TASK
from benchmarks.figures import Benchmark, Figure, Options
from microplan.arrays import FloatArray
from microplan.featuresel.look.design import random_design
from microplan.featuresel.look.perturb import counts
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.repeatability import from_stops
from microplan.featuresel.trials.tolerance_search import alone
from microplan.featuresel.trials.trials import is_wrong, measure_picture
from microplan.optics.lens.sensor import to_unit
from microplan.planner.assembly.step_states import unfold
from microplan.planner.budget.measurement_history import MeasurementHistory
from microplan.planner.looks.look_problem import CompileContext
from microplan.planner.looks.look_record import CompiledLook
from microplan.planner.plan.steps import compile_step
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.memo import Memo
from microplan.planner.store.store import Store, place
from microplan.planner.task.presets import PRESETS, Preset
from microplan.planner.task.read_task import load_task
from microplan.schemas.plan import Measure, Repeatability

PRESET: Preset = "balanced"
IMAGES = 120  # of a look: twice as many values
ROOT = 7_777  # of the judge's draws; trials have the task's seed
BAND_ERROR, MARGIN = 1e-5, 160.0  # as `look.sensitivity` has them
EACH = f"{PRESET}.{2 * IMAGES}"  # in the figures' names: preset, values a look


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """What fresh images say of one look."""

    look: str
    values: int  # of right answers, both axes
    wrong: int  # answers, without a failure
    failed: int
    nees: float  # mean normalised squared error


def compiled_looks(preset: Preset) -> Iterator[CompiledLook]:
    """Yield the looks of the gear example, as a compile at a preset makes them."""
    report = Report()
    task = load_task(str(TASK), report)
    if task is None:
        raise RuntimeError(f"{TASK} is at fault")
    states, effort = unfold(task, report), PRESETS[preset]
    context = CompileContext(
        effort=effort,
        max_image_error=task.optimise.image_error(preset),
        map=map,
        memo=Memo(Store(place())),
    )
    low, _ = task.workcell.optics.magnification
    history = MeasurementHistory(magnification=low, seen={}, within_um=0.0, key="")
    for index in range(len(states)):
        step = compile_step(task, states, index, history, context, report)
        if step is None:
            raise RuntimeError(f"{states[index].step.id} cannot be compiled")
        history = step.history
        yield from step.looks


def exact(case: LookCase, *, traced: bool) -> LookCase:
    """Return a look as the judge renders it."""
    sampling = replace(
        case.sampling, band_error=BAND_ERROR, margin=MARGIN, single=False
    )
    treatment = "occluded" if traced else case.treatment
    return replace(case, sampling=sampling, model="exact", treatment=treatment)


def judge(look: CompiledLook, images: int, *, traced: bool = False) -> Kept:
    """Return how a look's first feature keeps what the plan says of it."""
    found, known = look.found[0], look.look.measure.repeatability
    if known is None:
        raise ValueError(f"look {look.look.id} has no random trials")
    case, measure = found.tried.case, look.look.measure
    ready = alone(found.tried.comparison.prepared, found.chosen.chain)
    fine = exact(case, traced=traced)
    outcomes: list[Outcome] = []
    stops_um = [z_um - case.focus_um for z_um in look.look.view.focus_stops_um]
    for trial in random_design(case, images, ROOT):
        for stop in from_stops(trial, stops_um):
            shown = counts(fine, replace(stop, model="exact"))
            picture = to_unit(shown, case.sensor.bits)
            (outcome,) = measure_picture(case, ready, stop, picture)
            if outcome.failure is None:
                break
        outcomes.append(outcome)
    right = [o for o in outcomes if o.failure is None and not is_wrong(case, o)]
    errors = np.array([o.target_um for o in right]) - np.array(own_bias_um(measure))
    return Kept(
        look=look.look.id,
        values=errors.size,
        wrong=sum(is_wrong(case, o) for o in outcomes),
        failed=_failed(outcomes),
        nees=nees(errors, known),
    )


def own_bias_um(measure: Measure) -> tuple[float, float]:
    """Return the bias in a look's trials, um, without what better images add to it."""
    x, y = measure.bias_um
    more_x, more_y = (0.0, 0.0) if (c := measure.model_cost) is None else c.bias_um
    return (x - more_x, y - more_y)


def nees(errors_um: FloatArray, known: Repeatability) -> float:
    """Return the mean normalised squared error, of (N, 2) errors less the bias, um."""
    allowed = np.square(known.sigma_um) + np.square(known.half_width_um) / 3
    return float((errors_um**2 / allowed).mean())


def _failed(outcomes: Sequence[Outcome]) -> int:
    return sum(o.failure is not None for o in outcomes)


def figures(_: Options) -> Iterator[Figure]:
    """Yield the least and the largest mean of all looks."""
    found = [judge(look, IMAGES).nees for look in compiled_looks(PRESET)]
    yield Figure(name=f"selection.kept_min.{EACH}", value=min(found), unit="1")
    yield Figure(name=f"selection.kept_max.{EACH}", value=max(found), unit="1")


BENCHMARK = Benchmark(
    names=(f"selection.kept_min.{EACH}", f"selection.kept_max.{EACH}"), measure=figures
)


def main() -> None:
    """Print every look: python -m benchmarks.selection.kept_sigmas."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--preset", choices=sorted(PRESETS), default=PRESET)
    parser.add_argument("--images", type=int, default=IMAGES)
    parser.add_argument("--traced", action="store_true")
    call = parser.parse_args()
    for look in compiled_looks(call.preset):
        kept = judge(look, call.images, traced=call.traced)
        row = {"preset": call.preset, "traced": call.traced, "n": kept.values}
        row |= {"look": kept.look, "nees": round(kept.nees, 3)}
        print(json.dumps(row | {"wrong": kept.wrong, "failed": kept.failed}))


if __name__ == "__main__":
    main()
