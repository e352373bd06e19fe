"""Axes of a task tradeoff: preset, trials, frames, zoom."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from microplan.planner.task.presets import PRESETS, Axis, Effort, Preset, Vary
from microplan.planner.task.task import Task
from microplan.planner.task.workcell import CameraSpec
from microplan.planner.views.zooms import ladder

MOST_POINTS = 64
MOST_TRIALS = 10_000
MOST_FRAMES = 256  # 8 bits finer: a camera of 8 bits then counts with 16
_USUAL: Mapping[Axis, tuple[str, ...]] = {
    "preset": tuple(PRESETS),
    "trials": ("24", "64", "304"),
    "frames": ("1", "4", "16"),
}
_ZOOMS = 3  # rungs of the ladder from the lowest that are usual


@dataclass(frozen=True, slots=True, kw_only=True)
class CompileMethod:
    """One method of compiling a task."""

    varied: str
    preset: Preset
    effort: Effort
    frames: int = 1
    zoom: float | None = None

    def of(self, task: Task) -> Task:
        """Return the task with this method's camera and zoom."""
        cell = task.workcell
        optics = cell.optics
        if self.zoom is not None:
            optics = replace(optics, magnification=(self.zoom, self.zoom))
        camera = averaged(cell.camera, self.frames)
        return replace(task, workcell=replace(cell, optics=optics, camera=camera))


def averaged(camera: CameraSpec, frames: int) -> CameraSpec:
    """Return a camera whose one frame is the sum of several, a power of two.

    Electrons and levels add up; read noise, and all but one of the roundings, by their
    squares. It takes as many times as long.
    """
    if frames == 1:
        return camera
    step_e = camera.full_well_e / (2**camera.bits - 1)
    noise = frames * camera.read_noise_e**2 + (frames - 1) * step_e**2 / 12
    return replace(
        camera,
        full_well_e=frames * camera.full_well_e,
        read_noise_e=math.sqrt(noise),
        bits=min(camera.bits + frames.bit_length() - 1, 16),
        rate_hz=camera.rate_hz / frames,
        exposure_ms=(camera.exposure_ms[0] * frames, camera.exposure_ms[1] * frames),
    )


def compile_methods(task: Task, vary: Vary) -> tuple[CompileMethod, ...]:
    """Return the task's own method first, then those that differ from it in one thing.

    Raises
    ------
    ValueError
        If a value cannot be, or there are more than MOST_POINTS.
    """
    preset = task.optimise.prefer
    own = CompileMethod(
        varied="as the task says", preset=preset, effort=PRESETS[preset]
    )
    found = [own]
    for axis, values in vary:
        for value in values or usual(task, axis):
            method = replace(changed(own, axis, value, task), varied=f"{axis} {value}")
            if replace(method, varied=own.varied) != own:
                found.append(method)
    if len(found) > MOST_POINTS:
        raise ValueError(f"{len(found)} points, at most {MOST_POINTS}")
    return tuple(found)


def usual(task: Task, axis: Axis) -> tuple[str, ...]:
    """Return the values of an axis that is named without any."""
    if axis == "frames" and not task.workcell.camera.sensor.is_plain:
        return ("1",)  # each frame bends and cuts off what it has
    if axis != "zoom":
        return _USUAL[axis]
    return tuple(f"{zoom:.4g}" for zoom in ladder(task.workcell)[:_ZOOMS])


def changed(own: CompileMethod, axis: Axis, value: str, task: Task) -> CompileMethod:
    """Return a method with one thing changed; ValueError for a value that cannot be."""
    if axis == "preset":
        found = next((name for name in PRESETS if name == value), None)
        if found is None:
            raise ValueError(f"preset must be {', '.join(PRESETS)}, got {value!r}")
        return replace(own, preset=found, effort=PRESETS[found])
    if axis == "zoom":
        low, high = task.workcell.optics.magnification
        zoom = _within(axis, value, low * (1 - 1e-3), high * (1 + 1e-3))
        return replace(own, zoom=min(max(zoom, low), high))  # as written with 4 digits
    if axis == "trials":
        trials = _whole(axis, value, MOST_TRIALS)
        # random trials are as many more or fewer
        random = max(1, round(own.effort.random_trials * trials / own.effort.trials))
        effort = replace(own.effort, trials=trials, random_trials=random)
        return replace(own, effort=effort)
    frames = _whole(axis, value, MOST_FRAMES)
    if frames > 1 and not task.workcell.camera.sensor.is_plain:
        raise ValueError("frames are summed of cameras without response or noise_table")
    if frames & (frames - 1):
        raise ValueError(f"frames must be a power of two, got {value!r}")
    return replace(own, frames=frames)


def _whole(axis: str, value: str, most: int) -> int:
    """Return a whole number from 1 to `most`."""
    return int(_within(axis, value, 1, most, whole=True))


def _within(
    axis: str, value: str, low: float, high: float, *, whole: bool = False
) -> float:
    """Return a number of an interval; ValueError naming the axis if it is none."""
    try:
        number = float(int(value)) if whole else float(value)
    except (ValueError, OverflowError):
        number = math.nan
    if not low <= number <= high:
        kind = "a whole number" if whole else "a number"
        raise ValueError(
            f"{axis} must be {kind} from {low:.4g} to {high:.4g}, got {value[:40]!r}"
        )
    return number
