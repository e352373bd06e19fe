"""A chip with a region of each kind: hole, post and marks; drawn line by line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from microplan.arrays import Point
from tests.planner.drawings.dxf_text import Tags, dxf, path
from tests.planner.examples import EXAMPLE

Shapes = Mapping[str, Sequence[Sequence[Point]]]  # rings by layer

BODY = [(-80.0, -60.0), (80.0, -60.0), (80.0, 60.0), (-80.0, 60.0)]


def turned(points: Sequence[Point], degrees: float, at: Point) -> list[Point]:
    """Return points turned about the origin, then moved."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return [(at[0] + c * x - s * y, at[1] + s * x + c * y) for x, y in points]


def rectangle(width: float, height: float) -> list[Point]:
    """Return the corners of a rectangle about the origin."""
    x, y = width / 2, height / 2
    return [(-x, -y), (x, -y), (x, y), (-x, y)]


def slot(length: float, width: float, steps: int = 24) -> list[Point]:
    """Return a slot with round ends about the origin, `steps` chords each."""
    half, r = (length - width) / 2, width / 2
    angles = [math.pi * (k / steps - 0.5) for k in range(steps + 1)]
    right = [(half + r * math.cos(a), r * math.sin(a)) for a in angles]
    return right + [(-x, -y) for x, y in right]


def cross(size: float, arm: float) -> list[Point]:
    """Return a cross about the origin."""
    a, b = size / 2, arm / 2
    quarter = [(a, -b), (a, b), (b, b)]
    return [p for k in range(4) for p in turned(quarter, 90.0 * k, (0.0, 0.0))]


# a corner cut off one end: the way round of its pocket is seen
MOUTH = [(-14.0, -9.0), (14.0, -9.0), (14.0, 3.0), (8.0, 9.0), (-14.0, 9.0)]
SHAPES: Shapes = {
    "BODY": [BODY],
    "SLOT": [turned(slot(40.0, 12.0), 25.0, (-50.0, 35.0))],
    "MOUTH": [turned(MOUTH, 10.0, (45.0, 35.0))],
    "PAD": [turned(rectangle(20.0, 20.0), 15.0, (-50.0, -35.0))],
    "CROSS": [turned(cross(30.0, 8.0), 0.0, (0.0, -35.0))],
    "RECT": [turned(rectangle(30.0, 16.0), -20.0, (50.0, -35.0))],
}
SIGMAS = "sigma_xy_um: 2, sigma_theta_deg: 1"
PART = """
    drawing: {file: chip.dxf, units: um, layers: [BODY, SLOT]}
    thickness_um: 50
    reflectance: 0.5
    posts: {block: {layer: RECT, height_um: 20, reflectance: 0.8}}
    marks:
      mouth: {layer: MOUTH, reflectance: 0.1}
      pads: {layer: PAD, reflectance: 0.9}
      plus: {layer: CROSS, reflectance: 0.9}
    features:
      slot: {kind: outline, layer: SLOT}
      pocket: {kind: outline, layer: MOUTH}
      pad: {kind: outline, layer: PAD}
      cross: {kind: outline, layer: CROSS}
      rectangle: {kind: outline, layer: RECT}
"""
# place, order of symmetry, whether it is brighter than what is around it
REGIONS: Mapping[str, tuple[Point, int, bool]] = {
    "slot": ((-50.0, 35.0), 2, False),
    "pocket": ((45.0, 35.0), 1, False),
    "pad": ((-50.0, -35.0), 4, True),
    "cross": ((0.0, -35.0), 4, True),
    "rectangle": ((50.0, -35.0), 2, True),
}


def drawn(shapes: Shapes = SHAPES) -> str:
    """Return a DXF file of rings, a LINE an edge."""
    entities: list[Tags] = []
    for layer, rings in shapes.items():
        entities += [path(ring, layer) for ring in rings]
    return dxf(*entities)


def write_chip(
    folder: Path, part: str = PART, shapes: Shapes = SHAPES, target: str = "chip"
) -> Path:
    """Return the task file of a look at the chip, with its drawing beside it."""
    folder.mkdir(parents=True)
    (folder / "chip.dxf").write_text(drawn(shapes), encoding="ascii")
    cell = (EXAMPLE / "workcell.yaml").read_text(encoding="utf-8")
    fingers = EXAMPLE / "parts" / "tweezer_fingers.dxf"
    (folder / "parts").mkdir()
    (folder / "parts" / fingers.name).write_bytes(fingers.read_bytes())
    (folder / "workcell.yaml").write_text(cell, encoding="utf-8")
    file = folder / "task.yaml"
    file.write_text(
        f"""microplan: 1
name: chip
workcell: workcell.yaml
seed: 7
parts:
  chip:{part}
start:
  stage: {{}}
  chip: {{on: stage, x_um: 0, y_um: 0, theta_deg: 3, {SIGMAS}}}
steps:
  - {{id: look, do: locate, target: {target}, view_um: [0, 0]}}
benchmark:
  focus_sigma_um: 1
  pose_sigma_xy_um: 1
  pose_sigma_theta_deg: 1
""",
        encoding="utf-8",
    )
    return file
