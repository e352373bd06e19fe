"""Marks on a chip: several outlines that are one part, in pictures of twins."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest
from shapely.geometry import MultiPolygon

from benchmarks.real.twin_parts import PARTS
from benchmarks.real.twin_pictures import (
    NEAR,
    TOGETHER,
    ZOOM,
    Condition,
    write_part,
    write_pictures,
)
from microplan.featuresel.trials.chains import Chain
from microplan.planner.measure.measuring import MeasuredPicture, PictureSeries
from microplan.planner.measure.near import parse_near
from microplan.planner.measure.part_series import part_series
from microplan.planner.measure.part_task import PartCall
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from tests.planner.examples import change, copy_example
from tests.planner.measure.small_look import fewer_trials
from validation.twins.series import Pose

CHAIN: Chain = ("contour_match", "likelihood")
DOTS = PARTS["dots"]
SIGMAS = 4.0
CORNERS_UM = 0.005  # by which polygons of few corners, soon read, miss a dot's circle


@pytest.fixture(autouse=True, scope="module")
def _fewer_trials() -> Iterator[None]:
    with fewer_trials():
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the drawing of nine dots and a workcell."""
    found = tmp_path_factory.mktemp("marks")
    few_corners = DOTS.shape.simplify(CORNERS_UM)
    assert isinstance(few_corners, MultiPolygon)
    write_part(found, few_corners)
    return found


@pytest.fixture(scope="module")
def series(folder: Path) -> PictureSeries:
    """Return what measures the dots, all of them at once."""
    call = PartCall(
        part=folder / "part.dxf",
        workcell=folder / "workcell.yaml",
        magnification=ZOOM,
        near=parse_near(NEAR),
    )
    return part_series(call, chain=CHAIN)


@pytest.fixture(scope="module")
def shown(folder: Path) -> Mapping[str, tuple[Path, Pose]]:
    """Return a picture of the dots, and of what is nearly like them."""
    wrong = ("5 % smaller", "a dot missing", "a period on")
    things = {"dots": DOTS.shape, **{name: DOTS.wrong[name] for name in wrong}}
    found = {}
    for name, shape in things.items():
        how = Condition() if name == "dots" else TOGETHER
        (found[name],) = write_pictures(folder / name, shape, how, 1)
    return found


def measured(series: PictureSeries, file: Path) -> MeasuredPicture:
    (found,) = series.measured([file])
    return found


def test_dots_are_found_together(
    series: PictureSeries, shown: Mapping[str, tuple[Path, Pose]]
) -> None:
    file, pose = shown["dots"]
    found = measured(series, file)
    assert found.is_accepted
    sigma_um = math.hypot(found.repeatability_um or 0, series.look.trueness_um or 0)
    assert found.x_um == pytest.approx(pose.x_um, abs=SIGMAS * sigma_um)
    assert found.y_um == pytest.approx(pose.y_um, abs=SIGMAS * sigma_um)
    assert found.theta_rad == pytest.approx(pose.theta_rad, abs=1e-3)


@pytest.mark.parametrize("name", ["5 % smaller", "a dot missing", "a period on"])
def test_what_is_nearly_like_them_is_refused(
    series: PictureSeries, shown: Mapping[str, tuple[Path, Pose]], name: str
) -> None:
    assert not measured(series, shown[name][0]).is_accepted


def test_what_is_looked_at_alone_is_never_held(tmp_path: Path) -> None:
    task = copy_example(tmp_path / "example")
    apart = "separate: true\n    thickness_um: 100"
    change(task, "thickness_um: 100", apart)
    report = Report()
    load_task(task, report)
    found = [f.message for f in report.in_order if f.code == "MP112"]
    assert "'gear' is a pattern, a part is needed here" in found
