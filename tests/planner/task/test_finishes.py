"""Walls and faces: stated, or anything that their material may be."""

from __future__ import annotations

from pathlib import Path

import pytest

from microplan.planner.assembly.initial_state import initial
from microplan.planner.assembly.world import build_world
from microplan.planner.task.finishes import surface_finish
from microplan.planner.views.scenes import world_scene
from tests.planner.examples import change, copy_example, read


@pytest.mark.parametrize(
    ("raw", "material", "wall", "finish"),
    [
        ({}, "nickel", (0.0, 0.88), (0.0, 1.0)),
        ({}, " Silicon", (0.0, 0.76), (0.0, 1.0)),
        ({}, "", (0.0, 0.9), (0.0, 1.0)),
        ({"wall": {"kind": "black"}, "finish": 0.2}, "nickel", (0, 0), (0.2, 0.2)),
        ({"wall": {"kind": "mirror"}}, "nickel", (0.0, 0.88), (0.0, 1.0)),
        ({"wall": {"kind": "mirror", "reflectance": 0.7}, "finish": [0, 0.5]},
         "", (0.7, 0.7), (0.0, 0.5)),
    ],
)  # fmt: skip
def test_what_is_unstated_may_be_anything_its_material_is(
    raw: dict[str, object],
    material: str,
    wall: tuple[float, float],
    finish: tuple[float, float],
) -> None:
    found = surface_finish(raw, material)
    assert (found.wall, found.finish) == (wall, finish)


def test_images_take_the_middle_of_what_is_stated() -> None:
    plain = surface_finish({}, "nickel")
    assert (plain.seen_wall, plain.seen_finish) == (0.0, 0.0)
    wall = {"kind": "mirror", "reflectance": [0.6, 0.8]}
    stated = surface_finish({"wall": wall, "finish": [0.0, 0.5]})
    assert (stated.seen_wall, stated.seen_finish) == pytest.approx((0.7, 0.25))


def test_bodies_in_scenes_and_the_world_have_walls(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "x")
    change(file, "material: nickel", "material: nickel\n    finish: 0.3")
    change(file, "height_um: 250,", "height_um: 250, wall: {kind: black},")
    task = read(file)
    state = initial(task)
    layers = {layer.name: layer for layer in world_scene(task, state).layers}
    gear, post = layers["gear"], layers["shaft_plate.post"]
    assert (gear.underside_um, gear.z_um, gear.finish) == (0.0, 100.0, 0.3)
    assert post.underside_um == post.z_um - 250.0
    assert layers["shaft_plate"].underside_um is None  # it has no thickness
    world = build_world(task, state)
    (seen,) = (part for part in world.parts if part.name == "gear")
    assert (seen.wall_reflectance, seen.finish) == ((0.0, 0.88), (0.3, 0.3))
    (tool,) = world.tools
    assert (tool.wall_reflectance, tool.finish) == ((0.0, 0.9), (0.0, 1.0))
