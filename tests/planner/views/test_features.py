"""Other features of a look's body: which there are, under which names."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from microplan.optics.outline.outline import Arc, Outline, Ring, Segment
from microplan.planner.assembly.initial_state import initial
from microplan.planner.task.task import Part, Task
from microplan.planner.views.features import Proposals, offset_um, proposals
from microplan.planner.views.targets import TargetShape, shape_of
from tests.planner.chips import PART, REGIONS, write_chip
from tests.planner.examples import EXAMPLE, read

POST = "shaft_plate.post"
HOLES = {"near": (-20.0, 10.0, 6.0), "far": (30.0, -5.0, 8.0)}  # x, y, radius


@pytest.fixture(scope="module")
def task() -> Task:
    return read(EXAMPLE / "task.yaml")


def found(task: Task, target: str) -> tuple[TargetShape, Proposals]:
    """Return a target and what may stand in for it."""
    state = initial(task)
    shape = shape_of(task, state, target)
    assert shape is not None
    return shape, proposals(task, shape)


def names(some: Proposals) -> set[str]:
    return {shape.name for _, shape in some.others}


def with_part(task: Task, part: Part) -> Task:
    return replace(task, parts={**task.parts, part.name: part})


def avoiding(task: Task, name: str) -> Task:
    """Return the task with one of the gear's features forbidden."""
    gear = task.parts["gear"]
    forbidden = replace(gear.features[name], avoid=True)
    return with_part(task, replace(gear, features={**gear.features, name: forbidden}))


def plate(task: Task) -> Task:
    """Return the task with a plate that has two holes in place of the gear."""
    corners = ((-60.0, -40.0), (60.0, -40.0), (60.0, 40.0), (-60.0, 40.0))
    sides = zip(corners, corners[1:] + corners[:1], strict=True)
    rings = [Ring(edges=tuple(Segment(start=a, end=b) for a, b in sides))]
    gear, features = task.parts["gear"], {}
    for name, (x, y, radius) in HOLES.items():
        arc = Arc(center=(x, y), radius_um=radius, start_rad=0, sweep_rad=-math.tau)
        rings.append(Ring(edges=(arc,)))
        features[name] = replace(
            gear.features["bore"], name=name, center_um=(x, y), radius_um=radius
        )
    outline = Outline(rings=tuple(rings))
    return with_part(task, replace(gear, outline=outline, features=features))


@pytest.mark.parametrize("target", ["gear", "gear.bore", "gear.teeth"])
def test_the_target_is_not_among_the_others(task: Task, target: str) -> None:
    shape, some = found(task, target)
    assert some.target is not None
    assert some.target.name == shape.name
    everything = {"gear.teeth", "gear.bore", "gear.outline"}
    assert names(some) == everything - {shape.name}
    for feature, other in some.others:
        assert (feature.name, feature.kind) == (other.name, other.kind)
        assert other.owner == "gear"


def test_features_of_a_post_go_by_its_name(task: Task) -> None:
    shape, some = found(task, POST)
    assert shape.name == "shaft_plate.post"
    assert some.target is not None
    assert some.target.name == shape.name
    assert some.others == ()  # its outline is the target's own circle


def test_an_outline_of_two_circles_is_another_feature(task: Task) -> None:
    """Its inner rim says as much of the place as the outer one, which is the target."""
    plate_part = task.parts["shaft_plate"]
    post = plate_part.posts["post"]
    bore = Arc(center=(0.0, 0.0), radius_um=9.0, start_rad=0.0, sweep_rad=-math.tau)
    tube = Outline(rings=(*post.outline.rings, Ring(edges=(bore,))))
    posts = {"post": replace(post, outline=tube)}
    _, some = found(with_part(task, replace(plate_part, posts=posts)), POST)
    assert names(some) == {f"{POST}.circle2", f"{POST}.outline1"}


def test_jaws_have_no_features_beside_themselves(task: Task) -> None:
    _, some = found(task, "tweezers")
    assert (some.target, some.others) == (None, ())


@pytest.mark.parametrize("name", ["bore", "outline"])
def test_what_is_avoided_is_not_proposed_either(task: Task, name: str) -> None:
    _, some = found(avoiding(task, name), "gear")
    _, before = found(task, "gear")
    assert names(before) - names(some) == {f"gear.{name}"}


@pytest.mark.parametrize("target", ["gear", "gear.bore"])
def test_an_avoided_notch_tells_no_tooth_from_the_next(task: Task, target: str) -> None:
    forbidden = avoiding(task, "notch")
    for made, broken in ((task, "notch"), (forbidden, "")):
        shape, some = found(made, target)
        assert some.target is not None
        ways = [(some.target, shape), *some.others]
        ((feature, ring),) = [way for way in ways if way[0].kind == "teeth"]
        for one in (feature, ring):
            assert one.symmetry_broken_by == broken
            assert ("notch_rad" in one.parameters) == bool(broken)
        assert {s.name for _, s in ways} == {"gear.teeth", "gear.bore", "gear.outline"}


def test_each_hole_is_where_it_was_drawn(task: Task) -> None:
    shape, some = found(plate(task), "gear.near")
    assert some.target is not None
    assert some.target.center_um == pytest.approx(HOLES["near"][:2])
    others = {s.name: s for _, s in some.others}
    assert "gear.near" not in others
    far = others["gear.far"]
    assert far.center_um == pytest.approx(HOLES["far"][:2])
    assert far.parameters["radius_um"] == pytest.approx(HOLES["far"][2])
    assert not far.bright  # a hole in what is bright
    assert offset_um(far, shape) == pytest.approx((50.0, -15.0))
    x0, y0, x1, y1 = far.box_um
    assert (x0, y0, x1, y1) == pytest.approx((-8, -8, 8, 8))


def test_features_of_other_kinds_come_first(task: Task) -> None:
    _, some = found(plate(task), "gear.near")
    kinds = [shape.kind for _, shape in some.others]
    count = len(set(kinds))
    assert {"outline", "circle", "edge", "corner"} <= set(kinds)
    assert len(set(kinds[:count])) == count
    edges = [f.edge_um for f, _ in some.others if f.kind == "edge"]
    assert edges == sorted(edges, reverse=True)


@pytest.mark.parametrize("name", REGIONS)
def test_declared_regions_of_one_height_stand_in_for_each_other(
    tmp_path: Path, name: str
) -> None:
    """The rectangle is the top of a post; all others lie on the part's face."""
    shape, some = found(read(write_chip(tmp_path / "task")), f"chip.{name}")
    assert shape.name == f"chip.{name}"
    others = {s.name: s for _, s in some.others}
    flat = {f"chip.{other}" for other in REGIONS if other != "rectangle"}
    declared = {s for s in others if s.removeprefix("chip.") in REGIONS}
    assert declared == (set() if name == "rectangle" else flat - {shape.name})
    assert len({s.name for _, s in some.others}) == len(some.others)
    for other in declared:
        assert others[other] == found_shape(tmp_path / "task" / "task.yaml", other)


def found_shape(file: Path, name: str) -> TargetShape | None:
    """Return a target as a look at it has it."""
    task = read(file)
    return shape_of(task, initial(task), name)


def test_a_post_that_is_not_round_is_a_region(tmp_path: Path) -> None:
    file = write_chip(tmp_path / "task")
    post, region = (found_shape(file, f"chip.{n}") for n in ("block", "rectangle"))
    assert post is not None
    assert region is not None
    assert replace(post, name=region.name) == region
    assert (post.kind, post.symmetry, post.has_angle) == ("outline", 2, True)


def test_avoiding_a_region_leaves_the_whole_outline(tmp_path: Path) -> None:
    text = PART.replace("layer: SLOT}", "layer: SLOT, avoid: true}")
    _, some = found(read(write_chip(tmp_path / "task", text)), "chip.cross")
    assert "chip.slot" not in names(some)
    assert {"chip.pad", "chip.pocket"} <= names(some)
    assert ("chip.slot", "outline") in some.avoided
    _, on_part = found(read(tmp_path / "task" / "task.yaml"), "chip")
    assert on_part.target is not None
    assert "chip.slot" not in names(on_part)
