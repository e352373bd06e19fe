"""A post pushed into its hole ends inside, and no smaller motion would do."""

from __future__ import annotations

import math

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.executor.simulated.outlines.containment import inside
from microplan.executor.simulated.outlines.crossing import moved
from microplan.executor.simulated.outlines.flattening import SAGITTA_UM, polygon
from microplan.executor.simulated.outlines.pushing import (
    FREE_UM,
    least_distance,
    smallest_motion,
)
from microplan.schemas.pose import Pose
from tests.executor.simulated.keyed import (
    Keyed,
    bore_with_key,
    circle,
    cross,
    d_shape,
    rectangle,
    slot,
    spline,
)

REACH_UM = 50.0
SAFE_UM = 2 * SAGITTA_UM + 2 * FREE_UM  # farther than needed at most: .0044 um


def pushed(
    hole: Keyed, post: Keyed, x: float, y: float, theta: float
) -> tuple[FloatArray, FloatArray, Pose]:
    """Return hole and post as they lie, and the motion found."""
    ring = polygon(hole.edges, larger=False)
    there = moved(
        polygon(post.edges, larger=True), Pose(x_um=x, y_um=y, theta_rad=theta)
    )
    motion = smallest_motion([(ring, there)], (0.0, 0.0), REACH_UM)
    assert motion is not None
    assert inside(ring, moved(there, motion))
    return ring, there, motion


def size(motion: Pose) -> float:
    """Return how large a motion about the origin is, um."""
    return math.hypot(motion.x_um, motion.y_um, REACH_UM * motion.theta_rad)


@pytest.mark.parametrize("off_um", [3.1, 4.0, 12.0])
@pytest.mark.parametrize("angle", [0.0, 0.7, 4.0])
def test_circles_are_pushed_back_along_their_centres(
    off_um: float, angle: float
) -> None:
    x, y = off_um * math.cos(angle), off_um * math.sin(angle)
    _, _, motion = pushed(circle(25.0), circle(22.0), x, y, 0.0)
    needed = off_um - 3.0
    assert needed <= size(motion) <= needed + SAFE_UM
    # along the centres, but for the edges' own directions (tau / 240 apart), whose
    # normals pass the centre at up to half an edge
    facet_rad = math.tau / 240
    across = motion.x_um * math.sin(angle) - motion.y_um * math.cos(angle)
    assert abs(across) <= needed * facet_rad
    lever_um = 25.0 * facet_rad / 2
    assert abs(motion.theta_rad) <= (needed + SAFE_UM) * lever_um / REACH_UM**2


def test_what_fits_is_not_moved() -> None:
    _, _, motion = pushed(spline(6, 30.0, 38.0, 10.0), spline(6, 28.0, 36.0, 8.0),
                          0.3, -0.4, 0.005)  # fmt: skip
    assert motion == Pose(x_um=0.0, y_um=0.0)


def test_a_rectangle_moves_back_by_what_it_stands_out() -> None:
    hole, post = rectangle(60.0, 24.0), rectangle(56.0, 22.0)
    _, _, motion = pushed(hole, post, 3.5, -1.75, 0.0)
    assert motion.x_um == pytest.approx(-1.5, abs=SAFE_UM)
    assert motion.y_um == pytest.approx(0.75, abs=SAFE_UM)
    assert motion.theta_rad == pytest.approx(0.0, abs=1e-6)


def test_a_rectangle_turned_too_far_is_turned_back() -> None:
    """About its middle: nothing but the angle is wrong, by symmetry."""
    play = math.asin(12.0 / math.hypot(28.0, 11.0)) - math.atan2(11.0, 28.0)
    _, _, motion = pushed(rectangle(60.0, 24.0), rectangle(56.0, 22.0), 0, 0, 0.06)
    assert motion.theta_rad == pytest.approx(play - 0.06, abs=SAFE_UM / 28)
    assert math.hypot(motion.x_um, motion.y_um) < SAFE_UM


CASES = [
    (d_shape(33.0, 20.0), d_shape(30.0, 18.0), (2.6, 1.0, 0.05)),
    (d_shape(33.0, 20.0), d_shape(30.0, 18.0), (0.5, 0.2, 0.2)),
    (cross(40.0, 16.0), cross(38.0, 13.0), (1.5, -1.6, 0.03)),
    (slot(50.0, 12.0), slot(50.0, 10.0), (1.0, 1.5, 0.07)),
    (spline(1, 30.0, 40.0, 12.0), spline(1, 27.0, 38.0, 10.0), (1.0, 1.5, 0.04)),
    (spline(6, 30.0, 38.0, 10.0), spline(6, 28.0, 36.0, 8.0), (0.7, 1.2, -0.03)),
    (bore_with_key(30.0, 20.0, 8.0), bore_with_key(28.0, 18.0, 11.0), (1, -2, 0.1)),
]  # fmt: skip


@pytest.mark.parametrize(("hole", "post", "at"), CASES)
def test_no_smaller_motion_would_do(
    hole: Keyed, post: Keyed, at: tuple[float, float, float]
) -> None:
    """Of motions 3 % smaller, none in any of 400 directions fits."""
    ring, there, motion = pushed(hole, post, *at)
    assert size(motion) > 0.1
    rng = np.random.default_rng(7)
    directions = rng.standard_normal((400, 3))
    found = np.array([motion.x_um, motion.y_um, REACH_UM * motion.theta_rad])
    directions[:200] = found / size(motion) + 0.3 * directions[:200]  # most about it
    for direction in directions:
        dx, dy, turn = 0.97 * size(motion) * direction / np.linalg.norm(direction)
        other = Pose(x_um=dx, y_um=dy, theta_rad=turn / REACH_UM)
        assert not inside(ring, moved(there, other))


def test_a_spline_pushed_past_its_neighbour_still_comes_back() -> None:
    """Teeth of 1 um of play, 4 um off: contacts first met contradict each other."""
    rng = np.random.default_rng(3)
    for turn in rng.uniform(0, math.tau, 12):
        x, y = 4.0 * math.cos(turn), 4.0 * math.sin(turn)
        _, _, motion = pushed(spline(6, 30.0, 38.0, 10.0), spline(6, 28.0, 36.0, 8.0),
                              x, y, 0.05)  # fmt: skip
        assert size(motion) <= math.hypot(4.0, REACH_UM * 0.05)  # back where it came


def test_what_fits_nowhere_is_not_moved() -> None:
    ring = polygon(d_shape(33.0, 20.0).edges, larger=False)
    post = polygon(circle(30.0).edges, larger=True)
    assert smallest_motion([(ring, post)], (0.0, 0.0), REACH_UM) is None


def test_two_posts_push_a_part_as_one() -> None:
    """Two round pairs 200 um apart, 5 um of play, both off by 8 and by 8 +- 100 t."""
    ring, post = circle(25.0).edges, circle(20.0).edges
    apart = [Pose(x_um=x, y_um=0.0) for x in (-100.0, 100.0)]
    off = Pose(x_um=0.0, y_um=8.0)
    pairs = [
        (
            moved(polygon(ring, larger=False), at),
            moved(polygon(post, larger=True), off.compose(at)),
        )
        for at in apart
    ]
    motion = smallest_motion(pairs, (0.0, 0.0), 100.0)
    assert motion is not None
    assert motion.y_um == pytest.approx(-3.0, abs=SAFE_UM)
    assert motion.theta_rad == pytest.approx(0.0, abs=1e-6)


def test_the_least_distance_is_that_of_closed_forms() -> None:
    rows = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    for least, expected in (
        ([2.0, -1.0, -5.0], [2.0, 0.0, 0.0]),
        ([2.0, 3.0, -5.0], [2.0, 3.0, 0.0]),
        ([-1.0, -1.0, -1.0], [0.0, 0.0, 0.0]),
    ):
        found = least_distance(rows, np.array(least))
        assert found is not None
        assert found.tolist() == pytest.approx(expected, abs=1e-12)
    assert least_distance(rows, np.array([2.0, 0.0, -1.0])) is None  # x >= 2, x <= 1


def test_the_least_distance_satisfies_kuhn_and_tucker() -> None:
    """Feasible, and a sum of binding rows with positive factors: then it is least."""
    rng = np.random.default_rng(9)
    for _ in range(50):
        rows, least = rng.standard_normal((8, 3)), rng.uniform(-1, 0.5, 8)
        found = least_distance(rows, least)
        if found is None:
            continue
        slack = rows @ found - least
        assert slack.min() > -1e-9
        binding = rows[slack < 1e-9]
        if not len(binding):
            np.testing.assert_allclose(found, 0.0, atol=1e-9)
            continue
        factors, *_ = np.linalg.lstsq(binding.T, found, rcond=None)
        np.testing.assert_allclose(binding.T @ factors, found, atol=1e-9)
        assert factors.min() > -1e-9
