"""Room of a peg in its hole, against what drawings say at a glance."""

from __future__ import annotations

import math

import pytest
import shapely

from benchmarks.compiling.outline_shapes import (
    box,
    chain,
    closed,
    d_shape,
    hollow,
    keyed,
    slot,
    star,
)
from microplan.optics.outline.outline import Arc, Outline
from microplan.planner.assembly.fits.peg_in_hole import PegInHole, ring_points
from microplan.planner.assembly.fits.room import (
    angle_elsewhere_rad,
    capture_um,
    clearance_um,
    free_angles_rad,
    overlap_of,
)


def circle(radius: float) -> Outline:
    return chain(
        [Arc(center=(0, 0), radius_um=radius, start_rad=0, sweep_rad=math.tau)]
    )


def fit(hole: Outline, peg: Outline, angle_rad: float = 0.0) -> PegInHole:
    return PegInHole(hole=hollow(hole), peg=peg, angle_rad=angle_rad)


def test_a_post_of_sixty_does_not_go_past_a_flat_at_twenty() -> None:
    found = fit(d_shape(33.0, 20.0), circle(30.0))
    overlap = overlap_of(found)
    assert overlap is not None
    assert overlap.depth_um == pytest.approx(10.0, abs=0.01)
    assert overlap.at_um == pytest.approx((30.0, 0.0), abs=0.6)  # of 60 chords or more
    # 53 um between the flat and the other side
    assert clearance_um(found) == pytest.approx(-7.0, abs=0.02)
    assert capture_um(found) == 0.0
    assert angle_elsewhere_rad(found) is None


@pytest.mark.parametrize(
    ("hole", "peg"),
    [
        (keyed(33.0, 20.0, 8.0), circle(30.0)),  # a key inside the bore
        (circle(33.0), keyed(30.0, 38.0, 8.0)),  # a key outside the post
    ],
)
def test_a_key_without_a_keyway_overlaps(hole: Outline, peg: Outline) -> None:
    found = fit(hole, peg)
    overlap = overlap_of(found)
    assert overlap is not None
    assert overlap.depth_um > 3  # half the key's width at the least, less its corners
    assert capture_um(found) == 0.0
    assert angle_elsewhere_rad(found) is None


def test_round_pegs_have_exact_capture_radii() -> None:
    # the notch of the gear's bore is outside its circle
    assert capture_um(fit(keyed(25.0, 30.0, 6.0), circle(22.0))) == pytest.approx(3.0)
    assert capture_um(fit(box(30, 24), circle(22.0))) == pytest.approx(2.0)
    assert capture_um(fit(box(30, 24), circle(22.0)), -0.5) == pytest.approx(1.5)
    assert capture_um(fit(slot(5, 23.0), circle(22.0))) == pytest.approx(1.0)


def test_a_bar_turns_until_its_corners_touch() -> None:
    found = fit(box(100.0, 12.0), box(30.0, 10.0))
    back, forth = free_angles_rad(found)
    # 30 sin t + 10 cos t = 12
    turn = math.asin(12 / math.hypot(30, 10)) - math.atan2(10, 30)
    assert (back, forth) == pytest.approx((-turn, turn), rel=0.02)
    assert clearance_um(found) == pytest.approx(4.0, rel=1e-3)


def test_a_curve_of_thousands_of_corners_is_taken_as_its_chords() -> None:
    turns = [math.tau * k / 3000 for k in range(3000)]
    radii = [50 + 5 * math.cos(5 * turn) for turn in turns]
    hole, peg = star(radii), star([radius - 2 for radius in radii])
    found = fit(hole, peg)
    for outline in (found.hole, found.peg):
        ring = outline.rings[0]
        points = ring_points(ring, found.chord_um)
        assert len(points) < 400  # chords of a circle of 50 um: 160
        drawn = shapely.Polygon([edge.start for edge in ring.edges])
        far = shapely.hausdorff_distance(drawn.boundary, shapely.LinearRing(points))
        assert far <= found.chord_um
    # 2 um along the radius are less across a slope, 25 um over 50 um at most
    least = 2 * math.cos(math.atan(0.5)) - 2 * found.chord_um
    assert least < capture_um(found) < 2


@pytest.mark.parametrize("loose", [1.1, 1.15])
def test_a_loose_hexagon_stops_before_the_next_side(loose: float) -> None:
    found = fit(star([20.0 * loose] * 6), star([20.0] * 6))
    # corners reach the sides where cos(30 deg - t) is their distance over the radius
    turn = math.radians(30) - math.acos(loose * math.cos(math.radians(30)))
    assert free_angles_rad(found) == pytest.approx((-turn, turn), rel=2e-3)


def test_what_bridges_two_arms_is_deepest_between_them() -> None:
    fork = closed(
        [
            (-10, -10),
            (10, -10),
            (10, 10),
            (2, 10),
            (2, -5),
            (-2, -5),
            (-2, 10),
            (-10, 10),
        ]
    )
    overlap = overlap_of(fit(fork, box(8, 2)))
    assert overlap is not None
    assert overlap.depth_um == pytest.approx(2.0)  # 4 um of wall, from either side
    assert overlap.at_um[0] == pytest.approx(0.0, abs=1e-6)


def test_a_key_is_found_where_its_keyway_is() -> None:
    found = fit(keyed(33.0, 40.0, 10.0), keyed(30.0, 38.0, 8.0), angle_rad=1.0)
    assert overlap_of(found) is not None
    turn = angle_elsewhere_rad(found)
    assert turn is not None
    assert turn == pytest.approx(-1.0, abs=0.15)  # it has some play there
    assert overlap_of(fit(keyed(33.0, 40.0, 10.0), keyed(30.0, 38.0, 8.0))) is None


def test_what_is_too_large_all_round_lacks_room() -> None:
    triangle = closed([(-10, -8), (10, -8), (0, 12)])
    assert clearance_um(fit(box(5, 5), triangle)) < 0
    assert overlap_of(fit(box(15, 15), triangle)) is None
