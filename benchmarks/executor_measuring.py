"""How far off the looks' own answers are, with axes and lens shifts that do not err."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.example import compile_s, given
from benchmarks.executor_looks import fine_looks
from benchmarks.figures import Benchmark, Figure, Options
from executor.artifacts import Artifacts, key_of
from executor.beliefs import Beliefs
from executor.frames import Frames
from executor.journal import Journal
from executor.rig import Rig
from executor.run import run_plan
from executor.simulated.cell import Cell, build_cell
from executor.simulated.hub import read_world
from featuresel.routines import Artifact
from schemas.plan import Look, Plan, Step, VerifyAction, parse_plan
from schemas.world import World, WorldAxes

SHARE = 0.95
RUNS = 60  # of the seeds given, at most: every run is made twice
LOOKS = (
    "find_gear", "see_fingers", "bring_between", "gear_in_fingers", "find_shaft",
    "over_shaft", "check_seated.target", "check_seated.seat",
)  # fmt: skip
NAMES = (
    "executor.measurement_error_p95_um",
    "executor.measurement_error_plan_p95_um",
    *(f"executor.measured.{name}.plan_p95_um" for name in LOOKS),
    *(f"executor.measured.{name}.likelihood_p95_um" for name in LOOKS),
)

Errors = Mapping[str, Sequence[float]]  # look -> |measured - true|, um


def still(world: World) -> World:
    """Return a world whose axes land where they are sent and whose image never shifts.

    Zoom scale, focus, blur law, aperture, light, noise and sizes err as they did.
    """
    return replace(
        world,
        stage=_exact(world.stage),
        robot=_exact(world.robot),
        stage_tilt_sigma_rad=0.0,
        stage_drift_um_per_min=0.0,
        optics=replace(
            world.optics, parcentric_sigma_um=0.0, lateral_sigma_um_per_um=0.0
        ),
    )


def _exact(axes: WorldAxes) -> WorldAxes:
    return replace(
        axes,
        repeatability_xy_um=0.0,
        repeatability_z_um=0.0,
        repeatability_theta_rad=0.0,
    )


def errors_um(
    plan: Plan, artifacts: Artifacts, world: World, seeds: Sequence[int]
) -> dict[str, list[float]]:
    """Return the errors of every accepted look, by look, over runs of a plan."""
    found: dict[str, list[float]] = {}
    for seed in seeds:
        cell, log = build_cell(world, seed), io.StringIO()
        rig = Rig(
            plan=plan,
            station=cell.station,
            beliefs=Beliefs(plan.beliefs, plan.features),
            artifacts=artifacts,
            journal=Journal(log, cell.clock),
            frames=Frames(None),
        )
        rig.watch = _Watching(rig, cell, found)
        run_plan(rig)
    return found


class _Watching:
    """Notes how far a sighting is from the truth, under the name of its look."""

    def __init__(self, rig: Rig, cell: Cell, found: dict[str, list[float]]) -> None:
        self._rig, self._cell, self._found = rig, cell, found

    def __call__(self, target: str, x_um: float, y_um: float) -> None:
        step = next(s for s in self._rig.plan.steps if s.id == self._rig.journal.step)
        look = next(look for look in step.looks if look.target == target)
        owner, offset = self._rig.beliefs.anchor(target)
        x, y = self._cell.shown_um(owner, *offset)
        self._found.setdefault(look.id, []).append(math.hypot(x_um - x, y_um - y))


def _without_height(step: Step) -> Step:
    """Return a verification without its focus sweep: most of a run, and no look."""
    if not isinstance(step.action, VerifyAction):
        return step
    return replace(step, action=replace(step.action, height=None))


def _likelihood(plan: Plan, found: Artifacts) -> tuple[Plan, Artifacts, set[str]]:
    """Return the plan with the likelihood chain wherever a look can use it."""
    fine = fine_looks(plan)
    arrays: dict[tuple[str, str | None], Artifact] = {}
    steps = []
    for step in plan.steps:
        looks = []
        for look in step.looks:
            better = fine.get(look.id)
            looks.append(look if better is None else better.look)
            arrays |= _kept(look, found)
            if better is not None:
                ready = better.artifacts.items()
                arrays |= {(look.id, name): made for name, made in ready}
        steps.append(replace(step, looks=tuple(looks)))
    return replace(plan, steps=tuple(steps)), Artifacts(arrays), set(fine)


def _kept(look: Look, found: Artifacts) -> dict[tuple[str, str | None], Artifact]:
    """Return the artifacts of the plan's own chains."""
    kept: dict[tuple[str, str | None], Artifact] = {}
    for measure in look.measures:
        key, uses = key_of(look, measure), (*measure.chain, *measure.fallback)
        for use, (_, artifact) in zip(uses, found.stages(key, uses), strict=True):
            kept[key, use.arrays or use.id] = artifact
    return kept


def _p95(errors: Errors, name: str) -> float:
    return float(np.quantile(errors[name], SHARE))


def _measure(options: Options) -> Iterator[Figure]:
    with TemporaryDirectory() as name:
        path = given(options, "gear-on-shaft")
        if path is None:
            path = Path(name) / "gear.plan" / "plan.json"
            compile_s(path.parent, options.jobs, preset="fast")
        plan = parse_plan(path.read_text(encoding="utf-8"))
        plan = replace(plan, steps=tuple(map(_without_height, plan.steps)))
        world = still(read_world(path.parent / "world.json"))
        artifacts = Artifacts.from_folder(plan, path.parent)
        seeds = options.seeds[:RUNS]
        own = errors_um(plan, artifacts, world, seeds)
        better, more, changed = _likelihood(plan, artifacts)
        fine = errors_um(better, more, world, seeds)
    worst = {look: _p95(fine, look) for look in LOOKS if look in changed}
    yield Figure(name=NAMES[0], value=max(worst.values()), unit="um")
    plans = {look: _p95(own, look) for look in LOOKS}
    yield Figure(name=NAMES[1], value=max(plans.values()), unit="um")
    for look in LOOKS:
        yield Figure(
            name=f"executor.measured.{look}.plan_p95_um", value=plans[look], unit="um"
        )
    for look in LOOKS:
        value = worst.get(look, plans[look])
        yield Figure(
            name=f"executor.measured.{look}.likelihood_p95_um", value=value, unit="um"
        )


BENCHMARK = Benchmark(names=NAMES, measure=_measure)
