"""The laser-die example: its mask is what its script writes, its task makes sense."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path

import gdstk
import pytest

from planner.diagnostics import Report
from planner.inputs.read_task import load_task
from planner.inputs.task import Task
from planner.model.assembly import locate_place, part_z_um
from planner.model.steps import unfold
from tests.planner.examples import ROOT, beyond_notes

EXAMPLE = ROOT / "examples" / "laser_die"
MASK = EXAMPLE / "parts" / "laser_die.gds"


@pytest.fixture(scope="module")
def task() -> Task:
    """Return the example's task, read with notes only."""
    report = Report()
    found = load_task(EXAMPLE / "task.yaml", report)
    assert beyond_notes(report) == []
    assert found is not None
    return found


def test_the_mask_is_what_its_script_writes(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("mask", EXAMPLE / "make_mask.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.write(tmp_path)
    assert (tmp_path / "laser_die.gds").read_bytes() == MASK.read_bytes()


def test_the_parts_are_as_drawn(task: Task) -> None:
    die, submount = task.parts["die"], task.parts["submount"]
    round_um2 = 2 * math.pi
    # corners off a circle by half a unit at most move its radius by less than that
    near = pytest.approx(250 * 150 - round_um2 * 10**2, abs=round_um2 * 20 * 5e-4)
    assert die.outline.area_um2 == near
    near = pytest.approx(900 * 700 - round_um2 * 15**2, abs=round_um2 * 30 * 5e-4)
    assert submount.outline.area_um2 == near
    assert die.features["middle"].center_um == pytest.approx((0, 145), abs=1e-3)
    assert die.features["side"].center_um == pytest.approx((85, 145), abs=1e-3)
    assert die.chord_um == pytest.approx(10 * (1 - math.cos(math.pi / 128)), abs=1e-3)
    assert task.workcell.tools["tweezers"].left.bounds_um[1] == -200


def test_another_program_reads_the_same_mask(task: Task) -> None:
    found = gdstk.read_gds(MASK).cells
    cells = {cell.name: cell for cell in found if isinstance(cell, gdstk.Cell)}
    for name, layers in (("DIE", (1, 2, 3)), ("SUBMOUNT", (10, 11, 12))):
        body, *holes = (cells[name].get_polygons(layer=k, datatype=0) for k in layers)
        left = gdstk.boolean(body, [hole for (hole,) in holes], "not", precision=1e-6)
        part = task.parts[name.lower()]
        # the polygons of holes lie inside the circles that they were taken for
        missing = sum(p.area() for p in left) - part.outline.area_um2
        rim = sum(r.edges[0].length_um for r in part.outline.rings[1:])
        assert 0 < missing < rim * (part.chord_um + 5e-4)


def test_nothing_touches_and_the_die_ends_over_its_site(task: Task) -> None:
    report = Report()
    states = unfold(task, report)
    assert len(states) == len(task.steps)
    assert beyond_notes(report) == []
    end = states[-1].after
    die = locate_place(task, end, "die").pose
    mark = locate_place(task, end, "submount.mark").pose
    assert math.hypot(die.x_um - mark.x_um, die.y_um - mark.y_um) < 1e-6
    gap_um = part_z_um(task, end, "die") - part_z_um(task, end, "submount") - 150
    assert gap_um == pytest.approx(2)  # it falls by that when it is let go
