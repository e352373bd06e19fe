"""Which magnifications a look allows: closed forms against the field and the table."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.planner.assembly.assembly import Place
from microplan.planner.assembly.initial_state import initial
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.task.task import Task
from microplan.planner.task.workcell import Workcell
from microplan.planner.views.check_task import check_task
from microplan.planner.views.targets import TargetShape, shape_of
from microplan.planner.views.zooms import (
    FINEST_PX,
    LADDER,
    Origin,
    field_limit,
    in_field,
    magnifications,
    microscope_at,
    useful_ceiling,
    useful_magnification,
    zoom_range,
)
from microplan.schemas.pose import Pose
from tests.planner.examples import EXAMPLE, change, copy_example, read

HERE = Origin(
    look="see",
    target=Span(file="task.yaml", line=1),
    view=Span(file="task.yaml", line=2),
    sigma=Span(file="task.yaml", line=3),
)
LOW = 6.9


@cache
def example() -> Task:
    return read(EXAMPLE / "task.yaml")


@pytest.fixture
def task() -> Task:
    return example()


def spot(x_um: float, y_um: float, sigma_um: float) -> Place:
    return Place(
        name="gear.teeth",
        owner="gear",
        carrier="stage",
        pose=Pose(x_um=x_um, y_um=y_um),
        z_um=100.0,
        sigma_xy_um=sigma_um,
        sigma_theta_rad=math.pi,
    )


def gear(task: Task) -> TargetShape:
    shape = shape_of(task, initial(task), "gear")
    assert shape is not None
    return shape


def zooms(
    task: Task, where: Place, current: float = LOW
) -> tuple[tuple[float, ...], list[str]]:
    """Return the magnifications that show the gear, and the codes reported."""
    report = Report()
    found = magnifications(task.workcell, gear(task), where, current, report, HERE)
    return found, [d.code for d in report.found]


@pytest.mark.parametrize("margin_um", [-0.1, 0.1])
@pytest.mark.parametrize("side", [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_the_target_is_in_the_field_at_two_sigma(
    task: Task, side: tuple[int, int], margin_um: float
) -> None:
    sigma_um, radius_um = 30.0, 50.0
    half = (4800 / LOW / 2, 3600 / LOW / 2)  # of the sensor, in object space
    room = [h - radius_um - 2 * sigma_um - margin_um for h in half]
    where = spot(side[0] * room[0], side[1] * room[1], sigma_um)
    assert in_field(microscope_at(task.workcell, LOW), gear(task).box_um, where) is (
        margin_um > 0
    )


@pytest.mark.parametrize(
    ("x_um", "sigma_um", "scale", "line", "says"),
    [
        (300.0, 30.0, 1, 2, "not inside"),
        (0.0, 110.0, 1, 3, "too uncertain"),
        (300.0, 110.0, 1, 3, "too uncertain"),  # the middle would not mend it
        (0.0, 30.0, 8, 1, "too large"),
        (300.0, 110.0, 8, 1, "too large"),
    ],
)
def test_what_may_be_outside_the_field_is_refused_at_its_cause(
    task: Task, x_um: float, sigma_um: float, scale: float, line: int, says: str
) -> None:
    assert zooms(task, spot(0.0, 0.0, 30.0))[1] == []
    x0, y0, x1, y1 = gear(task).box_um
    shape = replace(gear(task), box_um=(scale * x0, scale * y0, scale * x1, scale * y1))
    report, where = Report(), spot(x_um, 0.0, sigma_um)
    found = magnifications(task.workcell, shape, where, LOW, report, HERE)
    (finding,) = report.found
    assert (found, finding.code, finding.where.line) == ((), "MP401", line)
    assert says in finding.message
    assert "'see'" in finding.message
    shift = re.search(r"by up to \((\S+), (\S+)\) um", finding.hint)
    assert (shift is not None) == (says == "not inside")
    if shift:
        there = Pose(x_um=x_um + float(shift[1]), y_um=float(shift[2]))
        near = replace(where, pose=there)
        assert magnifications(task.workcell, shape, near, LOW, Report(), HERE)


def test_a_view_beside_the_field_is_found_where_it_is_asked_for(
    tmp_path: Path,
) -> None:
    file = copy_example(tmp_path / "task")
    change(file, "target: gear, view_um: [0, 0]", "target: gear, view_um: [320, 0]")
    report = Report()
    check_task(read(file), report)
    finding = next(d for d in report.in_order if d.code == "MP401")
    assert finding.where.text[finding.where.column - 1 :].startswith("[320, 0]")
    change(file, "view_um: [320, 0]", "view_um: [0, 0]")
    change(file, "theta: any, sigma_xy_um: 30", "theta: any, sigma_xy_um: 130")
    report = Report()
    check_task(read(file), report)
    finding = next(d for d in report.in_order if d.code == "MP401")
    assert finding.where.text[finding.where.column - 1 :].startswith("130")


def test_the_ladder_climbs_by_root_two_while_the_target_fits(task: Task) -> None:
    found, codes = zooms(task, spot(0.0, 0.0, 30.0))
    assert codes == []
    assert found[0] == LOW
    for before, after in pairwise(found):
        assert after / before == pytest.approx(LADDER)
    # 2 x 110 um have to fit into 3600 um / m
    assert found[-1] <= 3600 / 220 < found[-1] * LADDER
    tight, _ = zooms(task, spot(0.0, 0.0, 0.5))
    assert tight[: len(found)] == found
    assert len(tight) > len(found)


def test_the_present_magnification_comes_first_if_it_qualifies(task: Task) -> None:
    usual, _ = zooms(task, spot(0.0, 0.0, 10.0))
    found, _ = zooms(task, spot(0.0, 0.0, 10.0), current=usual[2])
    assert found[0] == usual[2]
    assert sorted(found) == sorted(usual)
    assert zooms(task, spot(0.0, 0.0, 10.0), current=43.21)[0] == usual


def test_no_magnification_beyond_what_the_aperture_resolves(task: Task) -> None:
    # two pixels to a period of the cutoff 2 A / lambda: m = 4 pitch A / lambda
    assert useful_magnification(task.workcell, LOW) == pytest.approx(
        4 * 7.5 * 0.42 / 0.6
    )
    small = replace(gear(task), box_um=(-1, -1, 1, 1))
    found = magnifications(task.workcell, small, spot(0, 0, 0.1), LOW, Report(), HERE)
    assert max(found) <= 21
    assert max(found) * LADDER > 21


def test_a_detail_below_four_pixels_asks_for_zoom_or_is_refused(task: Task) -> None:
    pitch_um = task.workcell.camera.pitch_um
    fine = replace(gear(task), finest_um=FINEST_PX * pitch_um / 12.0)
    found = magnifications(task.workcell, fine, spot(0, 0, 1), LOW, Report(), HERE)
    assert found
    assert min(found) >= 12.0
    report = Report()
    finer = replace(gear(task), finest_um=FINEST_PX * pitch_um / 60.0)
    assert not magnifications(task.workcell, finer, spot(0, 0, 1), LOW, report, HERE)
    assert [d.code for d in report.found] == ["MP403"]


@given(
    x_um=st.floats(-150, 150),
    y_um=st.floats(-100, 100),
    sigma_um=st.floats(0, 30),
    box=st.tuples(
        st.floats(1, 40), st.floats(1, 40), st.floats(1, 40), st.floats(1, 40)
    ),
)
def test_beyond_the_fields_limit_the_target_may_be_outside(
    x_um: float, y_um: float, sigma_um: float, box: tuple[float, float, float, float]
) -> None:
    cell, where = example().workcell, spot(x_um, y_um, sigma_um)
    box_um = (-box[0], -box[1], box[2], box[3])
    limit = field_limit(cell, box_um, where)
    for share, inside in ((1 - 1e-9, True), (1 + 1e-9, False)):
        assert in_field(microscope_at(cell, share * limit), box_um, where) is inside


def test_in_the_middle_the_limit_is_the_field_over_part_and_uncertainty(
    task: Task,
) -> None:
    """4800 x 3600 um of sensor for a gear of 100 um with 2 sigma of 30 um beside it."""
    found = zoom_range(task.workcell, gear(task), spot(0.0, 0.0, 30.0))
    assert found.most == pytest.approx(3600 / (100 + 2 * (2 * 30)))
    # four pixels of 7.5 um on teeth 5 um high: below what the zoom can do
    (finest,) = (b for b in found.bounds if b.by == "finest detail")
    assert finest.magnification == pytest.approx(4 * 7.5 / 5)
    assert found.least == LOW
    (ceiling,) = (b for b in found.bounds if b.by == "useful ceiling")
    assert ceiling.magnification == pytest.approx(4 * 7.5 * 0.42 / 0.6)


def with_apertures(cell: Workcell, *table: tuple[float, float]) -> Workcell:
    """Return a cell whose aperture goes with the zoom."""
    lens = replace(cell.optics.lens, apertures=table)
    return replace(cell, optics=replace(cell.optics, apertures=table, lens=lens))


@pytest.mark.parametrize(
    "table",
    [
        ((6.9, 0.20), (20.0, 0.30), (44.5, 0.42)),  # opens with the zoom
        ((6.9, 0.16), (20.0, 0.17)),  # ends before the zoom does
        ((6.9, 0.42), (44.5, 0.05)),
        ((6.9, 0.20), (20.0, 0.40), (30.0, 0.50), (44.5, 0.95)),
        ((6.9, 0.16), (15.0, 0.35), (25.0, 0.36), (44.5, 0.91)),  # useful again
    ],
)
def test_the_useful_ceiling_is_where_a_scan_finds_it(
    task: Task, table: tuple[tuple[float, float], ...]
) -> None:
    cell = with_apertures(task.workcell, *table)
    scan = np.geomspace(*cell.optics.magnification, 20001)[1:-1]
    useful = [m for m in scan if m <= useful_magnification(cell, m)]
    found = useful_ceiling(cell)
    assert found is not None
    step = scan[1] / scan[0]
    if useful[-1] == scan[-1]:
        assert found == cell.optics.magnification[1]
    else:
        assert useful[-1] <= found * (1 + 1e-12) < useful[-1] * step * (1 + 1e-12)


def test_where_no_zoom_is_useful_the_least_that_shows_the_target_is_tried(
    task: Task,
) -> None:
    dim = with_apertures(task.workcell, (6.9, 0.02), (44.5, 0.02))
    assert useful_ceiling(dim) is None
    found = magnifications(dim, gear(task), spot(0, 0, 1), LOW, Report(), HERE)
    assert found == (LOW,)
    assert zoom_range(dim, gear(task), spot(0, 0, 1)).useful == LOW


def test_between_two_rungs_the_middle_of_the_interval_is_tried(task: Task) -> None:
    least, most = 7.5, 9.0  # the ladder has 6.9 and 9.76
    fine = replace(gear(task), finest_um=FINEST_PX * 7.5 / least)
    sigma_um = (3600 / most - 100) / 4
    found = magnifications(
        task.workcell, fine, spot(0, 0, sigma_um), LOW, Report(), HERE
    )
    assert list(found) == pytest.approx([math.sqrt(least * most)])


def test_an_empty_interval_is_refused_with_both_its_ends(task: Task) -> None:
    fine = replace(gear(task), finest_um=FINEST_PX * 7.5 / 12.0)
    report = Report()
    assert not magnifications(task.workcell, fine, spot(0, 0, 60), LOW, report, HERE)
    (finding,) = report.found
    assert finding.code == "MP403"
    assert "take 12 x" in finding.message
    assert f"up to {3600 / 340:.4g} x" in finding.message
