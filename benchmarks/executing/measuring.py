"""How far off the looks' own answers are, with axes and lens shifts that do not err."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.example import compile_s, given
from benchmarks.executing.bounds import limit_p95_um
from benchmarks.executing.looks import Fine, fine_looks
from benchmarks.figures import Benchmark, Figure, Options
from microplan.executor.devices.drivers import Camera, Counts, Frame
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.record.frames import Frames
from microplan.executor.record.write_ahead_log import Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.run import run_plan
from microplan.executor.run.run_context import Rig
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.executor.simulated.hub import read_world
from microplan.featuresel.routines.chain import measure_chain
from microplan.featuresel.routines.contract import Failure, Guess
from microplan.optics.lens.displacement import displaced
from microplan.optics.lens.lens import LensErrors
from microplan.optics.transfer.microscope import Microscope
from microplan.schemas.files.world import World, WorldAxes
from microplan.schemas.plan import Look, Plan, Region, Step, VerifyAction, parse_plan

SHARE = 0.95
RUNS = 60  # of the seeds given, at most
LOOKS = (
    "find_gear", "see_fingers", "bring_between", "gear_in_fingers", "find_shaft",
    "over_shaft", "check_seated.target", "check_seated.seat",
)  # fmt: skip
NAMES = (
    "executor.measurement_error_p95_um",
    "executor.measurement_error_plan_p95_um",
    "executor.measurement_failed",
    *(f"executor.measured.{name}.plan_p95_um" for name in LOOKS),
    *(f"executor.measured.{name}.likelihood_p95_um" for name in LOOKS),
    *(f"executor.measured.{name}.limit_p95_um" for name in LOOKS),
)


@dataclass(slots=True)
class Found:
    """Errors of looks, |measured - true|, um, by look."""

    plan: dict[str, list[float]] = field(default_factory=dict)
    fine: dict[str, list[float]] = field(default_factory=dict)
    failed: int = 0  # of the likelihood chain, aloud


def still(world: World) -> World:
    """Return a world whose axes land where they are sent and whose image never shifts.

    Neither as a whole, nor by its scale away from the axis. Focus, blur law, aperture,
    distortion, light, noise and sizes err as they did.
    """
    return replace(
        world,
        stage=_exact(world.stage),
        robot=_exact(world.robot),
        stage_tilt_sigma_rad=0.0,
        stage_drift_um_per_min=0.0,
        optics=replace(
            world.optics,
            parcentric_sigma_um=0.0,
            lateral_sigma_um_per_um=0.0,
            scale_sigma=0.0,
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
    plan: Plan,
    artifacts: Artifacts,
    world: World,
    seeds: Sequence[int],
    fine: Mapping[str, Fine],
) -> Found:
    """Return the errors of every accepted look over runs of a plan.

    The plan's own chain leads the run; the likelihood chain measures the same frame.
    """
    found = Found()
    for seed in seeds:
        cell, log = build_cell(world, seed), io.StringIO()
        camera = _Kept(cell.station.camera)
        rig = Rig(
            plan=plan,
            station=replace(cell.station, camera=camera),
            beliefs=Beliefs(plan.beliefs, plan.features),
            artifacts=artifacts,
            journal=Journal(log, cell.clock),
            frames=Frames(None),
        )
        rig.watch = _Watching(rig, cell, camera, fine, found)
        run_plan(rig)
    return found


class _Kept:
    """A camera whose last frame is kept."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self.model, self.serial = camera.model, camera.serial
        self.last: Counts | None = None
        self.region: Region | None = None  # of that frame

    def grab(self, region: Region | None = None, *, after_s: float = 0.0) -> Frame:
        """Return the camera's frame, and keep it."""
        frame = self.camera.grab(region, after_s=after_s)
        self.last, self.region = frame.counts, region
        return frame


class _Watching:
    """Notes how far a sighting is from the truth, by the plan's chain and the other."""

    def __init__(
        self,
        rig: Rig,
        cell: Cell,
        camera: _Kept,
        fine: Mapping[str, Fine],
        found: Found,
    ) -> None:
        self._rig, self._cell, self._camera = rig, cell, camera
        self._fine, self._found = fine, found

    def __call__(self, target: str, x_um: float, y_um: float) -> None:
        rig = self._rig
        step = next(s for s in rig.plan.steps if s.id == rig.journal.step)
        look = next(look for look in step.looks if look.target == target)
        owner, offset = rig.beliefs.anchor(target)
        true = _imaged_um(self._cell, *self._cell.shown_um(owner, *offset))
        error_um = math.dist((x_um, y_um), true)
        self._found.plan.setdefault(look.id, []).append(error_um)
        other = self._fine.get(look.id)
        if other is None:
            return
        counts = self._camera.last
        if counts is None or other.look.measure.region != look.measure.region:
            raise RuntimeError(f"{look.id}: another region than the plan's")
        self._note(self._found.fine, self._measured(look, other, counts), look, true)

    def _note(
        self,
        errors: dict[str, list[float]],
        place: tuple[float, float] | None,
        look: Look,
        true: tuple[float, float],
    ) -> None:
        """Keep how far off a place is, or that there is none."""
        if place is None:
            self._found.failed += 1
            return
        errors.setdefault(look.id, []).append(math.dist(place, true))

    def _measured(
        self, look: Look, fine: Fine, counts: npt.NDArray[Any]
    ) -> tuple[float, float] | None:
        """Return where the likelihood chain finds the target, um; nothing taken off."""
        known = self._rig.beliefs.angle(look.target, self._rig.readings())
        start = Guess(
            column=fine.look.measure.reference.column,
            row=fine.look.measure.reference.row,
            theta_rad=None if known is None else known.theta_rad,
            theta_assumed=known is None,  # an earlier look measured it
        )
        stages = [(name, fine.artifacts[name]) for name in fine.chain]
        image = counts / (2.0**self._rig.plan.requirements.bits - 1)
        answer = measure_chain(image, stages, start)
        if isinstance(answer, Failure):
            return None
        frame = self._rig.frame_of(_read(look, self._camera.region))
        return frame.to_world(answer.column, answer.row)


def _read(look: Look, region: Region | None) -> Look:
    """Return a look with the region that was read of it."""
    if region is None:
        raise RuntimeError(f"{look.id}: the whole frame was read, not its region")
    return replace(look, measure=replace(look.measure, region=region))


def _imaged_um(cell: Cell, x_um: float, y_um: float) -> tuple[float, float]:
    """Return where the lens shows a place that its distortion has not moved yet.

    The budget has the distortion in a row of its own: no routine can tell it.
    """
    optics, lens = cell.truth.world.optics, cell.lens
    scope = Microscope(
        aperture=lens.aperture,
        wavelength_um=optics.wavelength_um,
        medium_index=optics.medium_index,
        magnification=lens.magnification,
        pitch_um=optics.pitch_um,
        width_px=optics.width_px,
        height_px=optics.height_px,
    )
    true = LensErrors(
        distortion=lens.errors.distortion,
        lateral_x=lens.errors.lateral_x,
        lateral_y=lens.errors.lateral_y,
        scale_per_um=lens.errors.scale_per_um,
        field_curvature_per_um=lens.errors.field_curvature_per_um,
    )
    x, y = displaced((x_um, y_um), true, scope).tolist()
    return (x, y)


def _without_height(step: Step) -> Step:
    """Return a verification without its focus sweep: most of a run, and no look."""
    if not isinstance(step.action, VerifyAction):
        return step
    return replace(step, action=replace(step.action, height=None))


def _p95(errors: Mapping[str, Sequence[float]], name: str) -> float:
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
        looks = fine_looks(plan)
        found = errors_um(plan, artifacts, world, seeds, looks)
    plans = {look: _p95(found.plan, look) for look in LOOKS}
    fine = {look: _p95(found.fine, look) for look in LOOKS if look in found.fine}
    yield _one("measurement_error_p95_um", max(fine.values()))
    yield _one("measurement_error_plan_p95_um", max(plans.values()))
    yield Figure(name=NAMES[2], value=found.failed, unit="looks")
    for look in LOOKS:
        yield _one(f"measured.{look}.plan_p95_um", plans[look])
    for look in LOOKS:
        if look in fine:  # where nothing answered there is nothing to tell
            yield _one(f"measured.{look}.likelihood_p95_um", fine[look])
    for look in LOOKS:
        yield _one(
            f"measured.{look}.limit_p95_um", limit_p95_um(looks[look].case, SHARE)
        )


def _one(name: str, value: float) -> Figure:
    return Figure(name=f"executor.{name}", value=value, unit="um")


BENCHMARK = Benchmark(
    names=NAMES,
    measure=_measure,
    may_lack=frozenset(name for name in NAMES if name.endswith("likelihood_p95_um")),
)
