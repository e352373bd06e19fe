"""A part in pictures of its twin: right ones, and windows with something else."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from skimage.io import imsave
from skimage.measure import find_contours

from benchmarks.truth.examples import GEAR
from microplan.arrays import FloatArray
from validation.twins.camera import Camera, dusted, exposed, graded
from validation.twins.optics import Optics, image
from validation.twins.scenes import Body, Scene, Shape, dot, placed, write_dxf
from validation.twins.series import Pose

ZOOM = 20.0
SIZE, UM_PER_PX = (240, 320), 7.5 / ZOOM
NEAR = "159px,120px,10"  # where the part is about, and its angle
ANGLE_RAD = math.radians(10.0)
_SPREAD_UM, _SPREAD_RAD = 0.6, 0.01
PART, GROUND = 0.8, 0.1  # reflectances
# The machine-vision camera whose noise falls with the light: level, variance.
FALLING = ((0.0, 25.0), (90.0, 17.6), (149.0, 10.2), (207.0, 4.4), (237.0, 1.7))
_EVEN = ((0.0, 2.25), (255.0, 2.25))
LENS = Optics(aperture=0.42, wavelength_um=0.6)
CAMERA = Camera(gain=1.05, noise_table=_EVEN)


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """How pictures are taken, as the workcell does not state it."""

    lens: Optics = LENS
    camera: Camera = CAMERA
    specks: int = 0  # of dust
    gradient: float = 0.0  # of light across the picture


TOGETHER = Condition(
    lens=replace(LENS, focus_um=-0.7, zernike={11: 0.04, 8: 0.03}, halo=(1.0, 0.06)),
    camera=replace(CAMERA, gamma=0.7, black=-20.0, noise_table=FALLING),
    specks=15,
)
CONDITIONS: Mapping[str, Condition] = {
    "as stated": Condition(),
    "gamma .6": Condition(camera=replace(CAMERA, gamma=0.6)),
    "gamma 1.5": Condition(camera=replace(CAMERA, gamma=1.5)),
    "black -30": Condition(camera=replace(CAMERA, black=-30.0)),
    "halo": Condition(lens=replace(LENS, halo=(1.0, 0.1))),
    "dust": Condition(specks=40),
    "gradient": Condition(gradient=0.3),
    "spherical": Condition(lens=replace(LENS, zernike={11: 0.08})),
    "defocus": Condition(lens=replace(LENS, focus_um=-1.5)),
    "all together": TOGETHER,
}


def write_part(
    folder: Path, shape: Shape, size: tuple[int, int] = SIZE
) -> tuple[Path, Path]:
    """Write a part's drawing and a workcell of a camera of (rows, columns) pixels."""
    example = GEAR.file.parent
    shutil.copytree(example / "parts", folder / "parts")
    text = (example / "workcell.yaml").read_text(encoding="utf-8")
    rows, columns = size
    sensor_um = [7.5 * columns, 7.5 * rows]
    own = text.replace(
        "[4800, 3600], pixels: [640, 480]", f"{sensor_um}, pixels: [{columns}, {rows}]"
    )
    cell = folder / "workcell.yaml"
    cell.write_text(own, encoding="utf-8")
    drawing = folder / "part.dxf"
    write_dxf(shape, drawing, "PART")
    return drawing, cell


def write_pictures(
    folder: Path, shape: Shape | None, condition: Condition, count: int
) -> Iterator[tuple[Path, Pose]]:
    """Write pictures of a shape, or of none; yield each with its pose."""
    folder.mkdir(parents=True)
    for number in range(count):
        rng = np.random.default_rng([number, 7])
        x, y = rng.normal(0, _SPREAD_UM, 2)
        pose = Pose(
            x_um=float(x), y_um=float(y),
            theta_rad=ANGLE_RAD + float(rng.normal(0, _SPREAD_RAD)),
        )  # fmt: skip
        light = image(_scene(shape, pose), condition.lens, SIZE, UM_PER_PX)
        light = graded(dusted(light, condition.specks, rng), condition.gradient)
        file = folder / f"{number:03}.png"
        counts = exposed(light, condition.camera, rng).astype(np.uint8)
        imsave(str(file), counts, check_contrast=False)
        yield file, pose


def _scene(shape: Shape | None, pose: Pose) -> Scene:
    """Return a shape at a pose on dark ground."""
    if shape is None:
        return Scene(bodies=(), background=GROUND)
    lies = placed(shape, pose.x_um, pose.y_um, pose.theta_rad)
    return Scene(bodies=(Body(shape=lies, reflectance=PART),), background=GROUND)


def disc_middle_um(lens: Optics) -> FloatArray:
    """Return the middle of a disc of 30 um in a lens' picture in focus, (x, y) um.

    That of the circle through its edges at half their step.
    """
    disc = Body(shape=dot(30.0), reflectance=PART)
    scene = Scene(bodies=(disc,), background=GROUND)
    light = image(scene, replace(lens, focus_um=0.0), SIZE, UM_PER_PX)
    row, column = max(find_contours(light, (PART + GROUND) / 2), key=len).T  # type: ignore[no-untyped-call]
    x = (column - (SIZE[1] - 1) / 2) * UM_PER_PX
    y = ((SIZE[0] - 1) / 2 - row) * UM_PER_PX
    known = np.stack([2 * x, 2 * y, np.ones_like(x)], axis=1)
    found, *_ = np.linalg.lstsq(known, x**2 + y**2)
    return np.asarray(found[:2])
