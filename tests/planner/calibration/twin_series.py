"""Series of pictures with readings of a twin: a chart of grey patches, a part."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
from shapely.geometry import box

from tests.planner.examples import EXAMPLE
from validation.twins.camera import Camera, exposed
from validation.twins.optics import Optics, image
from validation.twins.scenes import Body, Floats, Scene
from validation.twins.series import Frame, Pose, Reading, Rig, frames, write

ZOOM = 20.0
SIZE, UM_PER_PX = (96, 128), 7.5 / ZOOM
LENS = Optics(aperture=0.42, wavelength_um=0.6)


def cell_of(folder: Path) -> Path:
    """Copy the example, and return a workcell in it whose camera is `SIZE`."""
    shutil.copytree(EXAMPLE, folder, dirs_exist_ok=True)
    cell = folder / "workcell.yaml"
    text = cell.read_text(encoding="utf-8")
    rows, columns = SIZE
    small = f"[{7.5 * columns:g}, {7.5 * rows:g}], pixels: [{columns}, {rows}]"
    cell.write_text(text.replace("[4800, 3600], pixels: [640, 480]", small))
    return cell


@cache
def chart() -> Floats:
    """Return the light of a chart of 8 patches from dark to bright."""
    shades = np.random.default_rng(3).uniform(0.05, 1.0, 8)
    places = [(12 * i - 24, 18 * j - 18) for i in range(4) for j in range(2)]
    patches = tuple(
        Body(shape=box(x, y, x + 11, y + 16), reflectance=float(shade))
        for shade, (x, y) in zip(shades, places, strict=True)
    )
    return image(Scene(bodies=patches, background=0.02), LENS, SIZE, UM_PER_PX)


def write_lights(
    folder: Path, camera: Camera, lights: Sequence[float], count: int = 1
) -> Path:
    """Write a series of the chart in several lights, `count` frames each."""
    rng = np.random.default_rng(0)
    series = [
        Frame(
            counts=exposed(chart() * light, camera, rng),
            truth=Pose(),
            reading=Reading(light=light),
        )
        for light in lights
        for _ in range(count)
    ]
    write(folder, series, bits=camera.bits)
    return folder


def write_readings(folder: Path, rig: Rig, readings: Sequence[Reading]) -> Path:
    """Write a picture for each reading."""
    write(folder, frames(rig, Pose(), readings), bits=rig.camera.bits)
    return folder
