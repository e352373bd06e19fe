"""What a cycle of an alignment costs the executor, without and with its routine."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast

import numpy as np

from benchmarks.example import compile_s, given
from benchmarks.executing.looks import Fine, fine_looks
from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.rivals.null_routine import NULL
from microplan.executor.devices.drivers import AxisReading, Counts, Frame
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import AXES
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.record.frames import Frames
from microplan.executor.record.write_ahead_log import Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.run_context import Rig
from microplan.executor.run.servo import align
from microplan.executor.simulated.cell import build_cell
from microplan.executor.simulated.hub import read_world
from microplan.featuresel.look.design import design
from microplan.featuresel.look.perturb import image
from microplan.featuresel.routines.contract import Artifact
from microplan.featuresel.routines.registry import REGISTRY
from microplan.schemas.plan import (
    AlignAction,
    Control,
    Look,
    Plan,
    Region,
    RoutineUse,
    parse_plan,
)

LOOK = "over_shaft"  # of the example, at the tightest alignment
CYCLES, REPEATS = 200, 5
AWAY_UM = 1.0  # the target never comes nearer
NAMES = (
    "executor.control_ms",
    "executor.control_cpu_ms",
    "executor.cycle_ms",
    "executor.cycle_hz",
)


class PromptAxes:
    """Axes that are where they are sent as soon as they are told."""

    model, serial = "prompt", "0"

    def __init__(self, **start: float) -> None:
        self._now = {**dict.fromkeys(AXES, 0.0), **start}

    def start(self, **asked: float | None) -> None:
        """Be there, at any speed."""
        self._now |= {n: v for n, v in asked.items() if n in AXES and v is not None}

    def reading(self) -> AxisReading:
        """Return where the axes are."""
        return AxisReading(**self._now)

    def moving(self) -> bool:
        """Return False."""
        return False

    def stop(self) -> None:
        """Do nothing: nothing moves."""


class PromptLens:
    """A lens that is set as soon as it is told."""

    model, serial = "prompt", "0"

    def __init__(self) -> None:
        self._now = (1.0, 0.0)

    def start_magnification(self, magnification: float) -> None:
        """Be there."""
        self._now = (magnification, self._now[1])

    def start_focus_um(self, focus_um: float) -> None:
        """Be there."""
        self._now = (self._now[0], focus_um)

    def reading(self) -> tuple[float, float]:
        """Return magnification and focus."""
        return self._now

    def moving(self) -> bool:
        """Return False."""
        return False

    def stop(self) -> None:
        """Do nothing: nothing moves."""


class StillCamera:
    """A camera that has its picture ready."""

    model, serial = "still", "0"

    def __init__(self, counts: Counts) -> None:
        self._counts = counts

    def grab(self, region: Region | None = None, *, after_s: float = 0.0) -> Frame:
        """Return the picture, which is that of a region."""
        if region is None:
            raise ValueError("there is no whole frame")
        return Frame(counts=self._counts, exposed_s=after_s)


class SkippingClock:
    """A clock that does not wait: what is left is work."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now_s(self) -> float:
        """Return the time that was waited for in all."""
        return self._now_s

    def wait(self, seconds: float) -> None:
        """Let the time be over."""
        self._now_s += seconds


def cycle_s(
    plan: Plan,
    folder: Path,
    look: Look,
    artifacts: Mapping[str, Artifact],
    counts: Counts,
) -> tuple[float, float]:
    """Return wall and CPU time of one cycle: look, decide, correct, settle.

    The stage moves and is polled through its dwell as in any alignment, the journal
    goes to a file; devices answer at once and nobody waits.
    """
    cell = build_cell(read_world(folder / "world.json"), 1)
    station = replace(
        cell.station,
        stage=PromptAxes(x_um=0.0),
        robot=PromptAxes(z_um=400.0),
        lens=PromptLens(),
        camera=StillCamera(counts),
        clock=SkippingClock(),
    )
    action = AlignAction(
        target="shaft_plate.post", to="tweezers.grip", look=look.id, axes="stage",
        path=("xy",),
    )  # fmt: skip
    known = {(look.id, name): artifact for name, artifact in artifacts.items()}
    with (folder / "benchmark.jsonl").open("w", encoding="utf-8") as stream:
        rig = Rig(
            plan=plan,
            station=station,
            beliefs=Beliefs(plan.beliefs, plan.features),
            artifacts=Artifacts(cast(Mapping[tuple[str, str | None], Artifact], known)),
            journal=Journal(stream, station.clock),
            frames=Frames(None),
        )
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        try:
            align(rig, action, look, _control(plan))
        except ExecutorError as error:
            if error.code != "MP830":  # all its looks are used up: as it should be
                raise
        return (
            (time.perf_counter() - wall_s) / CYCLES,
            (time.process_time() - cpu_s) / CYCLES,
        )


def _control(plan: Plan) -> Control:
    """Return a servo that looks CYCLES times: its target stays AWAY_UM off."""
    control = next(s.control for s in plan.steps if s.control is not None)
    return replace(
        control,
        tolerance_xy_um=AWAY_UM / 2,
        tolerance_theta_rad=None,
        max_step_um=10 * AWAY_UM,
        max_cycles=CYCLES,
    )


def _null(look: Look) -> Look:
    """Return a look whose routine costs nothing."""
    away = {"away_px": AWAY_UM / look.view.um_per_px}
    use = RoutineUse(id=NULL.name, version="1", parameters=away, arrays=None)
    return replace(look, measure=replace(look.measure, chain=(use,), fallback=()))


def _picture(fine: Fine) -> Counts:
    """Return the look's region with the target AWAY_UM off, as the camera gives it."""
    trial = replace(
        design(fine.case, 1, 0)[0],
        dx_um=AWAY_UM, dy_um=0.0, dtheta_rad=0.0, dz_um=0.0, magnification=1.0,
    )  # fmt: skip
    levels = 2**fine.case.sensor.bits - 1
    counts: Counts = np.rint(levels * image(fine.case, trial)).astype(np.uint8)
    return counts


@contextmanager
def _registered() -> Iterator[None]:
    """Let the executor find the routine that costs nothing."""
    known = cast(dict[str, str], REGISTRY)
    known[NULL.name] = "benchmarks.rivals.null_routine:NULL"
    try:
        yield
    finally:
        del known[NULL.name]


@contextmanager
def _one_core() -> Iterator[None]:
    """Keep this process to one core."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def _measure(options: Options) -> Iterator[Figure]:
    with TemporaryDirectory() as name, _registered(), _one_core():
        folder = Path(name)
        path = given(options, "gear-on-shaft")
        if path is None:
            compile_s(folder / "gear.plan", options.jobs, preset="fast")
            path = folder / "gear.plan" / "plan.json"
        plan = parse_plan(path.read_text(encoding="utf-8"))
        (folder / "world.json").write_bytes((path.parent / "world.json").read_bytes())
        fine = fine_looks(plan, LOOK)[LOOK]
        counts = _picture(fine)
        bare = _null(fine.look)
        nothing = {NULL.name: Artifact(parameters=bare.measure.chain[0].parameters)}
        times = [cycle_s(plan, folder, bare, nothing, counts) for _ in range(REPEATS)]
        wall_s, cpu_s = (min(each) for each in zip(*times, strict=True))
        yield Figure(name=NAMES[0], value=1e3 * wall_s, unit="ms")
        yield Figure(name=NAMES[1], value=1e3 * cpu_s, unit="ms")
        full = [
            cycle_s(plan, folder, fine.look, fine.artifacts, counts)[1]
            for _ in range(REPEATS)
        ]
        yield Figure(name=NAMES[2], value=1e3 * min(full), unit="ms")
        yield Figure(name=NAMES[3], value=1 / min(full), unit="Hz")


BENCHMARK = Benchmark(names=NAMES, measure=_measure)
