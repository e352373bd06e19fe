"""The page of a calibration: pulls, charts, and nothing that runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    CalibrationCurve,
    CalibrationSeries,
    PictureSource,
)
from microplan.planner.calibration.page.calibration_page import calibration_page
from microplan.planner.cli.main import main
from tests.planner.calibration.test_light_series import LIGHTS, TRUE
from tests.planner.calibration.twin_series import cell_of, write_lights

SOURCE = PictureSource(pictures=9, sha256="ab" * 32)


def value(key: str, found: float, sigma: float | None) -> CalibratedValue:
    return CalibratedValue(
        key=key, value=found, sigma=(sigma,), unit="um", method="a method",
        source=SOURCE, stated=1.0,
    )  # fmt: skip


def test_values_stand_against_what_was_stated() -> None:
    series = CalibrationSeries(
        heading="scale <b>",
        values=(value("near", 1.001, 0.001), value("far", 1.1, 0.01),
                value("vague", 2.0, None)),
        notes=("in words",),
        curves={"residuals x": CalibrationCurve(points=[(0.0, 1.0)], line=[])},
    )  # fmt: skip
    page = calibration_page("cell", [series])
    assert page == calibration_page("cell", [series])
    assert "3 values from 1 series; of 3 that the workcell states, 1 are more" in page
    assert "<strong>10</strong>" in page
    assert "scale &lt;b&gt;" in page
    assert "<script" not in page
    assert page.count("<svg") == 1
    assert "to the right of the fit" in page


def test_a_call_writes_its_page_and_nothing_over_another_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell, page = cell_of(tmp_path / "task"), tmp_path / "page.html"
    lights = write_lights(tmp_path / "lights", TRUE, LIGHTS[::2], 8)
    call = ["calibrate", str(lights), "--workcell", str(cell), "--report"]
    assert main([*call, str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert text.count("<svg") == 2  # photon transfer, response
    assert "is more than" not in text
    assert main([*call, str(page)]) == 0  # its own page is renewed
    assert main([*call, str(cell)]) == 2
    assert "error[MP703]" in capsys.readouterr().err


def test_where_no_workcell_is_written_no_page_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Black at 30 leaves six counts up to the white level that is stated."""
    cell, page = cell_of(tmp_path / "task"), tmp_path / "page.html"
    text = cell.read_text(encoding="utf-8")
    stated = text.replace("camera: {", "camera: {white_level: 36, ")
    cell.write_text(stated, encoding="utf-8")
    camera = replace(TRUE, black=30.0, gamma=1.0, gain=0.8)
    lights = write_lights(tmp_path / "lights", camera, LIGHTS, 8)
    out = cell.with_name("new.yaml")
    call = ["calibrate", str(lights), "--workcell", str(cell), "--report", str(page)]
    assert main([*call, "-o", str(out)]) == 2
    said = capsys.readouterr().err
    assert "nothing is written" in said
    assert "counts reach" in said
    assert "mend camera.white_level in the workcell" in said
    assert not page.exists()
    assert not out.exists()
