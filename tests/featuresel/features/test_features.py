"""Features proposed from outlines, whatever way those are drawn."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from microplan.arrays import Point
from microplan.featuresel.features.feature import Feature
from microplan.featuresel.features.features import MOST, merge, propose
from microplan.optics.outline.outline import Arc, Edge, Outline, Ring, Segment, place
from microplan.planner.task.regions import features as declared_ones
from tests.featuresel.aims import target_of

CUT = math.asin(3 / 25)  # half the angle of a 6 um wide notch in a 25 um bore


def chain(points: Sequence[Point]) -> list[Edge]:
    return [Segment(start=a, end=b) for a, b in itertools.pairwise(points)]


def polygon(*points: Point) -> Ring:
    return Ring(edges=tuple(chain([*points, points[0]])))


def disc(radius_um: float, x_um: float = 0.0, y_um: float = 0.0) -> Ring:
    arc = Arc(center=(x_um, y_um), radius_um=radius_um, start_rad=0, sweep_rad=math.tau)
    return Ring(edges=(arc,))


def hole(radius_um: float, x_um: float = 0.0, y_um: float = 0.0) -> Ring:
    return disc(radius_um, x_um, y_um).reversed()


def toothed(
    count: int = 18, *, missing: Sequence[int] = (), phase: float = 0.0
) -> Ring:
    """Return tips at 50 um and roots at 45 um, arcs, a tooth's middle at `phase`."""
    edges: list[Edge] = []
    pitch = math.tau / count
    for k in range(count):
        middle = phase + k * pitch
        radius = 45.0 if k in missing else 50.0
        tip = Arc(center=(0, 0), radius_um=radius, start_rad=middle - 0.2 * pitch,
                  sweep_rad=0.4 * pitch)  # fmt: skip
        root = Arc(center=(0, 0), radius_um=45.0, start_rad=middle + 0.3 * pitch,
                   sweep_rad=0.4 * pitch)  # fmt: skip
        edges += [tip, Segment(start=tip.end, end=root.start), root]
    joined = []
    for edge, after in zip(edges, edges[1:] + edges[:1], strict=True):
        joined.append(edge)
        if math.dist(edge.end, after.start) > 1e-9:
            joined.append(Segment(start=edge.end, end=after.start))
    return Ring(edges=tuple(joined))


def notched_bore(*angles: float) -> Ring:
    """Return a 25 um bore with notches 6 um wide and 30 um out at some angles."""
    edges: list[Edge] = []
    for angle, after in zip(angles, (*angles[1:], angles[0] + math.tau), strict=True):
        c, s = math.cos(angle), math.sin(angle)
        arc = Arc(center=(0, 0), radius_um=25, start_rad=angle + CUT,
                  sweep_rad=after - angle - 2 * CUT)  # fmt: skip
        start = (25 * math.cos(angle - CUT), 25 * math.sin(angle - CUT))
        corners = [(c * 30 + s * 3, s * 30 - c * 3), (c * 30 - s * 3, s * 30 + c * 3)]
        edges += [*chain([start, *corners, arc.start]), arc]
    return Ring(edges=tuple(edges)).reversed()


def gear(*notches: float, missing: Sequence[int] = (), phase: float = 0.0) -> Outline:
    bore = notched_bore(*notches) if notches else hole(25)
    return Outline(rings=(toothed(missing=missing, phase=phase), bore))


def ell() -> Outline:
    """Return an L with a hole, 120 x 110 um."""
    ring = polygon((-60, -50), (60, -50), (60, -20), (-20, -20), (-20, 60), (-60, 60))
    return Outline(rings=(ring, hole(10, -40, 40)))


def named(features: Sequence[Feature], name: str) -> Feature:
    return next(feature for feature in features if feature.name == name)


def same(one: Sequence[Feature], other: Sequence[Feature], scale: float = 1.0) -> None:
    """Assert that features agree; the drawings differ by rounding only."""
    assert [f.name for f in one] == [f.name for f in other]
    for a, b in zip(one, other, strict=True):
        near = 1e-3 * scale  # what a stub reaches beyond the outline
        np.testing.assert_allclose(
            np.multiply(a.center_um, scale), b.center_um, atol=near
        )
        assert abs(math.remainder(a.angle_rad - b.angle_rad, math.tau)) < 1e-5
        assert a.parameters.keys() == b.parameters.keys()
        for key, value in a.parameters.items():
            unit = scale if key.endswith("_um") else 1.0
            assert b.parameters[key] == pytest.approx(value * unit, rel=1e-4, abs=1e-6)
        assert (a.kind, a.symmetry, a.bright) == (b.kind, b.symmetry, b.bright)


def split(ring: Ring, pieces: int) -> Ring:
    """Return the ring with every edge in pieces, the first in the middle of one."""
    edges: list[Edge] = []
    for edge in ring.edges:
        for k in range(pieces):
            low, high = k / pieces, (k + 1) / pieces
            if isinstance(edge, Arc):
                edges.append(
                    replace(edge, start_rad=edge.start_rad + low * edge.sweep_rad,
                            sweep_rad=edge.sweep_rad / pieces)
                )  # fmt: skip
            else:
                a, b = np.array(edge.start), np.array(edge.end)
                p, q = a + low * (b - a), a + high * (b - a)
                edges.append(Segment(start=(p[0], p[1]), end=(q[0], q[1])))
    return Ring(edges=(*edges[1:], edges[0]))


def with_stubs(ring: Ring) -> Ring:
    """Return the ring with a 1 nm edge between any two, which bends aside."""
    edges: list[Edge] = []
    for edge in ring.edges:
        x, y = edge.end
        edges += [edge, *chain([(x, y), (x + 1e-3, y + 1e-3), (x, y)])]
    return Ring(edges=tuple(edges))


def test_a_gears_features_are_those_a_task_would_declare() -> None:
    outline = gear(2.0, phase=0.1)
    found = propose(outline)
    assert [f.name for f in found] == ["outline1", "teeth1", "circle1"]
    rim, bore = outline.rings
    teeth = declared_ones.teeth([rim])
    notch = declared_ones.notch([bore])
    expected = {
        "count": teeth.count, "outer_um": teeth.outer_um, "root_um": teeth.root_um,
        "phase_rad": teeth.phase_rad, "notch_rad": notch.angle_rad,
        "notch_radius_um": notch.radius_um, "notch_width_um": notch.width_um,
        "bore_um": declared_ones.circle([bore]).radius_um,
    }  # fmt: skip
    # the crossings of the mid radius are found between points a thousandth of the
    # rim apart
    assert dict(named(found, "teeth1").parameters) == pytest.approx(expected, abs=1e-3)
    assert named(found, "teeth1").symmetry_broken_by == "notch"
    circle = named(found, "circle1")
    assert (circle.parameters["radius_um"], circle.bright) == (25.0, False)
    assert named(found, "outline1").symmetry == 1


@pytest.mark.parametrize("outline", [gear(2.0), gear(), ell()])
def test_pieces_turns_and_stubs_do_not_matter(outline: Outline) -> None:
    found = propose(outline)
    rings = outline.rings
    drawn = {
        "split": tuple(split(ring, 3) for ring in rings),
        "reversed": tuple(ring.reversed() for ring in rings),
        "rotated": tuple(Ring(edges=(*r.edges[2:], *r.edges[:2])) for r in rings),
        "holes first": rings[::-1],
        "stubs": tuple(map(with_stubs, rings)),
    }
    for how in drawn.values():
        same(found, propose(Outline(rings=how)))


@pytest.mark.parametrize("scale", [1e-2, 1e3])
def test_scale_does_not_matter(scale: float) -> None:
    def scaled(edge: Edge) -> Edge:
        if isinstance(edge, Arc):
            center = (edge.center[0] * scale, edge.center[1] * scale)
            return replace(edge, center=center, radius_um=edge.radius_um * scale)
        ends = (edge.start, edge.end)
        start, end = ((x * scale, y * scale) for x, y in ends)
        return Segment(start=start, end=end)

    for outline in (gear(2.0), ell()):
        rings = tuple(Ring(edges=tuple(map(scaled, r.edges))) for r in outline.rings)
        same(propose(outline), propose(Outline(rings=rings)), scale)


def test_features_turn_and_move_with_the_part() -> None:
    for outline in (gear(2.0), ell()):
        for turn in (0.3, 2.5):
            moved = propose(place(outline, 40.0, -7.0, turn))
            c, s = math.cos(turn), math.sin(turn)
            for feature in propose(outline):
                x, y = feature.center_um
                at = (c * x - s * y + 40, s * x + c * y - 7)
                if feature.kind == "outline" and feature.symmetry == 1:
                    continue  # about the middle of its bounds, which do not turn
                assert any(
                    f.kind == feature.kind
                    and math.dist(f.center_um, at) < 1e-6
                    and abs(f.edge_um - feature.edge_um) < 1e-6
                    for f in moved
                ), feature


@pytest.mark.parametrize(
    ("outline", "order"),
    [
        (Outline(rings=(polygon((-5, -5), (5, -5), (5, 5), (-5, 5)),)), 4),
        (Outline(rings=(polygon((-5, -3), (5, -3), (5, 3), (-5, 3)),)), 2),
        (Outline(rings=(disc(5),)), 0),
        (Outline(rings=(disc(5), hole(2))), 0),
        (Outline(rings=(disc(5), hole(1, 2, 0))), 1),
        (Outline(rings=(disc(5), hole(1, 2, 0), hole(1, -2, 0))), 2),
        (ell(), 1),
        (gear(), 18),
        (gear(0.7), 1),
        (gear(0.7, 0.7 + math.pi), 2),
    ],
)
def test_the_whole_outline_has_its_own_symmetry(outline: Outline, order: int) -> None:
    assert named(propose(outline), "outline1").symmetry == order


def test_two_notches_half_a_turn_apart_do_not_break_the_symmetry() -> None:
    teeth = named(propose(gear(0.7, 0.7 + math.pi)), "teeth1")
    assert teeth.symmetry_broken_by == ""
    assert "notch_rad" not in teeth.parameters


def test_a_missing_tooth_is_the_notch() -> None:
    teeth = named(propose(gear(missing=[4])), "teeth1")
    assert teeth.parameters["count"] == 18
    pitch = math.tau / 18
    # what is off is the root circle where the tooth would be
    assert teeth.parameters["notch_rad"] == pytest.approx(4 * pitch, abs=0.01)
    assert teeth.symmetry_broken_by == "notch"


def test_a_polygon_has_no_teeth_and_a_cross_has_four() -> None:
    turns = [math.tau * k / 6 for k in range(6)]
    hexagon = polygon(*((50 * math.cos(t), 50 * math.sin(t)) for t in turns))
    assert all(f.kind != "teeth" for f in propose(Outline(rings=(hexagon,))))
    a, b = 10.0, 50.0
    cross = polygon(
        (b, -a), (b, a), (a, a), (a, b), (-a, b), (-a, a),
        (-b, a), (-b, -a), (-a, -a), (-a, -b), (a, -b), (a, -a),
    )  # fmt: skip
    teeth = named(propose(Outline(rings=(cross,))), "teeth1")
    assert teeth.parameters["count"] == 4
    assert teeth.parameters["phase_rad"] == pytest.approx(0.0, abs=1e-3)


def test_circles_are_found_in_arcs_and_in_chords() -> None:
    flat = math.radians(50)  # of a D: what is left of the circle is 310 degrees
    arc = Arc(center=(3, 4), radius_um=20, start_rad=flat / 2,
              sweep_rad=math.tau - flat)  # fmt: skip
    dee = Ring(edges=(arc, Segment(start=arc.end, end=arc.start)))
    circle = named(propose(Outline(rings=(dee,))), "circle1")
    assert (circle.center_um, circle.parameters["radius_um"]) == ((3, 4), 20)
    sides = 64
    turns = [math.tau * k / sides for k in range(sides)]
    chords = polygon(*((20 * math.cos(t), 20 * math.sin(t)) for t in turns))
    found = propose(Outline(rings=(chords,)))
    circle = named(found, "circle1")
    assert math.hypot(*circle.center_um) < 1e-9
    area = sides / 2 * 400 * math.sin(math.tau / sides)
    assert circle.parameters["radius_um"] == pytest.approx(math.sqrt(area / math.pi))
    assert all(f.kind != "edge" for f in found)
    half = Arc(center=(0, 0), radius_um=20, start_rad=0, sweep_rad=math.radians(170))
    less = Ring(edges=(half, Segment(start=half.end, end=half.start)))
    assert all(f.kind != "circle" for f in propose(Outline(rings=(less,))))


def test_a_bar_is_bright_and_a_slot_is_dark() -> None:
    u = polygon(
        (0, 0), (100, 0), (100, 60), (70, 60), (70, 20), (30, 20), (30, 60), (0, 60)
    )
    pairs = [f for f in propose(Outline(rings=(u,))) if f.kind == "pair"]
    widths = {(round(f.parameters["width_um"]), f.bright): f for f in pairs}
    slot = widths[(40, False)]
    assert slot.center_um == pytest.approx((50, 40))
    assert slot.parameters["length_um"] == pytest.approx(40)
    assert slot.angle_rad == pytest.approx(0)
    legs = [f for f in pairs if round(f.parameters["width_um"]) == 30 and f.bright]
    assert sorted(round(f.center_um[0]) for f in legs) == [15, 85]


def test_frames_lead_out_of_the_material() -> None:
    found = propose(ell())
    bottom = next(f for f in found if f.center_um == (0, -50))
    assert bottom.angle_rad == pytest.approx(-math.pi / 2)
    inner = next(f for f in found if f.kind == "corner" and f.center_um == (-20, -20))
    assert inner.angle_rad == pytest.approx(math.pi / 4)
    assert inner.parameters["angle_rad"] == pytest.approx(1.5 * math.pi)
    outer = next(f for f in found if f.kind == "corner" and f.center_um == (-60, -50))
    assert outer.angle_rad == pytest.approx(-0.75 * math.pi)
    assert outer.parameters == pytest.approx(
        {"angle_rad": math.pi / 2, "reach_um": 110.0}
    )


def test_a_thousand_holes_are_not_a_thousand_features() -> None:
    frame = polygon((-5, -5), (400, -5), (400, 400), (-5, 400))
    holes = [hole(3, 12.0 * k, 12.0 * j) for k in range(32) for j in range(32)]
    found = propose(Outline(rings=(frame, *holes)))
    for kind, most in MOST.items():
        assert sum(f.kind == kind for f in found) <= most


def test_what_is_declared_keeps_its_name_and_what_is_avoided_goes() -> None:
    proposed = propose(ell())
    bore = replace(named(proposed, "circle1"), name="bore")
    merged = merge(proposed, [bore])
    assert [f.name for f in merged[:1]] == ["bore"]
    assert "circle1" not in [f.name for f in merged]
    assert len(merged) == len(proposed)
    slight = replace(bore, center_um=(bore.center_um[0] + 5e-4, bore.center_um[1]))
    assert "circle1" not in [f.name for f in merge(proposed, [slight])]
    without = merge(proposed, [], [bore])
    assert len(without) == len(proposed) - 1
    assert bore not in merge(proposed, [bore], [bore])
    taken = replace(bore, name="edge1")
    assert "edge1_drawn" in [f.name for f in merge(proposed, [taken])]
    with pytest.raises(ValueError, match="must differ"):
        merge(proposed, [bore, bore])


def test_a_pair_is_the_same_from_either_side() -> None:
    proposed = propose(ell())
    pair = named(proposed, "pair1")
    turned = replace(pair, name="bar", angle_rad=pair.angle_rad + math.pi)
    assert "pair1" not in [f.name for f in merge(proposed, [turned])]


def test_a_corners_frame_leads_out_of_the_material() -> None:
    corner = next(f for f in propose(ell()) if f.kind == "corner")
    target = target_of(
        corner, ell(), column=0.0, row=0.0, theta_rad=0.4, px_per_um=1 / 1.1
    )
    assert target.theta_rad == 0.4 + corner.angle_rad
    # in the corner's frame the bisector leads out: its legs lie behind it
    legs = np.array([(p[0], p[1]) for p in target.contour if math.hypot(*p[:2]) < 20])
    assert len(legs) > 10
    assert (legs[:, 0] < 0).all()
    np.testing.assert_allclose(np.abs(legs[:, 1]), -legs[:, 0], atol=1e-9)


def test_nothing_can_be_proposed_of_nothing() -> None:
    assert propose(Outline(rings=(disc(5),)))[0].name == "outline1"
    sliver = polygon((0, 0), (10, 0), (5, 0))  # no area at all
    assert [f.kind for f in propose(Outline(rings=(sliver,)))].count("teeth") == 0


def test_hostile_outlines_have_finite_features() -> None:
    rng = np.random.default_rng(5)
    for k in range(40):
        size, count = 10 ** rng.uniform(-3, 5), int(rng.integers(3, 40))
        points = rng.normal(size=(count, 2)) * size  # crosses itself
        if k % 4 == 1:  # corners meet, edges lie on each other
            points = np.round(points / size) * size
        if k % 4 == 2:  # no area
            points[:, 1] = 0.0
        corners = [(float(x), float(y)) for x, y in points]
        arc = Arc(center=(0, 0), radius_um=size, start_rad=float(rng.uniform(0, 6)),
                  sweep_rad=float(rng.uniform(0.01, 6.2)))  # fmt: skip
        bow = Ring(edges=(arc, Segment(start=arc.end, end=arc.start)))
        for feature in propose(Outline(rings=(polygon(*corners), bow))):
            numbers = (*feature.center_um, *feature.parameters.values())
            assert all(map(math.isfinite, numbers))


def test_nonsense_is_an_error() -> None:
    feature = propose(ell())[0]
    with pytest.raises(ValueError, match="edge_um must be positive"):
        replace(feature, edge_um=0.0)
    with pytest.raises(ValueError, match="finite"):
        replace(feature, center_um=(math.nan, 0.0))
