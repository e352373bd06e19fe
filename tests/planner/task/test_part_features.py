"""Regions of parts as features: which ring is meant, where it is, who is refused."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from microplan.arrays import Point
from microplan.optics.outline.outline import Outline, flatten
from microplan.planner.source.diagnostics import Diagnostic, Report
from microplan.planner.task.drawn import svg
from microplan.planner.task.part_summary import part_lines
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Part
from tests.planner.chips import (
    BODY,
    PART,
    REGIONS,
    SHAPES,
    rectangle,
    turned,
    write_chip,
)
from tests.planner.drawings.dxf_text import dxf, path
from tests.planner.drawings.gds_writer import boundary, cell, library
from tests.planner.examples import change, copy_example, read

PLATE = """
    drawing: {file: chip.dxf, units: um, layers: [BODY, HOLES]}
    thickness_um: 50
    reflectance: 0.5
    features: {slot: FEATURE}
"""
# largest first; the two small ones from left to right
HOLES = [
    turned(rectangle(10.0, 6.0), 0.0, (30.0, 0.0)),
    turned(rectangle(40.0, 12.0), 0.0, (-20.0, 30.0)),
    turned(rectangle(10.0, 6.0), 0.0, (-30.0, 0.0)),
]
RANKED: list[Point] = [(-20.0, 30.0), (-30.0, 0.0), (30.0, 0.0)]


def plate(folder: Path, feature: str, **more: str) -> Path:
    """Return a task with a plate that has three holes on one layer."""
    text = PLATE.replace("FEATURE", feature)
    for key, value in more.items():
        text += f"    {key}: {value}\n"
    shapes = {"BODY": [BODY], "HOLES": HOLES}
    return write_chip(folder / "task", text, shapes, target="chip.slot")


def chip(file: Path) -> Part:
    return read(file).parts["chip"]


def mistake(file: Path) -> Diagnostic:
    """Return the only finding of a task that cannot be read."""
    report = Report()
    assert load_task(str(file), report) is None
    (finding,) = report.found
    return finding


@pytest.mark.parametrize("name", REGIONS)
def test_a_region_has_its_place_and_states_its_symmetry(
    tmp_path: Path, name: str
) -> None:
    found = chip(write_chip(tmp_path / "task")).features[name]
    center, order, _ = REGIONS[name]
    assert (found.kind, found.region, found.symmetry) == ("outline", True, order)
    if order > 1:  # else the centroid is not where it was turned about
        assert found.center_um == pytest.approx(center, abs=1e-8)
    assert found.on == {
        "slot": "", "pocket": "mouth", "pad": "pads", "cross": "plus",
        "rectangle": "block",
    }[name]  # fmt: skip
    assert found.hole == (name == "slot")


@pytest.mark.parametrize("number", [1, 2, 3])
def test_rings_of_a_layer_count_by_size_then_place(tmp_path: Path, number: int) -> None:
    feature = f"{{kind: outline, layer: HOLES, ring: {number}}}"
    found = chip(plate(tmp_path, feature)).features["slot"]
    assert found.center_um == pytest.approx(RANKED[number - 1], abs=1e-8)


@pytest.mark.parametrize(
    ("at", "number"),
    [((-35.0, 1.0), 2), ((-25.0, 31.0), 1), ((33.0, 9.0), 3), ((30.0, 0.0), 3)],
)
def test_a_point_chooses_the_ring_around_or_near_it(
    tmp_path: Path, at: Point, number: int
) -> None:
    feature = f"{{kind: outline, layer: HOLES, at: [{at[0]}, {at[1]}]}}"
    found = chip(plate(tmp_path, feature)).features["slot"]
    assert found.center_um == pytest.approx(RANKED[number - 1], abs=1e-8)


def test_a_point_in_the_body_alone_chooses_its_outline(tmp_path: Path) -> None:
    """Without a layer any ring may be meant: here the smallest around it."""
    found = chip(plate(tmp_path, "{kind: outline, at: [70, -50]}")).features["slot"]
    assert found.center_um == pytest.approx((0, 0))
    assert found.radius_um == pytest.approx(100)


def test_however_a_ring_is_chosen_it_is_the_same_task(tmp_path: Path) -> None:
    ways = ("ring: 2", "at: [-30, 0]", "at: [-34.5, 2.9]")
    tasks = [
        read(plate(tmp_path / str(k), f"{{kind: outline, layer: HOLES, {way}}}"))
        for k, way in enumerate(ways)
    ]
    assert tasks[0].normalised == tasks[1].normalised == tasks[2].normalised


@pytest.mark.parametrize(
    ("feature", "code", "said"),
    [
        ("{kind: outline, layer: HOLES}", "MP228",
         r"3 rings on layer 'HOLES'.*1 is 40 x 12 about \(-20, 30\), 2 is 10 x 6"),
        ("{kind: outline, layer: NOWHERE}", "MP221", "neither the part's outline"),
        ("{kind: outline, layer: HOLES, ring: 4}", "MP221", "ring 4 of 3"),
        ("{kind: outline, layer: HOLES, ring: 2, at: [0, 0]}", "MP109", "beside"),
        ("{kind: outline, layer: HOLES, ring: 0}", "MP103", "at least 1"),
        ("{kind: outline, layer: HOLES, at: [1]}", "MP106", "at least 2"),
        ("{kind: circle, layer: HOLES, ring: 2}", "MP221", "is a circle"),
    ],
)  # fmt: skip
def test_a_region_that_is_not_clear_is_refused_at_its_line(
    tmp_path: Path, feature: str, code: str, said: str
) -> None:
    file = plate(tmp_path, feature)
    found = mistake(file)
    assert found.code == code
    assert re.search(said, found.message)
    text = file.read_text(encoding="utf-8").splitlines()
    assert "features: {slot" in text[found.where.line - 1]


def test_a_region_whose_ring_is_open_is_refused_at_its_line(tmp_path: Path) -> None:
    """Of a layer of the part, of a post, of a mark."""
    for layer, line in (("SLOT", "layers"), ("RECT", "posts"), ("CROSS", "plus:")):
        file = write_chip(tmp_path / layer)
        shapes = {**SHAPES, layer: []}
        entities = [path(r, name) for name, rings in shapes.items() for r in rings]
        entities.append(path(SHAPES[layer][0], layer, closed=False))
        file.with_name("chip.dxf").write_text(dxf(*entities), encoding="ascii")
        found = mistake(file)
        assert found.code == "MP205"
        text = file.read_text(encoding="utf-8").splitlines()
        assert line in text[found.where.line - 1]


@pytest.mark.parametrize(
    ("origin", "point"),
    [("centre", (0.0, -1.25)), ("[12.5, -3]", (12.5, -3.0)), ("slot", RANKED[0])],
)
def test_an_origin_is_a_point_of_the_drawing(
    tmp_path: Path, origin: str, point: Point
) -> None:
    """The centroid by hand: the holes take 480 at y = 30 and 120 at 0 of 19200 um2."""
    if origin == "centre":
        area = 160 * 120 - 480 - 120
        point = (480 * 20 / area, -480 * 30 / area)
    feature = "{kind: outline, layer: HOLES, ring: 1}"
    part = chip(plate(tmp_path, feature, origin=origin))
    low = part.outline.bounds_um[:2]
    assert low == pytest.approx((-80 - point[0], -60 - point[1]), abs=1e-8)
    center = part.features["slot"].center_um
    assert center == pytest.approx((-20 - point[0], 30 - point[1]), abs=1e-8)


def test_a_feature_called_centre_comes_before_the_centroid(tmp_path: Path) -> None:
    file = plate(tmp_path, "{kind: outline, layer: HOLES, ring: 1}", origin="centre")
    text = file.read_text(encoding="utf-8").replace("slot", "centre")
    file.write_text(text, encoding="utf-8")
    assert chip(file).features["centre"].center_um == (0, 0)


def test_the_way_rings_are_drawn_changes_nothing(tmp_path: Path) -> None:
    """Run the other way round, and every edge in two pieces."""
    one = read(write_chip(tmp_path / "one"))
    shapes: dict[str, list[list[Point]]] = {}
    for layer, rings in SHAPES.items():
        shapes[layer] = []
        for ring in rings:
            ends = [*ring[1:], ring[0]]
            cut = [
                p
                for (x, y), (ex, ey) in zip(ring, ends, strict=True)
                for p in ((x, y), ((x + ex) / 2, (y + ey) / 2))
            ]
            shapes[layer].append(cut[::-1])
    other = read(write_chip(tmp_path / "other", PART, shapes))
    assert other.normalised == one.normalised
    for name, feature in one.parts["chip"].features.items():
        again = other.parts["chip"].features[name]
        assert (again.symmetry, again.ring, again.on) == (
            feature.symmetry, feature.ring, feature.on
        )  # fmt: skip
        assert again.center_um == pytest.approx(feature.center_um, abs=1e-8)


def test_the_summary_and_the_picture_have_regions_and_marks(tmp_path: Path) -> None:
    part = chip(write_chip(tmp_path / "task"))
    lines = "\n".join(part_lines(part))
    assert "mark plus: 30 x 30 um, 416 um2, reflectance 0.9" in lines
    assert "region cross: 30 x 30 um about (0, -35), on plus, 4-fold" in lines
    assert "layer CROSS: 12 LINE -> 1 ring of 12 edges" in lines
    assert svg(part).count('class="flat"') == len(part.marks) == 3


def straight(outline: Outline) -> dict[str, list[list[Point]]]:
    """Return rings as polygons of chords that err by 10 nm, by layer."""
    found: dict[str, list[list[Point]]] = {}
    for ring in outline.rings:
        corners = [(float(x), float(y)) for x, y in flatten(ring, 0.01)]
        found.setdefault(ring.layer, []).append(corners)
    return found


def as_dxf(file: Path) -> None:
    """Draw the example's gear of straight lines."""
    rings = straight(read(file).parts["gear"].outline)
    entities = [path(ring, layer) for layer, some in rings.items() for ring in some]
    drawing = file.with_name("parts") / "gear18.dxf"
    drawing.write_text(dxf(*entities), encoding="ascii")


def as_gds(file: Path) -> None:
    """Draw the example's gear as polygons on a grid of 1 nm."""
    rings = straight(read(file).parts["gear"].outline)
    elements = []
    for number, layer in ((1, "OUTLINE"), (2, "BORE")):
        (ring,) = rings[layer]
        nm = np.round(np.array(ring) * 1e3).astype(int).tolist()
        elements.append(boundary([(x, y) for x, y in nm], layer=number))
        text = file.read_text(encoding="utf-8")
        text = text.replace(f"layer: {layer}", f"layer: {number}/0")
        file.write_text(text, encoding="utf-8")
    change(file, "gear18.dxf, units: um, layers: [OUTLINE, BORE]",
           "gear18.gds, units: um, layers: [1/0, 2/0]")  # fmt: skip
    drawing = file.with_name("parts") / "gear18.gds"
    drawing.write_bytes(library(cell("GEAR", *elements)))


@pytest.mark.parametrize("way", [as_dxf, as_gds])
def test_a_gear_of_straight_edges_is_the_gear_of_arcs(
    tmp_path: Path, way: Callable[[Path], None]
) -> None:
    """Teeth, phase, notch and bore; GDSII rounds to 1 nm, two roots of half of it."""
    file = copy_example(tmp_path / "task")
    one = read(file).parts["gear"].features
    way(file)
    other = read(file).parts["gear"].features
    for name in ("teeth", "bore", "notch"):
        a, b = one[name], other[name]
        assert (b.kind, b.count, b.hole) == (a.kind, a.count, a.hole)
        assert b.center_um == pytest.approx(a.center_um, abs=1e-3)
        assert b.radius_um == pytest.approx(a.radius_um, abs=1e-3)
        assert b.root_um == pytest.approx(a.root_um, abs=1e-3)
        assert b.width_um == pytest.approx(a.width_um, abs=2e-3)
        period = math.tau / a.count
        apart = math.remainder(b.phase_rad - a.phase_rad, period)
        assert abs(apart) * 25 < 1e-3
