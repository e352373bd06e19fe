"""Features measured from outlines, against what was drawn."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.arrays import Point
from microplan.optics.outline.outline import Arc, Edge, Outline, Ring, Segment, place
from microplan.planner.drawings.dxf.drawing import take
from microplan.planner.drawings.rings import canonical
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.task.read_task import load_task
from microplan.planner.task.regions import features
from microplan.planner.task.regions.features import NotFoundError
from tests.planner.drawings.reading import open_drawing

EXAMPLE = Path(__file__).parents[4] / "examples" / "gear_on_shaft"


def polar(radius: float, angle_rad: float) -> Point:
    return (radius * math.cos(angle_rad), radius * math.sin(angle_rad))


def gear(count: int, outer: float, root: float, phase: float, tip: float) -> Ring:
    """Return a gear with tips and gaps of `tip` of the pitch; straight flanks."""
    pitch, edges = math.tau / count, list[Edge]()
    for k in range(count):
        start = phase + pitch * (k - tip / 2)
        gap = phase + pitch * (k + 0.5 - tip / 2)
        width = pitch * tip
        edges += [
            Arc(center=(0, 0), radius_um=outer, start_rad=start, sweep_rad=width),
            Segment(start=polar(outer, start + width), end=polar(root, gap)),
            Arc(center=(0, 0), radius_um=root, start_rad=gap, sweep_rad=width),
            Segment(start=polar(root, gap + width), end=polar(outer, start + pitch)),
        ]
    return Ring(edges=tuple(edges))


@settings(max_examples=60, deadline=None)
@given(
    count=st.integers(3, 60),
    phase=st.floats(-7, 7),
    tip=st.floats(0.1, 0.45),
    depth=st.floats(0.05, 0.4),
    x=st.floats(-500, 500),
    y=st.floats(-500, 500),
)
def test_teeth_are_measured_wherever_the_gear_lies(
    count: int, phase: float, tip: float, depth: float, x: float, y: float
) -> None:
    ring = canonical(gear(count, 50.0, 50.0 * (1 - depth), phase, tip))
    (moved,) = place(Outline(rings=(ring,)), x, y, 0.0).rings
    found = features.teeth([moved])
    assert found.count == count
    assert found.center_um == pytest.approx((x, y), abs=1e-9)
    assert (found.outer_um, found.root_um) == pytest.approx((50, 50 * (1 - depth)))
    pitch = math.tau / count
    assert 0 <= found.phase_rad <= pitch
    assert math.remainder(found.phase_rad - phase, pitch) == pytest.approx(0, abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(
    radius=st.floats(5, 500),
    share=st.floats(0.05, 0.9),
    depth=st.floats(-0.3, 0.3).filter(lambda d: abs(d) > 0.02),
    angle=st.floats(-7, 7),
)
def test_notches_are_measured_inward_and_outward(
    radius: float, share: float, depth: float, angle: float
) -> None:
    half = share / 2  # rad, half the angle that the notch takes
    reach = radius * (1 + depth)
    half_width = radius * math.sin(half)
    sides = [(radius * math.cos(half), s * half_width) for s in (1, -1)]
    tops = [(reach, s * half_width) for s in (1, -1)]
    ring = Ring(
        edges=(
            Arc(
                center=(0, 0), radius_um=radius, start_rad=half,
                sweep_rad=math.tau - 2 * half,
            ),
            Segment(start=sides[1], end=tops[1]),
            Segment(start=tops[1], end=tops[0]),
            Segment(start=tops[0], end=sides[0]),
        )
    )  # fmt: skip
    (turned,) = place(Outline(rings=(ring,)), 3.0, -4.0, angle).rings
    found = features.notch([canonical(turned)])
    assert found.center_um == pytest.approx((3, -4))
    assert found.width_um == pytest.approx(2 * half_width, rel=1e-9)
    assert found.depth_um == pytest.approx(abs(depth) * radius, rel=1e-6)
    assert found.radius_um == pytest.approx((radius + reach) / 2, rel=1e-6)
    assert math.remainder(found.angle_rad - angle, math.tau) == pytest.approx(
        0, abs=1e-9
    )
    assert features.circle([turned]).radius_um == radius


def test_the_extent_of_an_arc_counts_where_it_bulges() -> None:
    bow = Ring(
        edges=(
            Arc(center=(0, 0), radius_um=10, start_rad=-1, sweep_rad=2),
            Segment(start=polar(10, 1), end=polar(10, -1)),
        )
    )
    center, radius = features.extent(Outline(rings=(bow,)), (4.0, 0.0))
    assert center == (4.0, 0.0)
    assert radius == pytest.approx(math.dist(polar(10, 1), center))
    assert features.extent(Outline(rings=(bow,)), (-4.0, 0.0))[1] == pytest.approx(14)


def test_a_square_has_no_circle_no_teeth_and_no_notch() -> None:
    corners = [(0, 0), (9, 0), (9, 9), (0, 9)]
    ends = corners[1:] + corners[:1]
    square = Ring(
        edges=tuple(Segment(start=a, end=b) for a, b in zip(corners, ends, strict=True))
    )
    for find in (features.circle, features.teeth, features.notch):
        with pytest.raises(NotFoundError):
            find([square])


def test_two_circles_are_no_answer() -> None:
    rings = [
        Ring(edges=(Arc(center=(x, 0), radius_um=5, start_rad=0, sweep_rad=math.tau),))
        for x in (0.0, 20.0)
    ]
    with pytest.raises(NotFoundError, match=r"R 5 at \(0, 0\), R 5 at \(20, 0\)"):
        features.circle(rings)


def script() -> ModuleType:
    """Return the script that draws the example."""
    spec = importlib.util.spec_from_file_location("make", EXAMPLE / "make_parts.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_committed_drawings_are_what_the_script_draws(tmp_path: Path) -> None:
    script().write(tmp_path)
    for file in sorted(tmp_path.iterdir()):
        assert file.read_bytes() == (EXAMPLE / "parts" / file.name).read_bytes()
    assert len(list(tmp_path.iterdir())) == 3


def test_the_example_has_the_paper_s_features() -> None:
    task = load_task(EXAMPLE / "task.yaml", Report())
    assert task is not None
    gear_part, plate = task.parts["gear"], task.parts["shaft_plate"]
    bore, teeth, notch = (gear_part.features[n] for n in ("bore", "teeth", "notch"))
    assert (bore.center_um, bore.radius_um, bore.hole) == ((0, 0), 25, True)
    assert (teeth.count, teeth.radius_um, teeth.root_um) == (18, 50, 45)
    assert teeth.phase_rad == pytest.approx(0, abs=1e-9)
    assert notch.phase_rad == pytest.approx(math.pi / 2)
    sizes = (notch.width_um, notch.radius_um)
    assert sizes == pytest.approx((6, 27.5), rel=1e-9)
    assert gear_part.features["outline"].radius_um == pytest.approx(50)
    assert not gear_part.features["outline"].hole
    post = plate.posts["post"]
    assert (post.center_um, post.radius_um) == ((0, 0), 22)
    assert post.outline.area_um2 == pytest.approx(math.pi * 22**2)
    assert len(plate.outline.rings) == 5


def test_the_fingers_are_closed_in_the_frame_of_the_grip() -> None:
    task = load_task(EXAMPLE / "task.yaml", Report())
    assert task is not None
    tool = task.workcell.tools["tweezers"]
    assert tool.right.bounds_um == pytest.approx((0, -60, 160, 20740), abs=1e-9)
    assert tool.left.bounds_um == pytest.approx((-160, -60, 0, 20740), abs=1e-9)
    assert tool.left.area_um2 == pytest.approx(tool.right.area_um2)


def test_the_origin_moves_everything_of_a_part(tmp_path: Path) -> None:
    make = script()
    make.write(tmp_path / "parts")
    shifted = (tmp_path / "parts" / "gear18.dxf").read_text(encoding="ascii")
    lines = shifted.splitlines()
    for i in range(0, len(lines) - 1, 2):  # pairs of code and value
        shift = {"10": 120.0, "11": 120.0, "20": -35.5, "21": -35.5}.get(
            lines[i].strip()
        )
        if shift is not None:
            lines[i + 1] = repr(float(lines[i + 1]) + shift)
    (tmp_path / "parts" / "gear18.dxf").write_text("\n".join(lines) + "\n")
    for name in ("task.yaml", "workcell.yaml"):
        (tmp_path / name).write_bytes((EXAMPLE / name).read_bytes())
    moved = load_task(tmp_path / "task.yaml", Report())
    plain = load_task(EXAMPLE / "task.yaml", Report())
    assert moved is not None
    assert plain is not None
    assert moved.normalised == plain.normalised


def test_a_moved_tooth_is_still_a_tooth(tmp_path: Path) -> None:
    text = (EXAMPLE / "parts" / "gear18.dxf").read_text(encoding="ascii")
    make = script()
    tip = make._arc("OUTLINE", (0, 0), 50.0, 356.0, 4.0)
    ends = [make._polar(50.0, math.radians(a) * 180 / math.pi) for a in (-4, 4)]
    (x0, y0), (x1, y1) = ends
    assert tip in text
    bent = make._line("OUTLINE", (x0, y0), (51.0, 0.0))
    bent += make._line("OUTLINE", (51.0, 0.0), (x1, y1))
    (tmp_path / "gear.dxf").write_text(text.replace(tip, bent), encoding="ascii")
    report, at = Report(), Span(file="task.yaml", line=1)
    drawing = open_drawing(tmp_path / "gear.dxf", "gear.dxf", "um", at, at, report)
    assert drawing is not None
    found = take(drawing, ["OUTLINE"], report)
    assert found is not None
    assert features.teeth(found.outline.rings).count == 18


def test_the_outline_can_be_the_origin(tmp_path: Path) -> None:
    script().write(tmp_path / "parts")
    for name in ("task.yaml", "workcell.yaml"):
        text = (EXAMPLE / name).read_text(encoding="utf-8")
        text = text.replace("origin: bore", "origin: outline")
        (tmp_path / name).write_text(text, encoding="utf-8")
    task = load_task(tmp_path / "task.yaml", Report())
    assert task is not None
    x0, y0, x1, y1 = task.parts["gear"].outline.bounds_um
    assert (x0 + x1, y0 + y1) == pytest.approx((0, 0), abs=1e-9)
    assert task.parts["gear"].features["outline"].center_um == (0, 0)


def polygon(points: Sequence[tuple[float, float]]) -> Ring:
    """Return a ring of straight edges."""
    ends = [*points[1:], points[0]]
    edges = tuple(Segment(start=a, end=b) for a, b in zip(points, ends, strict=True))
    return Ring(edges=edges, layer="1/0")


def corners(count: int, radius: float = 10.0) -> list[tuple[float, float]]:
    """Return even corners on a circle about (3, -2)."""
    angles = [math.tau * (k + 0.3) / count for k in range(count)]
    return [(3 + radius * math.cos(a), -2 + radius * math.sin(a)) for a in angles]


@pytest.mark.parametrize("count", [8, 24, 100])
def test_a_polygon_of_even_corners_is_round(count: int) -> None:
    found = features.circle([polygon(corners(count))])
    assert found.center_um == pytest.approx((3, -2), abs=2e-9)  # rounded to 1e-9 um
    assert found.radius_um == pytest.approx(10, abs=2e-9)
    assert found.chord_um == pytest.approx(10 * (1 - math.cos(math.pi / count)))
    assert not found.hole
    assert features.circle([polygon(corners(count)).reversed()]).hole


def test_a_polygon_is_as_round_as_its_chords() -> None:
    points = corners(24)
    sagitta = 10 * (1 - math.cos(math.pi / 24))
    x, y = points[0]

    def pushed(by: float) -> Ring:
        far = ((x - 3) * (1 + by / 10) + 3, (y + 2) * (1 + by / 10) - 2)
        return polygon([far, *points[1:]])

    assert features.circle([pushed(0.9 * sagitta)]).radius_um == pytest.approx(10, 1e-2)
    with pytest.raises(NotFoundError):
        features.circle([pushed(2 * sagitta)])


@pytest.mark.parametrize(
    "points",
    [
        corners(7),
        corners(64)[10:],  # a flat wider than an eighth of a turn
        [(x, 1.5 * y) for x, y in corners(64)],
        [*corners(16), *corners(16, 9.9)],  # twice round
    ],
)
def test_other_polygons_are_no_circles(points: list[tuple[float, float]]) -> None:
    with pytest.raises(NotFoundError):
        features.circle([polygon(points)])
