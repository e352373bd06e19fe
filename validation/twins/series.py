"""Series of frames with their truth: still, through focus, over the stage, by light."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from skimage.io import imsave

from validation.twins.camera import Camera, Counts, dusted, exposed, graded
from validation.twins.optics import Optics, image
from validation.twins.scenes import Body, Floats, Scene, placed


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Where a part's origin lies in the picture, um, and its angle."""

    x_um: float = 0.0
    y_um: float = 0.0
    theta_rad: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What the cell's devices say of a frame."""

    focus_um: float = 0.0
    stage_x_um: float = 0.0
    stage_y_um: float = 0.0
    light: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """A picture and what is true of it, vibration included."""

    counts: Counts  # (rows, columns)
    truth: Pose
    reading: Reading


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """A part on a stage, what stands still around it, a lens and a camera.

    A reading's focus adds to the lens' own: its `focus_um` is the focus' true zero.
    """

    part: tuple[Body, ...]  # in the part's own frame
    surroundings: Scene  # the stage does not move it
    optics: Optics
    camera: Camera
    size: tuple[int, int]  # rows, columns
    um_per_px: float
    specks: int = 0  # of dust, which stays where it is
    gradient: tuple[float, float] = (0.0, 0.0)  # of light, across and up, shares
    seed: int = 0  # of dust

    def light(self, truth: Pose, focus_um: float) -> Floats:
        """Return light (rows, columns) of the part at a pose, before the camera."""
        at = (truth.x_um, truth.y_um, truth.theta_rad)
        part = tuple(replace(b, shape=placed(b.shape, *at)) for b in self.part)
        scene = replace(self.surroundings, bodies=self.surroundings.bodies + part)
        lens = replace(self.optics, focus_um=self.optics.focus_um + focus_um)
        found = image(scene, lens, self.size, self.um_per_px)
        found = dusted(found, self.specks, np.random.default_rng(self.seed))
        return graded(found, *self.gradient)


def frames(
    rig: Rig,
    pose: Pose,
    readings: Iterable[Reading],
    *,
    vibration_um: float = 0.0,
    seed: int = 0,
) -> Iterator[Frame]:
    """Yield a frame for each reading; `vibration_um` is rms along x, and along y.

    A frame's draws depend on the seed and its place in the series alone.
    """
    known: tuple[Pose, float] | None = None
    light = np.zeros(rig.size)
    for index, reading in enumerate(readings):
        rng = np.random.default_rng((seed, index))
        shake = vibration_um * rng.standard_normal(2)
        truth = Pose(
            x_um=pose.x_um + reading.stage_x_um + float(shake[0]),
            y_um=pose.y_um + reading.stage_y_um + float(shake[1]),
            theta_rad=pose.theta_rad,
        )
        if known != (truth, reading.focus_um):
            light = rig.light(truth, reading.focus_um)
            known = truth, reading.focus_um
        counts = exposed(light * reading.light, rig.camera, rng)
        yield Frame(counts=counts, truth=truth, reading=reading)


def still(
    rig: Rig, pose: Pose, count: int, *, vibration_um: float = 0.0, seed: int = 0
) -> Iterator[Frame]:
    """Yield frames of a part that only vibrates."""
    same = [Reading()] * count
    return frames(rig, pose, same, vibration_um=vibration_um, seed=seed)


def focus_steps(
    rig: Rig,
    pose: Pose,
    focus_um: Sequence[float],
    *,
    vibration_um: float = 0.0,
    seed: int = 0,
) -> Iterator[Frame]:
    """Yield a frame at each focus."""
    steps = [Reading(focus_um=each) for each in focus_um]
    return frames(rig, pose, steps, vibration_um=vibration_um, seed=seed)


def stage_moves(
    rig: Rig,
    pose: Pose,
    stage_um: Sequence[tuple[float, float]],
    *,
    vibration_um: float = 0.0,
    seed: int = 0,
) -> Iterator[Frame]:
    """Yield a frame at each place of the stage, which adds to the pose."""
    moves = [Reading(stage_x_um=x, stage_y_um=y) for x, y in stage_um]
    return frames(rig, pose, moves, vibration_um=vibration_um, seed=seed)


def light_levels(
    rig: Rig,
    pose: Pose,
    levels: Sequence[float],
    *,
    vibration_um: float = 0.0,
    seed: int = 0,
) -> Iterator[Frame]:
    """Yield a frame at each level of light."""
    steps = [Reading(light=each) for each in levels]
    return frames(rig, pose, steps, vibration_um=vibration_um, seed=seed)


def write(
    folder: Path, series: Iterable[Frame], *, bits: int, ending: str = ".tif"
) -> tuple[Pose, ...]:
    """Write frames and readings.csv, which tells no truth, and return the truths.

    `bits` are the camera's: files of 8 bits or fewer hold one byte a pixel. `ending` is
    .tif or .png.
    """
    folder.mkdir(parents=True, exist_ok=True)
    kind, truths = np.uint8 if bits <= 8 else np.uint16, []
    with (folder / "readings.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("file", "focus_um", "stage_x_um", "stage_y_um", "light"))
        for index, frame in enumerate(series):
            name, said = f"{index:04d}{ending}", frame.reading
            counts = frame.counts.astype(kind)
            imsave(str(folder / name), counts, check_contrast=False)
            stage = said.stage_x_um, said.stage_y_um
            rows.writerow((name, said.focus_um, *stage, said.light))
            truths.append(frame.truth)
    return tuple(truths)
