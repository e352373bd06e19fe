"""`microplan measure --part`: pictures of a part that no task describes."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ezdxf.filemanagement import new
from scipy.ndimage import gaussian_filter

from microplan.arrays import FloatArray
from microplan.planner.cli.main import main
from microplan.planner.measure.near import parse_near
from microplan.planner.measure.part_series import part_series
from microplan.planner.measure.part_task import PartCall, part_task
from microplan.planner.source.diagnostics import CallError, Report
from microplan.planner.store.memo import Memo
from microplan.planner.store.store import Store, place
from tests.planner.examples import EXAMPLE, known_lens
from tests.planner.measure.small_look import fewer_trials, save

ZOOM = 20.0
CHAIN = ("--chain", "contour_match")  # nothing has to be compared
UM_PER_PX = 7.5 / ZOOM  # of the example's camera
SIZE, SENSOR = [320, 240], [2400, 1800]  # a quarter of it
SIGMAS = 4.0
MIDDLE_UM = -5.0  # x of the middle of the drawing's box, where the target is
AT_UM = (3.3, 4.6)  # of the disc, and about where its target is then
NEAR = "160px,117px,40"
FINER = 6  # points a side of a pixel, of pictures drawn here


@pytest.fixture(autouse=True, scope="module")
def _fewer_trials() -> Iterator[None]:
    with fewer_trials():
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a workcell and a drawing of a disc with a flat.

    What the lens may be else moves answers as `test_marks` has it.
    """
    found = tmp_path_factory.mktemp("part")
    cell = (EXAMPLE / "workcell.yaml").read_text(encoding="utf-8")
    small = cell.replace(
        "[4800, 3600], pixels: [640, 480]", f"{SENSOR}, pixels: {SIZE}"
    )
    assert small != cell
    (found / "workcell.yaml").write_text(small, encoding="utf-8")
    known_lens(found / "task.yaml")
    # the workcell names the tool's drawing
    shutil.copytree(EXAMPLE / "parts", found / "parts")
    drawn(found / "disc.dxf", units=13)
    return found


def drawn(file: Path, units: int) -> Path:
    """Write a disc of R 30 um whose side is cut at x = 20 um."""
    document = new()
    document.header["$INSUNITS"] = units
    corner = math.acos(20 / 30)
    space = document.modelspace()
    layer = {"layer": "DISC"}
    space.add_arc(
        (0, 0), 30, math.degrees(corner), -math.degrees(corner), dxfattribs=layer
    )
    x, y = 20.0, 30 * math.sin(corner)
    space.add_line((x, -y), (x, y), dxfattribs=layer)
    document.saveas(file)
    return file


def picture(
    x_um: float, y_um: float, turn_rad: float, *, dark: bool = False, seed: int = 1
) -> FloatArray:
    """Return counts of a frame with the disc at a pose, blurred by a Gaussian."""
    columns, rows = SIZE
    at = (np.arange(columns * FINER) + 0.5) / FINER - columns / 2
    up = rows / 2 - (np.arange(rows * FINER) + 0.5) / FINER
    x, y = at[None, :] * UM_PER_PX - x_um, up[:, None] * UM_PER_PX - y_um
    along = x * math.cos(turn_rad) + y * math.sin(turn_rad)
    inside = (np.hypot(x, y) < 30) & (along < 20)
    fine = inside.reshape(rows, FINER, columns, FINER).mean(axis=(1, 3))
    light = gaussian_filter(fine, 0.35 / UM_PER_PX)
    low, high = (190.0, 40.0) if dark else (40.0, 190.0)
    noise = np.random.default_rng(seed).normal(0, 1.5, light.shape)
    return np.rint(low + (high - low) * light + noise).astype(np.uint8)


def measure(folder: Path, capsys: pytest.CaptureFixture[str], *words: str) -> Any:
    """Return the object that a call prints for its one picture."""
    capsys.readouterr()
    part = ("--part", str(folder / "disc.dxf"), "--magnification", "20")
    cell = ("--workcell", str(folder / "workcell.yaml"))
    main(["measure", str(folder / "a.png"), *part, *cell, "--json", *words])
    (line,) = capsys.readouterr().out.splitlines()
    return json.loads(line)


@pytest.mark.parametrize("near", [None, NEAR])
def test_a_part_is_found_within_what_is_said_of_it(
    folder: Path, capsys: pytest.CaptureFixture[str], near: str | None
) -> None:
    """Anywhere in the frame at any angle, or near a place."""
    turn = math.radians(41.0)
    save(folder / "a.png", picture(*AT_UM, turn))
    where = () if near is None else ("--near", near)
    one = measure(folder, capsys, *CHAIN, *where)
    assert one["accepted"]
    x, y = AT_UM[0] + MIDDLE_UM * math.cos(turn), AT_UM[1] + MIDDLE_UM * math.sin(turn)
    sigma = math.hypot(one["repeatability_um"], one["trueness_um"])
    assert abs(one["x_um"] - x) < SIGMAS * sigma
    assert abs(one["y_um"] - y) < SIGMAS * sigma
    assert one["theta_deg"] == pytest.approx(41.0, abs=0.2)


def test_a_dark_part_is_found_if_it_is_said_to_be_dark(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    turn, near = math.radians(41.0), ("--near", NEAR)
    save(folder / "a.png", picture(*AT_UM, turn, dark=True))
    one = measure(folder, capsys, *CHAIN, *near, "--polarity", "dark")
    assert one["accepted"]
    x_um = AT_UM[0] + MIDDLE_UM * math.cos(turn)
    assert one["x_um"] == pytest.approx(x_um, abs=0.1)
    assert not measure(folder, capsys, *CHAIN, *near).get("accepted")


def test_python_finds_what_the_command_finds(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the most accurate chain, which both find by comparing all."""
    file = save(folder / "a.png", picture(2.0, 1.0, 0.02))
    one = measure(folder, capsys, "--near", "152px,117px,0")
    call = PartCall(
        part=folder / "disc.dxf",
        workcell=folder / "workcell.yaml",
        magnification=ZOOM,
        near=parse_near("152px,117px,0"),
    )
    kept = Memo(Store(place()))  # where the command leaves what it compared
    (found,) = part_series(call, memo=kept).measured([file])
    assert (found.x_um, found.y_um) == (one["x_um"], one["y_um"])
    with pytest.raises(ValueError, match="MP903: no target 'hole'"):
        part_series(PartCall(part=call.part, workcell=call.workcell, target="hole"))


def refused(**changes: Any) -> CallError:
    """Return why a part cannot be measured."""
    with pytest.raises(CallError) as found:
        part_task(PartCall(**changes), Report())
    assert found.value.code == "MP903"
    return found.value


def test_what_is_missing_and_not_unique_is_asked_for(folder: Path) -> None:
    disc, cell = folder / "disc.dxf", folder / "workcell.yaml"
    assert "6.9 to 44.5" in str(refused(part=disc, workcell=cell))
    assert "44.6 is outside" in str(
        refused(part=disc, workcell=cell, magnification=44.6)
    )
    gear = folder / "parts" / "gear18.dxf"
    two = refused(part=gear, workcell=cell, magnification=ZOOM)
    assert str(two).endswith("2 layers that hold shapes: BORE, OUTLINE")
    bare = drawn(folder / "bare.dxf", units=0)
    assert "states no unit" in str(refused(part=bare, workcell=cell))
    feet = drawn(folder / "feet.dxf", units=2)
    assert "states the unit foot" in str(refused(part=feet, workcell=cell))
    for height in (math.inf, -1.0, math.nan):
        one = refused(part=disc, workcell=cell, height_um=height)
        assert "--height-um must be 0 or more" in str(one)
    for target in ("hole", "circle:DISC:x", "circle:DISC:\u00b2", "circle:A:1:2"):
        refused(part=disc, workcell=cell, magnification=ZOOM, target=target)


def test_findings_name_the_drawing_or_the_workcell(folder: Path) -> None:
    """No file is named that the user does not know."""
    report = Report()
    disc, cell = folder / "disc.dxf", folder / "workcell.yaml"
    call = PartCall(part=disc, workcell=cell, layers=("NO",), magnification=ZOOM)
    assert part_task(call, report) is None
    lost = folder / "lost.yaml"
    call = PartCall(part=disc, workcell=lost, magnification=ZOOM)
    assert part_task(call, report) is None
    gone = PartCall(part=folder / "gone.dxf", workcell=cell, magnification=ZOOM)
    assert part_task(gone, report) is None
    assert [f.code for f in report.found] == ["MP204", "MP001", "MP001"]
    assert {Path(f.where.file).name for f in report.found} == {"disc.dxf", "gone.dxf"}
    words = " ".join(f.message for f in report.found)
    assert "disc.dxf has nothing on layer 'NO'" in words
    assert "lost.yaml" in words


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("--task", "t", "--part", "p"),
        ("--task", "t"),
        ("--part", "p"),
        ("--workcell", "w", "--task", "t", "--step", "s"),
        ("--task", "t", "--step", "s", "--units", "um"),
    ],
)
def test_a_call_for_nothing_or_for_both_is_refused(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["measure", "a.png", *words]) == 2
    assert "error[MP903]" in capsys.readouterr().err
