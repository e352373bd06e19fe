"""A hole goes over a post exactly where closed forms and dense points say so."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.executor.simulated.outlines.containment import goes_over, over
from microplan.executor.simulated.outlines.crossing import moved
from microplan.executor.simulated.outlines.fabricated import (
    FabricatedRing,
    fabricated_ring,
)
from microplan.executor.simulated.outlines.flattening import SAGITTA_UM
from microplan.schemas.pose import Pose
from tests.executor.simulated.keyed import (
    Drawn,
    Keyed,
    as_hole,
    bore_with_key,
    circle,
    cross,
    d_shape,
    post_with_groove,
    rectangle,
    rim,
    slot,
    spline,
)

SAFE_UM = 0.005  # two sagittas, and what a dense rim of points leaves out
PAIRS = {
    "circle": (circle(33.0), circle(30.0)),
    "d": (d_shape(33.0, 20.0), d_shape(30.0, 18.0)),
    "rectangle": (rectangle(60.0, 24.0), rectangle(56.0, 22.0)),
    "cross": (cross(40.0, 16.0), cross(38.0, 13.0)),
    "slot": (slot(50.0, 12.0), slot(50.0, 10.0)),
    "key": (spline(1, 30.0, 40.0, 12.0), spline(1, 27.0, 38.0, 10.0)),
    "spline": (spline(6, 30.0, 38.0, 10.0), spline(6, 28.0, 36.0, 8.0)),
    "inner key": (bore_with_key(30.0, 20.0, 8.0), post_with_groove(28.0, 18.0, 11.0)),
}


def made(edges: Drawn, *, post: bool, offset_um: float = 0.0) -> FabricatedRing:
    """Return a ring as fabricated; a hole is drawn clockwise, as in world.json."""
    drawn = edges if post else as_hole(edges)
    found = fabricated_ring(drawn, offset_um, post=post)
    assert found is not None
    return found


def fits(hole: Keyed, post: Keyed, *at: float) -> bool:
    """Return whether a drawn hole goes over a drawn post at x, y, theta."""
    x, y, theta = at
    return goes_over(
        made(hole.edges, post=False),
        made(post.edges, post=True),
        Pose(x_um=x, y_um=y, theta_rad=theta),
    )


def diagonal_play(half: float, reach: float, room: float) -> float:
    """Return the angle at which a corner (reach, half) comes to height `room`."""
    return math.asin(room / math.hypot(reach, half)) - math.atan2(half, reach)


@cache
def drawn_pair(name: str) -> tuple[FabricatedRing, FabricatedRing]:
    """Return hole and post of a pair as drawn."""
    hole, post = PAIRS[name]
    return made(hole.edges, post=False), made(post.edges, post=True)


CLOSED_FORMS = {
    # extent across of a turned rectangle: w sin + h cos = H; along it has more room
    "rectangle": diagonal_play(11.0, 28.0, 12.0),
    "d": math.acos(18.0 / 30.0) - math.acos(20.0 / 30.0),  # the flat's corner meets F
    # the key's outer corner meets the keyway's side before its mouth meets the key
    "key": diagonal_play(5.0, 38.0, 6.0),
    "spline": diagonal_play(4.0, 36.0, 5.0),
    "cross": diagonal_play(6.5, 38.0, 8.0),
    "slot": math.asin(2.0 / 25.0),  # the end's centre leaves the middle line by R - r
    # the key's inner corners are reached by the groove's sides: 20 sin + 4 cos = 5.5;
    # those at the rim (29.7 out, but the groove ends at 28) bind first
    "inner key": None,
}


@pytest.mark.parametrize("name", [n for n, v in CLOSED_FORMS.items() if v])
@pytest.mark.parametrize("sense", [-1, 1])
def test_the_play_in_angle_is_the_closed_form(name: str, sense: int) -> None:
    hole, post = PAIRS[name]
    play = CLOSED_FORMS[name]
    assert play is not None
    slack = SAFE_UM / 20.0  # every contact here is at least 20 um out
    assert fits(hole, post, 0.0, 0.0, 0.0)
    assert fits(hole, post, 0.0, 0.0, sense * (play - slack))
    assert not fits(hole, post, 0.0, 0.0, sense * (play + slack))
    assert not fits(hole, post, 0.0, 0.0, sense * min(3 * play, 0.7))


def test_a_key_inside_a_bore_turns_until_its_groove_is_used_up() -> None:
    hole, post = PAIRS["inner key"]
    # the key's side, y = 4 out to the bore, meets the groove's mouth on the post:
    mouth = math.asin(5.5 / 28.0) - math.asin(4.0 / 28.0)
    assert fits(hole, post, 0.0, 0.0, mouth - SAFE_UM / 20)
    assert not fits(hole, post, 0.0, 0.0, mouth + SAFE_UM / 20)


@pytest.mark.parametrize("name", PAIRS)
def test_dense_points_agree_at_random_poses(name: str) -> None:
    """Every point of the post's rim in the hole's region, in closed form."""
    hole, post = PAIRS[name]
    rings = made(hole.edges, post=False), made(post.edges, post=True)
    points = rim(post.edges, 0.05)
    rng = np.random.default_rng(5)
    found = []
    reach_um = 3.0 if name == "circle" else 1.5  # where some fit and some do not
    for _ in range(150):
        dx, dy, turn = rng.uniform(-1, 1, 3) * (reach_um, reach_um, 0.06)
        at = Pose(x_um=dx, y_um=dy, theta_rad=turn)
        x, y = moved(points, at).T
        strict, loose = (bool(hole.holds(x, y, by).all()) for by in (-SAFE_UM, 1e-9))
        yes = goes_over(*rings, at)
        assert strict <= yes <= loose, (dx, dy, turn)
        found.append(yes)
    assert 4 < sum(found) < 146  # both answers are asked for


@pytest.mark.parametrize(
    "hole", [d_shape(33.0, 20.0), bore_with_key(33.0, 20.0, 8.0)], ids=["flat", "key"]
)
def test_an_impossible_fit_never_seats(hole: Keyed) -> None:
    rng = np.random.default_rng(11)
    poses = rng.uniform(-1, 1, (1000, 3)) * (12.0, 12.0, math.pi)
    # the widest disc inside the flat bore is 26.5 um, and the post's is 30
    rings = made(hole.edges, post=False), made(circle(30.0).edges, post=True)
    for x, y, theta in poses:
        assert not goes_over(*rings, Pose(x_um=x, y_um=y, theta_rad=theta))


def test_a_key_outside_a_post_does_not_go_into_a_round_bore() -> None:
    key = spline(1, 27.0, 38.0, 10.0)
    rng = np.random.default_rng(12)
    for x, y, theta in rng.uniform(-1, 1, (300, 3)) * (12.0, 12.0, math.pi):
        assert not fits(circle(30.0), key, x, y, theta)
    assert fits(circle(33.0), circle(27.0), 0.0, 0.0, 0.0)


@settings(deadline=None, max_examples=60)
@given(
    hole=st.floats(8, 200), play=st.floats(0.02, 5), share=st.floats(0, 2),
    turn=st.floats(-3, 3),
)  # fmt: skip
def test_polygons_of_circles_agree_with_radii(
    hole: float, play: float, share: float, turn: float
) -> None:
    off_um = share * play
    round_pair = (
        made(circle(hole).edges, post=False),
        made(circle(hole - play).edges, post=True),
    )
    at = Pose(x_um=off_um * math.cos(turn), y_um=off_um * math.sin(turn))
    assert goes_over(*round_pair, at) == (math.hypot(at.x_um, at.y_um) < play)
    plain = [polygon_only(ring) for ring in round_pair]
    found = goes_over(plain[0], plain[1], at)
    assert found <= (off_um < play)  # it errs to the safe side, and not by more than
    assert found >= (off_um < play - SAFE_UM)


def polygon_only(ring: FabricatedRing) -> FabricatedRing:
    """Return a ring that only its polygon tells about."""
    return FabricatedRing(
        corners_um=ring.corners_um, center_um=ring.center_um, round_um=None,
        inner_um=0.0, outer_um=math.inf,
    )  # fmt: skip


POSES = st.tuples(
    st.floats(-3, 3), st.floats(-3, 3), st.floats(-0.15, 0.15)
)  # about where the pairs fit


@settings(deadline=None, max_examples=60)
@given(
    name=st.sampled_from(sorted(PAIRS)), at=POSES,
    common=st.tuples(st.floats(-500, 500), st.floats(-500, 500), st.floats(-4, 4)),
)  # fmt: skip
def test_a_common_rigid_motion_changes_nothing(
    name: str, at: tuple[float, ...], common: tuple[float, ...]
) -> None:
    hole, post = drawn_pair(name)
    pose = Pose(x_um=at[0], y_um=at[1], theta_rad=at[2])
    motion = Pose(x_um=common[0], y_um=common[1], theta_rad=common[2])
    before = over(polygon_only(hole), polygon_only(post), pose)
    there = moved(hole.corners_um, motion)
    away = FabricatedRing(
        corners_um=there, center_um=motion.apply(*hole.center_um), round_um=None,
        inner_um=0.0, outer_um=math.inf,
    )  # fmt: skip
    after = goes_over(away, polygon_only(post), motion.compose(pose))
    if before.room_um > 1e-9:  # of 500 um: rounding
        assert after == before.yes


@settings(deadline=None, max_examples=60)
@given(
    name=st.sampled_from(sorted(PAIRS)), at=POSES,
    less=st.floats(0, 1.5), more=st.floats(0, 1.5),
)  # fmt: skip
def test_a_smaller_post_or_a_larger_hole_fits_where_the_drawn_pair_does(
    name: str, at: tuple[float, ...], less: float, more: float
) -> None:
    hole, post = PAIRS[name]
    pose = Pose(x_um=at[0], y_um=at[1], theta_rad=at[2])
    drawn = goes_over(*drawn_pair(name), pose)
    smaller = made(post.edges, post=True, offset_um=-less)
    larger = made(hole.edges, post=False, offset_um=more)
    assert goes_over(larger, smaller, pose) >= drawn


@settings(deadline=None, max_examples=60)
@given(name=st.sampled_from(sorted(PAIRS)), at=POSES, step=POSES)
def test_an_answer_holds_as_far_as_it_says(
    name: str, at: tuple[float, ...], step: tuple[float, ...]
) -> None:
    hole, post = drawn_pair(name)
    first = over(hole, post, Pose(x_um=at[0], y_um=at[1], theta_rad=at[2]))
    near = Pose(
        x_um=at[0] + step[0] / 3,
        y_um=at[1] + step[1] / 3,
        theta_rad=at[2] + step[2] / 9,
    )
    if first.holds_at(post, near):
        assert goes_over(hole, post, near) == first.yes


def test_the_sagitta_bounds_the_error_of_a_pair() -> None:
    assert 2 * SAGITTA_UM < SAFE_UM
