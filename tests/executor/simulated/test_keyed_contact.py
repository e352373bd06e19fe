"""Parts with keyed holes in the simulated cell: seating, resting, pushing, judging."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from microplan.executor.simulated.cell import Cell, build_cell
from microplan.executor.simulated.contact import hole_over, lean, posts
from microplan.executor.simulated.keeping import restore, state_of
from microplan.executor.simulated.outlines.flattening import SAGITTA_UM
from microplan.executor.simulated.outlines.pushing import FREE_UM
from microplan.executor.simulated.shapes import is_hole
from microplan.executor.simulated.truth import TrueBody
from microplan.schemas.files.world import World, WorldOutline, WorldPost, WorldRing
from microplan.schemas.pose import Pose
from tests.executor.bench import quiet, world
from tests.executor.simulated.keyed import (
    Drawn,
    Keyed,
    as_hole,
    bore_with_key,
    circle,
    cross,
    d_shape,
    rectangle,
    slot,
    spline,
)

SAFE_UM = 2 * SAGITTA_UM + 2 * FREE_UM
PAIRS = {  # each fits the gear: 45 um at its roots; and the angle beyond its play
    "d": (d_shape(33.0, 20.0), d_shape(30.0, 18.0), 0.1),
    "key": (spline(1, 28.0, 38.0, 12.0), spline(1, 26.0, 36.0, 10.0), 0.05),
    "inner key": (bore_with_key(30.0, 20.0, 8.0), bore_with_key(28.0, 18.0, 11.0), 0.1),
    "spline": (spline(6, 28.0, 36.0, 10.0), spline(6, 26.0, 34.0, 8.0), 0.05),
    "cross": (cross(38.0, 16.0), cross(36.0, 13.0), 0.06),
    "rectangle": (rectangle(60.0, 24.0), rectangle(56.0, 22.0), 0.05),
    "slot": (slot(50.0, 12.0), slot(50.0, 10.0), 0.1),
}


def drawn(edges: Drawn, *, x: float = 0.0) -> WorldRing:
    """Return a ring for a world, shifted along x."""
    moved = (
        (e[0] + x, e[1], e[2] + x, e[3]) if len(e) == 4 else (e[0] + x, *e[1:])
        for e in edges
    )
    return WorldRing(layer="", edges=tuple(moved))


def keyed(holes: list[WorldRing], rings: list[WorldRing]) -> World:
    """Return the quiet world with these holes in the gear, these posts on the plate."""
    found = quiet(world())
    gear, plate = found.parts
    outer = [ring for ring in gear.outline.rings if not is_hole(ring)]
    gear = replace(gear, outline=WorldOutline(rings=(*outer, *holes)))
    made: list[WorldPost] = [
        replace(plate.posts[0], name=f"shaft_plate.{name}",
                outline=WorldOutline(rings=(ring,)))
        for name, ring in zip(("post", "second"), rings, strict=False)
    ]  # fmt: skip
    return replace(found, parts=(gear, replace(plate, posts=tuple(made))))


def pair(hole: Keyed, post: Keyed) -> Cell:
    """Return a cell with one hole in the gear and one post on the plate."""
    return build_cell(keyed([drawn(as_hole(hole.edges))], [drawn(post.edges)]), 1)


def gear(found: Cell) -> TrueBody:
    return found.truth.bodies["gear"]


def assemble(
    found: Cell, *, off_um: tuple[float, float] = (0.0, 0.0), turn: float = 0.0
) -> None:
    """Put the gear, as held far behind, down on the plate `turn` off; let it go."""
    truth, body = found.truth, gear(found)
    found.stage.move(x_um=0.0, y_um=0.0, z_um=-255.0)
    truth.carry(
        body, "robot", Pose(x_um=off_um[0], y_um=off_um[1], theta_rad=turn), 0.0
    )
    truth.held = "gear"
    found.stage.move(z_um=0.0)
    found.jaws.move(130.0)


@pytest.mark.parametrize("name", PAIRS)
def test_a_keyed_part_seats_in_its_angle_and_rests_on_top_in_another(name: str) -> None:
    hole, post, beyond = PAIRS[name]
    for turn, seats in ((0.0, True), (beyond, False)):
        found = pair(hole, post)
        assemble(found, turn=turn)
        verdict = found.judge("gear", "shaft_plate.post", 0.0, 0.2)
        assert verdict.success == seats, (turn, verdict)
        assert verdict.height_um == pytest.approx(0.0 if seats else 250.0, abs=1e-6)
        assert verdict.turn_rad == pytest.approx(turn, abs=1e-9)
        assert verdict.collided == ""


@pytest.mark.parametrize(
    ("hole", "post"),
    [
        (d_shape(33.0, 20.0), circle(30.0)),
        (bore_with_key(33.0, 20.0, 8.0), circle(30.0)),
        (circle(33.0), spline(1, 30.0, 36.0, 10.0)),
    ],
    ids=["a flat in the bore", "a key in the bore", "a key on the post"],
)
def test_what_only_radii_would_seat_stays_on_top(hole: Keyed, post: Keyed) -> None:
    found = pair(hole, post)
    assemble(found)
    verdict = found.judge("gear", "shaft_plate.post")
    assert not verdict.success
    assert verdict.height_um == pytest.approx(250.0)


def test_an_angle_beyond_what_is_asked_for_is_no_success() -> None:
    found = pair(d_shape(33.0, 20.0), d_shape(30.0, 18.0))
    assemble(found, turn=0.08)  # within the play of .086
    assert found.judge("gear", "shaft_plate.post").success
    assert found.judge("gear", "shaft_plate.post", 0.0, 0.081).success
    assert not found.judge("gear", "shaft_plate.post", 0.0, 0.079).success


@pytest.mark.parametrize("name", PAIRS)
def test_a_post_pushes_its_hole_until_it_is_inside_again(name: str) -> None:
    hole, post, _ = PAIRS[name]
    found = pair(hole, post)
    truth, body = found.truth, gear(found)
    host, peg = next(iter(posts(truth)))
    body.pose = Pose(x_um=1.0, y_um=3.0, theta_rad=0.03)  # the plate is at the origin
    body.on_posts["shaft_plate.post"] = 0
    assert hole_over(truth, body, host, peg) is None
    lean(truth, body)
    assert hole_over(truth, body, host, peg) == 0
    there = body.pose
    assert 0 < truth.pushed_um < 5
    # the shift is counted in the hole, at most 5 um from the part's origin
    shift_um = math.dist((there.x_um, there.y_um), (1.0, 3.0))
    assert shift_um <= truth.pushed_um + 5.0 * abs(there.theta_rad - 0.03)
    assert truth.collided == ""
    lean(truth, body)
    assert body.pose == there  # it touches, and nothing pushes any more


def test_a_flat_pushes_straight_by_what_it_stands_out() -> None:
    found = pair(rectangle(60.0, 24.0), rectangle(56.0, 22.0))
    body = gear(found)
    body.pose = Pose(x_um=0.5, y_um=2.75)
    body.on_posts["shaft_plate.post"] = 0
    lean(found.truth, body)
    assert found.truth.pushed_um == pytest.approx(1.75, abs=SAFE_UM)
    assert body.pose.x_um == pytest.approx(0.5, abs=SAFE_UM)
    assert body.pose.y_um == pytest.approx(1.0, abs=SAFE_UM)
    assert abs(body.pose.theta_rad) < 2 * FREE_UM / 56.0  # along the flat


def test_a_keyed_post_drifts_with_its_part_and_bends_at_last() -> None:
    found = pair(d_shape(33.0, 20.0), d_shape(30.0, 18.0))
    truth, body = found.truth, gear(found)
    body.pose = Pose(x_um=0.0, y_um=0.0)
    body.on_posts["shaft_plate.post"] = 0
    for step in range(1, 9):
        body.pose = replace(body.pose, y_um=body.pose.y_um + 1.0)
        lean(truth, body)
        # 3 um of play across: every um beyond it is pushed back
        assert truth.pushed_um == pytest.approx(max(step - 3.0, 0.0), abs=0.05)
    assert truth.collided == ""
    body.pose = replace(body.pose, y_um=body.pose.y_um + 1.0)
    lean(truth, body)
    assert truth.collided == "shaft_plate.post was bent by gear"


def test_a_post_that_is_too_large_for_its_hole_is_bent() -> None:
    found = pair(d_shape(33.0, 20.0), circle(30.0))
    gear(found).pose = Pose(x_um=0.0, y_um=0.0)
    gear(found).on_posts["shaft_plate.post"] = 0
    lean(found.truth, gear(found))
    assert found.truth.collided == "shaft_plate.post was bent by gear"


def test_a_seated_part_is_grasped_and_lifted_off_its_post() -> None:
    """It stays on its post as the jaws close, and leaves it above."""
    found = pair(d_shape(33.0, 20.0), d_shape(30.0, 18.0))
    body = gear(found)
    assemble(found)
    assert body.on_posts == {"shaft_plate.post": 0}
    found.robot.move(x_um=0.0, y_um=0.0)
    found.robot.move(z_um=30.0)
    found.jaws.move(96.0)
    assert found.truth.held == "gear"
    assert body.on_posts == {"shaft_plate.post": 0}
    found.stage.move(z_um=-260.0)
    assert body.on_posts == {}
    assert found.truth.collided == ""


def two_pins(apart_um: float) -> Cell:
    """Return a cell with two round posts 40 um apart and two holes `apart_um` apart."""
    hole, post = as_hole(circle(12.0).edges), circle(10.0).edges
    holes = [drawn(hole, x=s * apart_um / 2) for s in (-1, 1)]
    return build_cell(keyed(holes, [drawn(post, x=s * 20.0) for s in (-1, 1)]), 1)


@pytest.mark.parametrize(
    ("apart_um", "seats"), [(40.0, True), (43.9, True), (44.1, False)]
)
def test_two_posts_go_into_two_holes(apart_um: float, *, seats: bool) -> None:
    """2 um of play each: holes 4 um farther apart than posts are the limit."""
    found = two_pins(apart_um)
    assemble(found)
    for post in ("post", "second"):
        verdict = found.judge("gear", f"shaft_plate.{post}")
        assert verdict.success == seats, verdict
    assert set(gear(found).on_posts.values()) == ({0, 1} if seats else set())


def test_two_posts_hold_the_angle_of_their_part() -> None:
    """Round pairs alone leave it free; two of them turn the part back."""
    found = two_pins(40.0)
    truth, body = found.truth, gear(found)
    body.pose = Pose(x_um=0.0, y_um=0.0, theta_rad=0.15)  # 3 um at 20 um: 1 too far
    body.on_posts.update({"shaft_plate.post": 0, "shaft_plate.second": 1})
    lean(truth, body)
    assert body.pose.theta_rad == pytest.approx(2 * math.asin(2.0 / 40.0), abs=3e-4)
    assert body.pose.y_um == pytest.approx(0.0, abs=SAFE_UM)
    # normals of edges of 157-gons are off by up to .02 rad, over a push of 1 um
    assert body.pose.x_um == pytest.approx(0.0, abs=0.02)


def test_a_hole_that_is_not_the_target_is_no_success() -> None:
    found = two_pins(40.0)
    first = replace(gear(found).holes[0], name="gear.first")
    gear(found).holes = (first, gear(found).holes[1])
    assemble(found)
    assert found.judge("gear.first", "shaft_plate.post").success
    assert not found.judge("gear.first", "shaft_plate.second").success


def test_posts_in_holes_are_kept_with_the_world(tmp_path: Path) -> None:
    found = two_pins(40.0)
    assemble(found)
    kept = json.loads(json.dumps(state_of(found)))
    again = two_pins(40.0)
    restore(again, kept)
    assert gear(again).on_posts == gear(found).on_posts != {}
    assert state_of(again) == state_of(found)


def test_every_hole_has_its_own_edge_offset_and_named_ones_draw_first() -> None:
    plain = world()
    parts = tuple(replace(p, profile_tolerance_um=0.3) for p in plain.parts)
    found = build_cell(replace(plain, parts=parts), 3)
    plate = found.truth.bodies["shaft_plate"]
    offsets = [hole.offset_um for hole in (*gear(found).holes, *plate.holes)]
    assert len(set(offsets)) == len(offsets) == 5
    assert max(map(abs, offsets)) <= 0.3
    for hole in plate.holes:
        assert hole.ring.round_um == pytest.approx(40.0 + hole.offset_um)
    assert [hole.name for hole in gear(found).holes] == ["gear.bore"]
    assert {hole.name for hole in plate.holes} == {""}
