"""Replayed looks: the plan's chains on the cell's pictures, without whole runs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.truth.cell_side import as_tried, put, scenes_of
from benchmarks.truth.compiler_side import TrialCase, trial_cases
from benchmarks.truth.examples import GEAR, PRESET, long_plan
from benchmarks.truth.promised import Promise, angles_before, promised
from microplan.arrays import FloatArray
from microplan.executor.analysis.pictures import Viewer, viewer
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.record.plan_file import read_plan
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.measure_feature import Picture, measured
from microplan.executor.run.measure_target import light_of
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.executor.simulated.hub import read_world
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.fusion import Believed, fuse
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.schemas.files.evidence import LookScene
from microplan.schemas.plan import Look
from microplan.schemas.pose import Pose

PICTURES = 300  # of each look: 600 values, x and y pooled
NORMAL_95 = 1.96  # sigmas either side
_AT_ONCE = 8  # pictures that a process is given at a time


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayedLook:
    """Errors of a look on pictures of the cell, and what the plan promises."""

    id: str
    errors_um: FloatArray  # (N, 2) along the target's axes, bias taken off
    failed: int  # without an answer
    promise: Promise

    @property
    def scaled(self) -> FloatArray:
        """Return errors over what is promised of each axis, (N, 2)."""
        sigma, half = self.promise.sigma_um, self.promise.half_width_um
        found: FloatArray = self.errors_um / np.sqrt(
            np.square(sigma) + np.square(half) / 3
        )
        return found

    @property
    def nees(self) -> float:
        """Return the mean of squared errors over what is promised, x and y pooled."""
        return float(np.mean(self.scaled**2))

    @property
    def coverage(self) -> float:
        """Return the share of values within what is promised of 95 % of them."""
        return float(np.mean(np.abs(self.scaled) <= NORMAL_95))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Judged:
    """A look with all that its pictures are made and measured by."""

    seer: Viewer
    plan_file: Path
    placed: LookScene
    trial: TrialCase
    angle_sigma_rad: float | None  # of the target's angle; None: nothing measured it


def replayed_looks(
    task_file: Path, plan_file: Path, pictures: int, jobs: int = 1
) -> list[ReplayedLook]:
    """Return every look of a plan, measured on so many pictures of the solid camera.

    By so many processes.

    Of each the target's pose, the zoom, the focus, the light's side, the noise, and all
    other bodies' places are drawn as the plan's own trials have them, walls and faces
    by the cell; where nothing is found the next focus stop follows. What moves all of
    the image is left out: the budget has its own terms for it. So are gates. The angle
    of a part is known as a run knows it then.
    """
    plan = read_plan(plan_file).plan
    looks = {look.id: look for step in plan.steps for look in step.looks}
    scenes, angles = scenes_of(plan_file), angles_before(plan)
    artifacts, found = Artifacts.from_folder(plan, plan_file.parent), []
    task = load_task(str(task_file), Report())
    if task is None:
        raise RuntimeError(f"{task_file} cannot be read")
    # a pool that a killed process breaks: another kind would wait for it
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for name, trial in trial_cases(task, looks):
            judged = _Judged(
                seer=viewer(plan, plan_file.parent, artifacts, name),
                plan_file=plan_file,
                placed=scenes[name],
                trial=trial,
                angle_sigma_rad=angles.get(name),
            )
            promise = promised(looks[name])
            work = partial(_error_um, judged, promise)
            errors = list(pool.map(work, range(pictures), chunksize=_AT_ONCE))
            good = [error for error in errors if error is not None]
            found.append(
                ReplayedLook(
                    id=name,
                    errors_um=np.array(good).reshape(-1, 2),
                    failed=len(errors) - len(good),
                    promise=promise,
                )
            )
    return found


def _error_um(judged: _Judged, promise: Promise, seed: int) -> FloatArray | None:
    """Return one answer less where the lens shows the target; None: no answer.

    (2,) along the target's axes. The bias of what the cell does not show is given back.
    """
    seer, placed, trial = judged.seer, judged.placed, judged.trial
    look, rng = seer.look, np.random.default_rng([seed, len(placed.look)])
    world = read_world(judged.plan_file.with_name("world.json"))
    cell = build_cell(as_tried(world), seed, camera="solid")
    put(cell, placed)
    point = _point(cell, look, trial)
    _disturb(cell, look, trial, point, rng)
    off_um = rng.normal(0, trial.case.promised.focus_sigma_um)
    theta_rad = _theta_rad(cell, look, trial)
    belief = _belief(judged, theta_rad, rng)
    for stop_um in (look.view.focus_um, *look.view.focus_stops_um):
        cell.lens.focus_um = stop_um + off_um
        answer = _measured(seer, _picture(seer, cell, belief))
        if answer is not None:
            break
    else:
        return None
    true = cell.shown_um(look.target.partition(".")[0], *point)
    back = Pose(x_um=0.0, y_um=0.0, theta_rad=-theta_rad)
    off = back.apply(answer[0] - true[0], answer[1] - true[1])
    return np.add(off, promise.unseen_bias_um)


def _theta_rad(cell: Cell, look: Look, trial: TrialCase) -> float:
    """Return the true angle of a target's frame; the grip's is the trials' own."""
    body = cell.truth.bodies.get(look.target.partition(".")[0])
    return trial.case.theta_rad if body is None else cell.truth.pose(body).theta_rad


def _belief(
    judged: _Judged, theta_rad: float, rng: np.random.Generator
) -> Believed | None:
    """Return what a run knows of the target's angle by then."""
    sigma_rad = judged.angle_sigma_rad
    if sigma_rad is None:
        return judged.seer.believed
    turned = theta_rad + sigma_rad * float(rng.normal())
    return Believed(theta_rad=turned, sigma_rad=sigma_rad)


def _picture(seer: Viewer, cell: Cell, belief: Believed | None) -> Picture:
    """Return what the cell's camera shows of a look's region now."""
    grabbed = cell.camera.grab(seer.look.measure.region)
    expected = seer.expected
    if belief is not None:
        expected = replace(expected, theta_rad=belief.theta_rad)
    return Picture(
        image=light_of(grabbed.counts, seer.plan.requirements),
        frame=seer.frame,
        expected=expected,
        believed=belief,
    )


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
    """Move everything as random trials do, and set the view but for the focus.

    The target turns about its reference point, the others, which move together, about
    their own.
    """
    spread, truth = trial.case.promised, cell.truth
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
    cell.light.set_level(look.view.light)


def _measured(seer: Viewer, picture: Picture) -> tuple[float, float] | None:
    """Return where the chains of a look find its target, um; None: they do not."""
    seen = []
    for measure in seer.look.measures:
        try:
            shown = measured(seer.artifacts, seer.look, measure, measure.chain, picture)
        except ExecutorError:
            continue
        seen.append(shown.seen)
    if not seen:
        return None
    pose = fuse(seen, picture.believed)
    return None if isinstance(pose, Failure) else (pose.x_um, pose.y_um)


def figures(looks: Sequence[ReplayedLook], preset: str) -> Iterator[Figure]:
    """Yield the extremes of looks' mean squared errors, and their coverage.

    Of looks that have answers; those that have none are among the failed.

    Raises
    ------
    ValueError
        If no look has any.
    """
    failed = sum(look.failed for look in looks)
    looks = [look for look in looks if look.errors_um.size]
    values = min(look.errors_um.size for look in looks)
    trials = min(look.promise.trials for look in looks)
    told = f"of 1, {values} values or more a look, sigma of {trials} trials ({preset})"
    squares = [look.nees for look in looks]
    yield Figure(name="truth.nees_min", value=min(squares), unit=told)
    yield Figure(name="truth.nees_max", value=max(squares), unit=told)
    shares = [look.coverage for look in looks]
    pooled = float(np.average(shares, weights=[look.errors_um.size for look in looks]))
    share = f"of 95 % intervals, {values} values or more a look"
    yield Figure(name="truth.coverage", value=pooled, unit=share)
    yield Figure(name="truth.coverage_min", value=min(shares), unit=share)
    yield Figure(name="truth.coverage_max", value=max(shares), unit=share)
    yield Figure(name="truth.replays_failed", value=failed, unit="pictures")


def _measure(options: Options) -> Iterator[Figure]:
    with long_plan(GEAR, options) as plan_file:
        looks = replayed_looks(GEAR.file, plan_file, PICTURES, options.jobs)
        yield from figures(looks, PRESET)


BENCHMARK = Benchmark(
    names=(
        "truth.nees_min", "truth.nees_max", "truth.coverage", "truth.coverage_min",
        "truth.coverage_max", "truth.replays_failed",
    ),
    measure=_measure,
)  # fmt: skip
