"""Light levels with readings: response and black level of a camera of known truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from microplan.planner.calibration.still_frames import StillScene
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


def stating(cell: Path, words: str) -> None:
    """Put keys into the camera of a workcell."""
    text = cell.read_text(encoding="utf-8")
    cell.write_text(text.replace("camera: {", f"camera: {{{words}, "), encoding="utf-8")


def test_full_scale_is_the_stated_white_level_where_counts_do_not_pile_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Electrons between black and white; only what is stated is said to be."""
    cell = cell_of(tmp_path / "task")
    camera = Camera(black=10.0, white=210.0, full_well=2000.0, read_noise=0.5)
    lights = write_lights(tmp_path / "lights", camera, [0.8 * x for x in LIGHTS], 8)
    call = ["calibrate", str(lights), "--workcell", str(cell)]
    assert main(call) == 0
    said = capsys.readouterr().out
    assert "; stated" not in said.replace("full_well_e", "").partition("\n")[0]
    assert "response: " in said
    assert not [s for s in said.splitlines() if "black_level" in s and "stated" in s]
    stating(cell, "white_level: 210")
    how = told(lights, cell)["calibrated"]
    off = how["full_well_e"]["value"] - 2000.0
    assert abs(off) < SIGMAS * how["full_well_e"]["standard_deviation"]
    assert abs(off) < 200.0
    cell.write_text(cell.read_text().replace("white_level: 210", "white_level: 60"))
    assert main(call) == 0
    assert "the workcell's white_level is 60" in capsys.readouterr().err


def test_noise_names_the_pictures_that_it_is_of(tmp_path: Path) -> None:
    cell = cell_of(tmp_path / "task")
    lights = [light for light in LIGHTS for _ in range(8 if light > 0.3 else 2)]
    how = told(write_lights(tmp_path / "lights", TRUE, lights), cell)["calibrated"]
    assert how["response"]["pictures"] == len(lights)
    assert how["noise_table"]["pictures"] == 8 * sum(x > 0.3 for x in LIGHTS)
    assert how["noise_table"]["sha256"] != how["response"]["sha256"]


def test_slopes_are_those_of_the_whole_frame() -> None:
    frame = np.random.default_rng(0).integers(0, 255, (23, 31)).astype(float)
    scene = StillScene.of(frame, 255, every=3)
    scene.add(frame + 2.0)
    meant = [np.gradient(frame, axis=axis)[::3, ::3] for axis in (0, 1)]
    np.testing.assert_allclose(scene.slopes, meant)
    np.testing.assert_allclose(scene.mean, frame[::3, ::3] + 1.0)
