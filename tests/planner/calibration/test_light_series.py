"""Light levels with readings: response and black level of a camera of known truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from microplan.planner.cli.main import main
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from tests.planner.calibration.twin_series import cell_of, write_lights
from validation.twins.camera import Camera

LIGHTS = np.geomspace(0.08, 1.0, 10).tolist()
TRUE = Camera(gamma=0.7, black=12.0, white=255.0, full_well=20_000.0, read_noise=1.2)
SIGMAS = 4.0


def told(folder: Path, cell: Path) -> Any:
    """Return the workcell that a call writes."""
    out = cell.with_name("new.yaml")
    call = ["calibrate", str(folder), "--workcell", str(cell), "-o", str(out)]
    assert main(call) == 0
    return yaml.safe_load(out.read_text(encoding="utf-8"))


def test_power_and_black_level_of_a_camera_come_out(tmp_path: Path) -> None:
    """Within four standard deviations; the noise comes with them."""
    cell = cell_of(tmp_path / "task")
    new = told(write_lights(tmp_path / "lights", TRUE, LIGHTS, 8), cell)
    how = new["calibrated"]
    for key, true in (("response", TRUE.gamma), ("black_level", TRUE.black)):
        value, sigma = how[key]["value"], how[key]["standard_deviation"]
        assert abs(value - true) < SIGMAS * sigma
        assert new["camera"][key] == value
        assert how[key]["pictures"] == 80
        assert len(how[key]["sha256"]) == 64
    for level, variance in new["camera"]["noise_table"]:
        light = ((level - TRUE.black) / 243) ** (1 / 0.7)
        (true,) = TRUE.variance(np.array([light])) + 1 / 12
        assert variance == pytest.approx(true, rel=0.15)


def test_a_task_compiles_with_what_was_found_as_without(tmp_path: Path) -> None:
    """The block `calibrated` says where values come from, and changes none."""
    cell = cell_of(tmp_path / "task")
    new = told(write_lights(tmp_path / "lights", TRUE, LIGHTS, 2), cell)
    del new["calibrated"]
    bare = cell.with_name("bare.yaml")
    bare.write_text(yaml.safe_dump(new), encoding="utf-8")
    task = cell.with_name("task.yaml")
    text = task.read_text(encoding="utf-8")
    found = []
    for name in ("new.yaml", "bare.yaml"):
        task.write_text(text.replace("workcell.yaml", name), encoding="utf-8")
        report = Report()
        read = load_task(task, report)
        assert read is not None
        assert not report.failed
        found.append(read.workcell)
    assert found[0].camera.response is not None
    assert found[0].camera == found[1].camera
    assert found[0].optics == found[1].optics
    assert found[0].normalised == found[1].normalised


def refused(
    folder: Path, cell: Path, capsys: pytest.CaptureFixture[str], *words: str
) -> str:
    """Return what is said of a call that writes nothing."""
    out = cell.with_name("none.yaml")
    call = ["calibrate", str(folder), "--workcell", str(cell), "-o", str(out)]
    assert main([*call, *words]) == 2
    assert not out.exists()
    return capsys.readouterr().err


def test_lights_that_tell_no_response_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = cell_of(tmp_path / "task")
    four = refused(write_lights(tmp_path / "four", TRUE, LIGHTS[::3]), cell, capsys)
    assert "error[MP904]" in four
    assert "4 different lights, 5 are needed" in four
    assert "10 different lights from darkness" in four
    one = write_lights(tmp_path / "narrow", TRUE, np.linspace(0.8, 1, 8).tolist())
    assert "of the brightest" in refused(one, cell, capsys)
    black = write_lights(tmp_path / "black", Camera(gain=0.0, read_noise=1.0), LIGHTS)
    assert "no pixel is clear" in refused(black, cell, capsys)
    white = write_lights(tmp_path / "white", Camera(gain=900.0), LIGHTS)
    assert "exactly the pixels" in refused(white, cell, capsys)
    deep = Camera(bits=12, white=4095.0)
    deeper = refused(write_lights(tmp_path / "deep", deep, LIGHTS), cell, capsys)
    assert "the workcell's camera counts to 255" in deeper
