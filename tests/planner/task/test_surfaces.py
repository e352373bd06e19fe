"""Marks on faces: where they may be, and what a scene shows of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.executor.simulated.cameras.quick_pictures import scene_of
from microplan.executor.simulated.truth import made_truth
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.render import render
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.planner.assembly.initial_state import initial
from microplan.planner.assembly.world import build_world
from microplan.planner.task.surfaces import surfaces
from microplan.planner.views.scenes import world_scene
from microplan.planner.views.zooms import microscope_at
from tests.planner.chips import (
    BODY,
    PART,
    REGIONS,
    SHAPES,
    rectangle,
    turned,
    write_chip,
)
from tests.planner.examples import read
from tests.planner.task.test_part_features import mistake

MARK = "reflectance: 0.9}"


@pytest.fixture
def chip(tmp_path: Path) -> Path:
    return write_chip(tmp_path / "task")


@pytest.mark.parametrize(
    ("at", "said"),
    [
        ((75.0, 0.0), "reaches beyond the face of chip"),  # over its edge
        ((-50.0, 35.0), "reaches beyond the face of chip"),  # over the slot
        ((300.0, 0.0), "reaches beyond the face of chip"),
        ((8.0, -35.0), "marks pads and plus cover each other"),
    ],
)
def test_a_mark_lies_on_its_face_beside_others(
    tmp_path: Path, at: tuple[float, float], said: str
) -> None:
    shapes = {**SHAPES, "PAD": [turned(rectangle(20.0, 20.0), 0.0, at)]}
    file = write_chip(tmp_path / "task", PART, shapes)
    found = mistake(file)
    assert found.code == "MP229"
    assert said in found.message
    line = file.read_text(encoding="utf-8").splitlines()[found.where.line - 1]
    assert "pads:" in line or "plus:" in line


def test_a_mark_has_a_reflectance_that_a_face_can_have(tmp_path: Path) -> None:
    text = PART.replace("pads: {layer: PAD, reflectance: 0.9}",
                        "pads: {layer: PAD, reflectance: 2}")  # fmt: skip
    found = mistake(write_chip(tmp_path / "task", text))
    assert (found.code, "at most 1" in found.message) == ("MP103", True)


def test_a_coating_may_cover_its_whole_face(tmp_path: Path) -> None:
    shapes = {"BODY": [BODY], "COAT": [BODY]}
    part = """
    drawing: {file: chip.dxf, units: um, layers: [BODY]}
    thickness_um: 50
    reflectance: 0.5
    marks: {coat: {layer: COAT, reflectance: 0.9}}
"""
    task = read(write_chip(tmp_path / "task", part, shapes))
    assert task.parts["chip"].marks["coat"].reflectance == 0.9


def test_pads_apart_are_one_mark_and_each_is_a_target(tmp_path: Path) -> None:
    pads = [turned(rectangle(10.0, 10.0), 0.0, (x, 0.0)) for x in (-40.0, 40.0)]
    text = PART + "      left: {kind: outline, layer: PAD, at: [-40, 0]}\n"
    text = text.replace("layer: PAD}", "layer: PAD, ring: 2}")
    file = write_chip(tmp_path / "task", text, {**SHAPES, "PAD": pads})
    found = read(file).parts["chip"].features
    assert found["left"].center_um == pytest.approx((-40, 0))
    assert found["pad"].center_um == pytest.approx((40, 0))
    assert found["left"].symmetry == 4


def test_a_mark_on_a_post_lies_at_its_top(tmp_path: Path) -> None:
    text = PART.replace("reflectance: 0.8}",
                        "reflectance: 0.8, marks: {dot: {layer: DOT, "
                        "reflectance: 0.2}}}")  # fmt: skip
    dot = turned(rectangle(5.0, 5.0), 0.0, REGIONS["rectangle"][0])
    task = read(write_chip(tmp_path / "task", text, {**SHAPES, "DOT": [dot]}))
    faces = surfaces(task.parts["chip"])
    assert faces["block.dot"].z_um == faces["block"].z_um == 70.0
    assert not faces["block.dot"].bright
    scene = world_scene(task, initial(task))
    assert {layer.z_um for layer in scene.layers} == {50.0, 70.0}


@pytest.mark.parametrize("name", ["pocket", "pad", "cross", "rectangle", "slot"])
def test_a_face_shows_its_own_reflectance(chip: Path, name: str) -> None:
    """In the middle of each region, far from all edges, the picture is one number.

    Blurred edges at half the least width of 8 um, 4.6 lambda / A away, have .01 left.
    """
    task = read(chip)
    share = {"slot": 0.1, "pocket": 0.1, "pad": 0.9, "cross": 0.9, "rectangle": 0.8}
    state = initial(task)
    scene = world_scene(task, state)
    scope = microscope_at(task.workcell, 20.0)
    k, pose = scope.px_per_um, state.parts["chip"].pose
    x, y = pose.apply(*task.parts["chip"].features[name].center_um)
    column = round((scope.width_px - 1) / 2 + k * x)
    row = round((scope.height_px - 1) / 2 - k * y)
    heights = {la.name: la.z_um for la in scene.layers}
    focus = heights["chip.block"] if name == "rectangle" else heights["chip"]
    seen = render(
        Scene(layers=scene.layers, background=0.1),
        scope,
        focus_um=focus,
        window=Window(row=row, column=column, rows=1, columns=1),
    )
    assert seen.item() == pytest.approx(share[name], abs=0.02)


def test_a_mark_out_of_focus_is_its_face_plus_a_difference(chip: Path) -> None:
    """Blur is linear: each mark adds its step over the face, blurred by itself.

    The images' band and margin are chosen to 1e-4 of full scale.
    """
    task = read(chip)
    part, state = task.parts["chip"], initial(task)
    scope = microscope_at(task.workcell, 6.9)
    pose = state.parts["chip"].pose

    def blurred(*layers: Layer, background: float = 0.0) -> FloatArray:
        scene = Scene(layers=layers, background=background)
        window = Window(row=180, column=240, rows=120, columns=160)
        return render(scene, scope, focus_um=40.0, window=window)

    def alone(outline: Outline) -> FloatArray:
        there = place(outline, pose.x_um, pose.y_um, pose.theta_rad)
        return blurred(Layer(name="a", outline=there, z_um=50.0, reflectance=1.0))

    flat = [la for la in world_scene(task, state).layers if la.z_um == 50.0]
    expected = 0.1 + (part.reflectance - 0.1) * alone(part.outline)
    for mark in part.marks.values():
        expected += (mark.reflectance - part.reflectance) * alone(mark.outline)
    shown = blurred(*flat, background=0.1)
    np.testing.assert_allclose(shown, expected, atol=1e-4)
    assert np.ptp(shown) > 0.5  # there is something to see


def test_the_layers_of_one_height_cover_each_point_once(chip: Path) -> None:
    """Faces have holes where marks lie: areas add up to that of the plate."""
    task = read(chip)
    layers = world_scene(task, initial(task)).layers
    flat = sum(layer.outline.area_um2 for layer in layers if layer.z_um == 50.0)
    assert flat == pytest.approx(task.parts["chip"].outline.area_um2, rel=1e-12)


def test_the_cell_shows_the_faces_that_the_compiler_does(chip: Path) -> None:
    """By name, area and reflectance; the cell lays the part down elsewhere."""
    task = read(chip)
    world = build_world(task, initial(task))
    streams = ("profile", "start", "tilt", "drift", "stage", "robot", "surface")
    rng = {name: np.random.default_rng(k) for k, name in enumerate(streams)}
    truth = made_truth(world, rng, missing=False)
    shown, meant = (
        {
            layer.name: (layer.outline.area_um2, layer.reflectance)
            for layer in scene.layers
            if layer.name.startswith("chip")
        }
        for scene in (scene_of(truth), world_scene(task, initial(task)))
    )
    assert shown.keys() == meant.keys()
    assert len(meant) == 5
    for name, values in meant.items():
        assert shown[name] == pytest.approx(values, rel=1e-9)


def test_the_world_of_the_cell_has_the_marks(chip: Path) -> None:
    task = read(chip)
    world = build_world(task, initial(task))
    (part,) = world.parts
    assert {(m.name, m.on, m.reflectance) for m in part.marks} == {
        ("chip.mouth", "chip", 0.1),
        ("chip.pads", "chip", 0.9),
        ("chip.plus", "chip", 0.9),
    }
    assert {"chip.mouth", "chip.pads", "chip.plus"} <= set(world.outlines)
