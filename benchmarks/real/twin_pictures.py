"""A part in pictures of its twin: right ones, and windows without it."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from ezdxf.filemanagement import new
from skimage.io import imsave

from benchmarks.truth.examples import GEAR
from microplan.arrays import FloatArray
from validation.twins.camera import Camera, Scene, picture
from validation.twins.raster import Grid, Lens, Pose

ZOOM = 20.0
NEAR = "146px,120px,10"  # where the part is about, and its angle
RADIUS_UM, FLAT_UM = 30.0, 20.0  # a disc whose side is cut
_GRID = Grid(rows=240, columns=320, um_per_px=7.5 / ZOOM)
_LENS = Lens(aperture=0.42, wavelength_um=0.6)
_CAMERA = Camera()
_ANGLE_RAD = math.radians(10.0)
_SPREAD_UM, _SPREAD_RAD = 0.6, 0.01
# The machine-vision camera whose noise falls with the light: level, counts of noise.
_FALLING = ((0.0, 5.0), (90.0, 4.2), (149.0, 3.2), (207.0, 2.1), (237.0, 1.3))


def disc(radius_um: float = RADIUS_UM, flat_um: float = FLAT_UM) -> FloatArray:
    """Return a disc cut at x = `flat_um`, (N, 2)."""
    corner = math.acos(flat_um / radius_um) if flat_um < radius_um else 0.0
    angle = np.linspace(corner, 2 * math.pi - corner, 1440, endpoint=corner > 0)
    return radius_um * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """How pictures are taken, as the workcell does not state it."""

    scene: Scene
    camera: Camera = _CAMERA
    lens: Lens = _LENS


_PART = Scene(rings=[disc()])
USUAL = Condition(
    scene=replace(_PART, dust=15, halo=(0.06, 2.5)),
    camera=Camera(gamma=0.7, black=-20.0, noise=_FALLING),
    lens=replace(_LENS, defocus_um=0.7, waves={"spherical": 0.04, "coma": 0.03}),
)
CONDITIONS: Mapping[str, Condition] = {
    "as stated": Condition(scene=_PART),
    "gamma .6": Condition(scene=_PART, camera=Camera(gamma=0.6)),
    "gamma 1.5": Condition(scene=_PART, camera=Camera(gamma=1.5)),
    "black -30": Condition(scene=_PART, camera=Camera(black=-30.0)),
    "halo": Condition(scene=replace(_PART, halo=(0.1, 2.5))),
    "dust": Condition(scene=replace(_PART, dust=40)),
    "gradient": Condition(scene=replace(_PART, gradient=0.3)),
    "spherical": Condition(scene=_PART, lens=replace(_LENS, waves={"spherical": 0.08})),
    "defocus": Condition(scene=_PART, lens=replace(_LENS, defocus_um=1.5)),
    "all together": USUAL,
}
WRONG: Mapping[str, FloatArray | None] = {
    "5 % larger": disc(1.05 * RADIUS_UM, 1.05 * FLAT_UM),
    "5 % smaller": disc(0.95 * RADIUS_UM, 0.95 * FLAT_UM),
    "no flat": disc(RADIUS_UM, RADIUS_UM),
    "flat 5 um off": disc(RADIUS_UM, FLAT_UM + 5),
    "square": np.array([(-30.0, -30.0), (20.0, -30.0), (20.0, 30.0), (-30.0, 30.0)]),
    "nothing": None,
}


def write_task(folder: Path) -> tuple[Path, Path]:
    """Write the part's drawing and a workcell of its camera; return both."""
    example = GEAR.file.parent
    shutil.copytree(example / "parts", folder / "parts")
    text = (example / "workcell.yaml").read_text(encoding="utf-8")
    small = text.replace(
        "[4800, 3600], pixels: [640, 480]", "[2400, 1800], pixels: [320, 240]"
    )
    cell = folder / "workcell.yaml"
    cell.write_text(small, encoding="utf-8")
    document = new()
    document.header["$INSUNITS"] = 13  # um
    corner = math.degrees(math.acos(FLAT_UM / RADIUS_UM))
    space, layer = document.modelspace(), {"layer": "DISC"}
    space.add_arc((0, 0), RADIUS_UM, corner, -corner, dxfattribs=layer)
    y = math.sqrt(RADIUS_UM**2 - FLAT_UM**2)
    space.add_line((FLAT_UM, -y), (FLAT_UM, y), dxfattribs=layer)
    drawing = folder / "disc.dxf"
    document.saveas(drawing)
    return drawing, cell


def pictures(
    folder: Path, condition: Condition, count: int
) -> Iterator[tuple[Path, tuple[float, float]]]:
    """Write pictures of a condition; yield each with where the part's box is, um."""
    folder.mkdir()
    for number in range(count):
        rng = np.random.default_rng([number, 7])
        x, y = rng.normal(0, _SPREAD_UM, 2)
        turn = _ANGLE_RAD + rng.normal(0, _SPREAD_RAD)
        pose = Pose(x_um=x, y_um=y, theta_rad=turn)
        seen = picture(
            condition.scene, pose, condition.lens, condition.camera, _GRID, rng
        )
        file = folder / f"{number:03}.png"
        imsave(str(file), seen.astype(np.uint8), check_contrast=False)
        middle = (FLAT_UM - RADIUS_UM) / 2
        yield file, (x + middle * math.cos(turn), y + middle * math.sin(turn))


def wrong(shape: FloatArray | None) -> Condition:
    """Return the usual condition with another part, or none, in the part's place."""
    rings = [] if shape is None else [shape]
    return replace(USUAL, scene=replace(USUAL.scene, rings=rings))
