"""The laser-die example: its mask is what its script writes, its task makes sense."""

from __future__ import annotations

import importlib.util
import math
from dataclasses import replace
from pathlib import Path

import gdstk
import pytest

from microplan.planner.assembly.assembly import locate_place, part_z_um
from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.evaluation import unseen
from microplan.planner.looks.scenario import build_case, feature_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task
from microplan.planner.views.features import proposals
from microplan.planner.views.requests import requests
from microplan.planner.views.target_views import marks_view, needed_shape, views
from tests.planner import examples
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


def test_the_alignment_turns_the_submount_about_the_stages_axis(task: Task) -> None:
    """It lies 4 deg off; what the turn swings away x and y bring back."""
    off_rad = math.radians(4)
    start = replace(task.part_starts["submount"], theta_rad=off_rad)
    turned = replace(task, part_starts={**task.part_starts, "submount": start})
    states = {s.step.id: s for s in unfold(turned, Report())}
    align = states["over_site"]
    mark, die = (
        locate_place(turned, align.after, n).pose for n in ("submount.mark", "die")
    )
    assert (mark.x_um, mark.y_um) == pytest.approx((die.x_um, die.y_um), abs=1e-9)
    assert mark.theta_rad == pytest.approx(die.theta_rad, abs=1e-12)
    before = align.before.stage.theta_rad
    assert align.after.stage.theta_rad - before == pytest.approx(-off_rad)
    # 1.5 mm of arm and 4 deg: 105 um in y beyond the way that was left
    assert abs(align.after.stage.y_um - align.before.stage.y_um) > 100
    straight = replace(
        turned,
        steps=tuple(
            replace(s, tolerance_theta_rad=None) if s.id == "over_site" else s
            for s in turned.steps
        ),
    )
    left = {s.step.id: s for s in unfold(straight, Report())}["over_site"].after
    assert locate_place(straight, left, "submount").pose.theta_rad == pytest.approx(
        off_rad
    )


def test_the_looks_ask_for_the_angles_that_are_needed(task: Task) -> None:
    states = unfold(task, Report())
    asked = {
        request.id: request.needs_angle_rad
        for index in range(len(states))
        for request in requests(task, states, index, 0.4)
    }
    align, verify = math.radians(0.1), math.radians(0.2)
    assert asked == {
        "find_die": None, "see_fingers": None, "bring_between": None,
        "die_in_fingers": pytest.approx(align / 2), "find_submount": None,
        "over_site": pytest.approx(align / 2), "closer": None,
        "check.target": pytest.approx(verify / 4),
        "check.seat": pytest.approx(verify / 4),
    }  # fmt: skip


def test_a_round_mark_is_looked_at_with_the_other_one(task: Task) -> None:
    """The mark alone tells no angle; the region takes in the second, 300 um away."""
    states, report = unfold(task, Report()), Report()
    index = next(k for k, s in enumerate(states) if s.step.id == "over_site")
    (request,) = requests(task, states, index, 0.4)
    settings = views(task, request, 5.0, report)
    assert beyond_notes(report) == []
    alone, both = settings[0], marks_view(task, request, settings[0])
    scope = alone.microscope
    wider = (both.region.columns - alone.region.columns) * scope.um_per_px
    # from the near mark's rim to the far one's; a pixel at either end
    assert wider == pytest.approx(300, abs=2 * scope.um_per_px)
    assert both.region.rows == alone.region.rows
    case, _ = build_case(task, request, both, 0.005)
    assert case.tolerance_theta_rad == request.needs_angle_rad
    second = next(
        s
        for _, s in proposals(task, needed_shape(task, request)).others
        if s.name == "submount.second"
    )
    other = feature_case(task, request, case, second)
    assert other.tolerance_theta_rad is None  # round as well: its place is what counts
    assert unseen(other) == ""
    narrow = replace(case, window=alone.region, target=other.target)
    assert unseen(narrow) != ""


def test_a_post_of_its_own_height_tells_no_angle(task: Task) -> None:
    gear = examples.read(examples.EXAMPLE / "task.yaml")
    states, report = unfold(gear, Report()), Report()
    index = next(k for k, s in enumerate(states) if s.step.id == "find_shaft")
    (request,) = requests(gear, states, index, 1.0)
    asked = replace(request, needs_angle_rad=0.001)
    assert views(gear, asked, 6.9, report) == ()
    assert [d.code for d in report.found] == ["MP502"]
