"""Stage moves of a part: from files to a workcell, and what is refused instead."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from shapely.geometry import Polygon, box

from microplan.planner.cli.main import main
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from tests.planner.calibration.twin_series import (
    LENS,
    SIZE,
    UM_PER_PX,
    cell_of,
    write_readings,
)
from tests.planner.measure.small_look import save
from validation.twins.camera import Camera
from validation.twins.scenes import Body, Scene, Shape, square_with_notch, write_dxf
from validation.twins.series import Reading, Rig

SIGMAS = 4.0
FRAME = Polygon(  # few edges: its images are quick
    square_with_notch(16.0, 3.0).exterior, [box(-4.0, -4.0, 3.0, 3.0).exterior]
)
WRONG = box(-6.0, -4.0, 6.0, 4.0)
NEAR = "63px,47px,0"
GRID = [(x, y) for x in (-8.0, 8.0) for y in (-5.0, 0.0, 5.0)]


def rig(shape: Shape) -> Rig:
    """Return a part on a dark stage."""
    return Rig(
        part=(Body(shape=shape, reflectance=0.8),),
        surroundings=Scene(bodies=(), background=0.1),
        optics=LENS,
        camera=Camera(gain=1.05, read_noise=1.0),
        size=SIZE,
        um_per_px=UM_PER_PX,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a workcell, a frame's drawing and moves of it."""
    found = tmp_path_factory.mktemp("stage") / "task"
    cell_of(found)
    write_dxf(FRAME, found / "frame.dxf", "FRAME")
    middle = Reading()
    moves = [middle, *(Reading(stage_x_um=x, stage_y_um=y) for x, y in GRID)]
    write_readings(found / "moves", rig(FRAME), moves)
    return found


def call(folder: Path, pictures: Path, *words: str, cell: str = "workcell") -> int:
    workcell = ("--workcell", str(folder / f"{cell}.yaml"))
    part = ("--part", str(folder / "frame.dxf"), "--magnification", "20")
    return main(["calibrate", str(pictures), *workcell, *part, "--near", NEAR, *words])


def test_pitch_and_axes_come_out_within_their_deviations(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "new.yaml"
    assert call(folder, folder / "moves", "-o", str(out)) == 0
    said = capsys.readouterr().out
    assert "the ruler is the drawing" in said
    assert "camera_from_stage" in said
    new = yaml.safe_load(out.read_text(encoding="utf-8"))
    how = new["calibrated"]
    for key, true in (
        ("pitch_x_um", UM_PER_PX), ("pitch_y_um", UM_PER_PX), ("skew_rad", 0.0),
        ("stage_scale_x", 1.0), ("stage_scale_y", 1.0), ("edge_offset_um", 0.0),
        ("pitch_x_by_stage_um", UM_PER_PX), ("sensor_um", 7.5),
    ):  # fmt: skip
        off = abs(how[key]["value"] - true)
        assert off < SIGMAS * how[key]["standard_deviation"]
        assert off < 2e-3
    width, height = new["camera"]["sensor_um"]
    assert width / SIZE[1] == pytest.approx(how["sensor_um"]["value"], rel=1e-5)
    assert width / SIZE[1] == pytest.approx(height / SIZE[0], rel=1e-6)
    text = (folder / "task.yaml").read_text(encoding="utf-8")
    task = folder / "with_new.yaml"
    task.write_text(text.replace("workcell.yaml", "new.yaml"), encoding="utf-8")
    report = Report()
    assert load_task(task, report) is not None
    assert not report.failed


def test_uneven_light_comes_out_of_the_parts_brightness(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lit, out = replace(rig(FRAME), gradient=(0.2, -0.1)), folder / "lit.yaml"
    moves = [Reading(stage_x_um=x, stage_y_um=y) for x, y in GRID]
    assert call(folder, write_readings(folder / "lit", lit, moves), "-o", str(out)) == 0
    new = yaml.safe_load(out.read_text(encoding="utf-8"))
    assert new["light"]["gradient"] == pytest.approx(math.hypot(0.2, 0.1), rel=0.03)
    for key, true in (("light_gradient_x", 0.2), ("light_gradient_y", -0.1)):
        found = new["calibrated"][key]
        assert abs(found["value"] - true) < SIGMAS * found["standard_deviation"]
    said = capsys.readouterr().out
    assert "no ratio of reflectances: the workcell states no black_level" in said
    assert "reflectance_background_over_part" not in new["calibrated"]


def test_reflectances_are_told_as_a_ratio_where_darkness_is_known(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, out = (folder / "workcell.yaml").read_text(), folder / "ratio.yaml"
    text = text.replace("sensor_um:", "black_level: 0, sensor_um:")
    text = text.replace("coherence: incoherent", "coherence: [0.3, 0.9]")
    (folder / "black.yaml").write_text(text)
    assert call(folder, folder / "moves", "-o", str(out), cell="black") == 0
    found = yaml.safe_load(out.read_text())["calibrated"]
    ratio = found["reflectance_background_over_part"]
    assert abs(ratio["value"] - 0.1 / 0.8) < SIGMAS * ratio["standard_deviation"]
    assert ratio["standard_deviation"] < 1e-3
    said = capsys.readouterr().out
    assert "no absolute reflectance" in said
    assert "no coherence: 0.3 to 0.9 moves edges by" in said


def some_of(folder: Path, name: str, kept: int) -> Path:
    """Return a copy of the moves with fewer rows."""
    found = folder / name
    shutil.copytree(folder / "moves", found)
    head, *rows = (found / "readings.csv").read_text().splitlines()
    rows = rows[:kept]
    names = {row.partition(",")[0] for row in rows}
    for file in found.glob("*.tif"):
        if file.name not in names:
            file.unlink()
    (found / "readings.csv").write_text("\n".join([head, *rows]))
    return found


def test_moves_that_tell_no_scale_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = ["--workcell", str(folder / "workcell.yaml")]
    assert main(["calibrate", str(folder / "moves"), *cell]) == 2
    assert "--part names its drawing" in capsys.readouterr().err
    assert call(folder, some_of(folder, "few", 3)) == 2
    assert "3 places of the stage, 4 are needed" in capsys.readouterr().err


def test_single_pictures_without_the_part_are_left_out(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of another size, or damaged, they are refused."""
    black = np.zeros(SIZE, dtype=np.uint8)
    dark = some_of(folder, "black", 7)
    save(dark / "0002.tif", black)
    shutil.copy(dark / "0003.tif", dark / "0004.tif")
    assert call(folder, dark) == 0
    said = capsys.readouterr()
    assert "at 5 stage positions" in said.out
    assert "+-" not in said.out.split("stage_noise")[0]  # five blocks: no deviation
    assert "0002.tif does not show the part: nothing in it looks" in said.err
    assert "0004.tif has exactly the pixels of picture 4" in said.err
    save(dark / "0002.tif", black[:50])
    assert call(folder, dark) == 2
    assert "it is 128 x 50 px, 0000.tif is 128 x 96" in capsys.readouterr().err
    (dark / "0002.tif").write_bytes(b"II*\0 damaged")
    assert call(folder, dark) == 2
    assert "0002.tif cannot be read" in capsys.readouterr().err


def test_pictures_of_another_part_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = write_readings(
        folder / "wrong", rig(WRONG), [Reading(), Reading(stage_x_um=3.0)]
    )
    assert call(folder, wrong) == 2
    assert "no picture in the middle of the readings" in capsys.readouterr().err
