"""Replayed looks: the plan's chains on the cell's pictures, without whole runs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.truth.cell_side import at_rest, put, scenes_of, with_surface
from benchmarks.truth.compiler_side import Surface, TrialCase, task_of, trial_cases
from benchmarks.truth.examples import GEAR, stated_plan
from microplan.arrays import FloatArray
from microplan.executor.analysis.pictures import Viewer, viewer
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.record.plan_file import read_plan
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.measure_feature import Picture, measured
from microplan.executor.run.measure_target import to_unit
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.executor.simulated.hub import read_world
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.fusion import fuse
from microplan.schemas.files.evidence import LookScene
from microplan.schemas.plan import Look
from microplan.schemas.pose import Pose

PICTURES = 300  # of each look: 600 values, x and y pooled
# stated in the task, and what the cell's bodies have; past black walls the post below
# the gear is too dark, and the task infeasible
STATED = Surface(wall=0.6)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayedLook:
    """Errors of a look on pictures of the cell, and what the plan promises."""

    id: str
    errors_um: FloatArray  # (N, 2), bias taken off
    failed: int  # without an answer
    sigma_um: float
    half_width_um: tuple[float, float]  # of the bias

    @property
    def nees(self) -> float:
        """Return the mean of squared errors over what is promised, x and y pooled."""
        promised = self.sigma_um**2 + np.square(self.half_width_um) / 3
        return float(np.mean(self.errors_um**2 / promised))


def replayed_looks(
    task_file: Path, plan_file: Path, surface: Surface, pictures: int
) -> list[ReplayedLook]:
    """Return every look of a plan, measured on so many pictures of the solid camera.

    Of each the target's pose, the zoom, the focus, the light's side, the noise, and all
    other bodies' places are drawn as the plan's own trials have them.
    """
    plan = read_plan(plan_file).plan
    looks = {look.id: look for step in plan.steps for look in step.looks}
    scenes, found = scenes_of(plan_file), []
    artifacts = Artifacts.from_folder(plan, plan_file.parent)
    for name, trial in trial_cases(task_of(task_file, surface), looks):
        look = looks[name]
        seer = viewer(plan, plan_file.parent, artifacts, name)
        errors = [
            _error_um(seer, plan_file, scenes[name], trial, surface, seed)
            for seed in range(pictures)
        ]
        good = [error for error in errors if error is not None]
        known = (look.measure.repeatability, look.measure.model_cost)
        halves = [each.half_width_um for each in known if each is not None]
        x, y = np.sum([(0.0, 0.0), *halves], axis=0)  # of one sign, at the worst
        found.append(
            ReplayedLook(
                id=name,
                errors_um=np.array(good).reshape(-1, 2),
                failed=len(errors) - len(good),
                sigma_um=look.sigma_xy_um,
                half_width_um=(float(x), float(y)),
            )
        )
    return found


def _error_um(
    seer: Viewer,
    plan_file: Path,
    placed: LookScene,
    trial: TrialCase,
    surface: Surface,
    seed: int,
) -> tuple[float, float] | None:
    """Return one answer less where the lens shows the target; None: no answer."""
    look, rng = seer.look, np.random.default_rng([seed, len(placed.look)])
    world = with_surface(read_world(plan_file.with_name("world.json")), surface)
    cell = build_cell(at_rest(world), seed, camera="solid")
    put(cell, placed)
    point = _point(cell, look, trial)
    _disturb(cell, look, trial, point, rng)
    region = look.measure.region
    picture = Picture(
        image=to_unit(cell.camera.grab(region).counts, cell.truth.world.optics.bits),
        expected=seer.expected,
        believed=seer.believed,
        dz_um=0.0,
    )
    answer = _measured(seer, picture)
    if answer is None:
        return None
    true = cell.shown_um(look.target.partition(".")[0], *point)
    return (answer[0] - true[0], answer[1] - true[1])


def _point(cell: Cell, look: Look, trial: TrialCase) -> tuple[float, float]:
    """Return a target's reference point in its owner's frame; nothing is moved yet."""
    body = cell.truth.bodies.get(look.target.partition(".")[0])
    if body is None:  # the grip
        return (0.0, 0.0)
    return cell.truth.pose(body).inverse().apply(trial.case.x_um, trial.case.y_um)


def _disturb(
    cell: Cell,
    look: Look,
    trial: TrialCase,
    point: tuple[float, float],
    rng: np.random.Generator,
) -> None:
    """Move everything as random trials do, and set the view.

    The target turns about its reference point, the others, which move together, about
    their own.
    """
    spread, truth = trial.case.drawn, cell.truth
    owner = look.target.partition(".")[0]
    own, others = rng.normal(0.0, 1.0, (2, 2))
    own, others = own * spread.pose_sigma_xy_um, others * spread.occluder_sigma_um
    turns = {each.owner: each.sigma_theta_rad for each in spread.turning}
    turns[owner] = spread.pose_sigma_theta_rad
    for name, body in truth.bodies.items():
        at, by = (point, own) if name == owner else ((0.0, 0.0), others)
        sigma, normal = turns.get(name, 0.0), rng.normal()
        any_angle = rng.uniform(-math.pi, math.pi)
        turn = any_angle if sigma >= math.pi else sigma * normal
        pose, under_um = truth.pose(body), truth.under_um(body)
        theta = pose.theta_rad + turn
        away = Pose(x_um=0.0, y_um=0.0, theta_rad=theta).apply(*at)
        x_um, y_um = (
            p + d - a for p, d, a in zip(pose.apply(*at), by, away, strict=True)
        )
        moved = Pose(x_um=x_um, y_um=y_um, theta_rad=theta)
        truth.carry(body, "stage", moved, under_um)
    by = own if owner not in truth.bodies else others
    for axis, value in zip(("x_um", "y_um"), by, strict=True):
        truth.robot.actual[axis] += float(value)
    cell.lens.set_magnification(look.view.magnification)
    cell.lens.focus_um = look.view.focus_um + rng.normal(0, spread.focus_sigma_um)
    cell.light.set_level(look.view.light)


def _measured(seer: Viewer, picture: Picture) -> tuple[float, float] | None:
    """Return where the chains of a look find its target, um; None: they do not."""
    seen = []
    for measure in seer.look.measures:
        try:
            shown = measured(seer, seer.look, measure, measure.chain, picture)
        except ExecutorError:
            continue
        seen.append(shown.seen)
    if not seen:
        return None
    pose = fuse(seen, seer.believed)
    return None if isinstance(pose, Failure) else (pose.x_um, pose.y_um)


def figures(looks: Sequence[ReplayedLook]) -> Iterator[Figure]:
    """Yield the least and the greatest mean normalised squared error of a look."""
    values = min(look.errors_um.size for look in looks)
    told = f"of 1, {values} values or more a look"
    found = [look.nees for look in looks]
    yield Figure(name="truth.nees_min", value=min(found), unit=told)
    yield Figure(name="truth.nees_max", value=max(found), unit=told)
    failed = sum(look.failed for look in looks)
    yield Figure(name="truth.replays_failed", value=failed, unit="pictures")


def _measure(options: Options) -> Iterator[Figure]:
    with stated_plan(GEAR, STATED, options.jobs) as (task_file, plan_file):
        yield from figures(replayed_looks(task_file, plan_file, STATED, PICTURES))


BENCHMARK = Benchmark(
    names=("truth.nees_min", "truth.nees_max", "truth.replays_failed"),
    measure=_measure,
)
