"""Pictures of parts: what the SVG encloses is what the outline encloses."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from microplan.optics.outline.outline import Arc, Outline, Ring
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.folder import OutputError
from microplan.planner.task.drawn import svg, write_drawings
from microplan.planner.task.part_summary import part_lines, parts_summary
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Part
from tests.planner.examples import EXAMPLE

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def parts() -> dict[str, Part]:
    task = load_task(EXAMPLE / "task.yaml", Report())
    assert task is not None
    return dict(task.parts)


def _points(data: str) -> Iterator[list[tuple[float, float]]]:
    """Yield the rings of path data as fine polygons, by SVG's own arc rules."""
    for ring in data.split("Z"):
        at: list[tuple[float, float]] = []
        for letter, rest in re.findall(r"([MLA])([^MLAZ]+)", ring):
            v = [float(word) for word in rest.split()]
            at += [(v[0], v[1])] if letter != "A" else _arc(at[-1], v)
        if at:
            yield at


def _arc(start: tuple[float, float], v: list[float]) -> list[tuple[float, float]]:
    """Return points on an SVG arc, SVG 2 appendix B.2.4 for circles."""
    radius, large, sweep, (x, y) = v[0], int(v[3]), int(v[4]), v[5:7]
    p, q = complex(*start), complex(x, y)
    half = abs(q - p) / 2
    off = math.sqrt(max(radius**2 - half**2, 0.0))
    normal = 1j * (q - p) / abs(q - p)
    center = (p + q) / 2 + (off if large != sweep else -off) * normal
    first = np.angle(p - center)
    turn = (np.angle(q - center) - first) % math.tau
    turn = turn if sweep else turn - math.tau
    ends = center + radius * np.exp(1j * (first + turn * np.linspace(0, 1, 400)[1:]))
    return [(float(e.real), float(e.imag)) for e in ends]


def _area(points: list[tuple[float, float]]) -> float:
    x, y = np.array(points).T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2)


def enclosed(text: str, name: str) -> float:
    """Return the area of a picture's path, y turned up again."""
    root = ET.fromstring(text)
    path = next(p for p in root.iter(f"{SVG}path") if p.get("class") == name)
    return -sum(_area(ring) for ring in _points(path.get("d") or ""))


def test_a_picture_encloses_what_the_outline_encloses(parts: dict[str, Part]) -> None:
    for part in parts.values():
        # polygons of 400 chords a half turn: 1e-5 of a circle's area
        assert enclosed(svg(part), "part") == pytest.approx(
            part.outline.area_um2, rel=2e-5
        )
    post = parts["shaft_plate"].posts["post"].outline.area_um2
    assert enclosed(svg(parts["shaft_plate"]), "post") == pytest.approx(post, rel=2e-5)


def test_everything_is_inside_the_view(parts: dict[str, Part]) -> None:
    for part in parts.values():
        root = ET.fromstring(svg(part))
        left, top, width, height = map(float, (root.get("viewBox") or "").split())
        x0, y0, x1, y1 = part.outline.bounds_um
        assert left < x0 < x1 < left + width
        assert top < -y1 < -y0 < top + height
        for text in root.iter(f"{SVG}text"):
            assert left < float(text.get("x") or "nan") < left + width
            assert top < float(text.get("y") or "nan") < top + height


def test_pictures_are_written_by_name(parts: dict[str, Part], tmp_path: Path) -> None:
    said = write_drawings(parts, tmp_path / "pictures")
    for name in parts:
        file = tmp_path / "pictures" / f"{name}.svg"
        assert str(file) in said
        assert file.read_text(encoding="utf-8") == svg(parts[name])
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match="cannot be written") as failed:
        write_drawings(parts, tmp_path / "file")
    assert failed.value.code == "MP702"


def test_the_summary_names_sizes_layers_and_circles(parts: dict[str, Part]) -> None:
    gear = list(part_lines(parts["gear"]))
    assert gear[0].startswith("gear: 100 x 99.4522 um, ")
    assert gear[0].endswith(" um2, 1 hole, 100 um thick")
    assert "  layer BORE: 1 ARC, 3 LINE -> 1 ring of 4 edges" in gear
    assert "  hole 50 um wide at (0, 0), interrupted (bore)" in gear
    whole = parts_summary(parts)
    assert "  layer PLATE: 4 CIRCLE, 8 LINE -> 5 rings of 12 edges" in whole
    assert "  4 holes 80 um wide at (-270, -270), (-270, 270), (270, -270)," in whole
    assert "  post post: 44 x 44 um, 1520.53 um2, 250 um high" in whole
    assert math.isclose(22**2 * math.pi, 1520.53, rel_tol=1e-6)


def test_what_a_terminal_obeys_is_not_printed(parts: dict[str, Part]) -> None:
    gear = parts["gear"]
    drawing = replace(gear.sheet.drawing, file="\x1b[2Jgear\r.dxf")
    odd = replace(gear, sheet=replace(gear.sheet, drawing=drawing))
    assert list(part_lines(odd))[1] == "  from ?[2Jgear?.dxf, DXF R12"


def _texts(root: ET.Element, kind: str) -> list[ET.Element]:
    return [t for t in root.iter(f"{SVG}text") if t.get("class") == kind]


def test_no_line_runs_through_a_diameter(parts: dict[str, Part]) -> None:
    """The legend lies below all that is drawn, its lines apart from each other."""
    for part in parts.values():
        root = ET.fromstring(svg(part))
        group = root.find(f"{SVG}g")
        assert group is not None
        letter = float(group.get("font-size") or "nan")
        drawn = [p.get("d") or "" for p in root.iter(f"{SVG}path")]
        bar = next(d for d in drawn if d.count("h") == 1 and "v" not in d)
        lowest = float(bar.partition("h")[0].split()[1])
        assert lowest > -part.outline.bounds_um[1]
        for text in _texts(root, "row"):
            y = float(text.get("y") or "nan")
            assert y - lowest > 0.99 * letter
            lowest = y


def test_circles_of_one_middle_share_a_mark_and_its_number(
    parts: dict[str, Part],
) -> None:
    rings = tuple(
        Ring(
            layer="RIM",
            edges=(
                Arc(
                    center=(x, 0.0),
                    radius_um=float(r),
                    start_rad=0.0,
                    sweep_rad=math.tau,
                ),
            ),
        )
        for x, r in (
            (0.0, 40.0),
            (0.0, 30.0),
            (200.0, 40.0),
            (200.0, 30.0),
            (90.0, 5.0),
        )
    )
    part = replace(parts["gear"], outline=Outline(rings=rings))
    root = ET.fromstring(svg(part))
    assert [t.text for t in _texts(root, "number")] == ["1", "1", "2"]
    assert [t.text for t in _texts(root, "row")] == ["1: 80, 60 um", "2: 10 um"]
