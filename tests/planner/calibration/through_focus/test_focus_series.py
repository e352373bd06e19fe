"""Focus steps of a part: from files to an aperture, and what is refused instead."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from microplan.planner.cli.main import main
from tests.planner.calibration.geometry.test_stage_series import FRAME, NEAR, rig
from tests.planner.calibration.twin_series import LENS, cell_of, write_readings
from validation.twins.scenes import write_dxf
from validation.twins.series import Reading, Rig

SIGMAS = 5.0  # of six free numbers: .2 % beyond
APERTURE, ZERO_UM = 0.40, 0.7


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a workcell and a drawing."""
    found = tmp_path_factory.mktemp("focus") / "task"
    cell_of(found)
    write_dxf(FRAME, found / "frame.dxf", "FRAME")
    return found


def lens() -> Rig:
    """Return a frame under a lens of another aperture, focused lower than it reads."""
    return replace(rig(FRAME), optics=replace(LENS, aperture=APERTURE, focus_um=-0.7))


def call(folder: Path, pictures: Path, *words: str) -> int:
    cell = ("--workcell", str(folder / "workcell.yaml"))
    part = ("--part", str(folder / "frame.dxf"), "--magnification", "20")
    return main(["calibrate", str(pictures), *cell, *part, "--near", NEAR, *words])


def test_aperture_and_focus_come_out_within_their_deviations(folder: Path) -> None:
    readings = np.linspace(-5.3, 6.7, 9).tolist()
    steps = [Reading(focus_um=z_um) for z_um in readings]
    pictures, out = write_readings(folder / "steps", lens(), steps), folder / "new.yaml"
    assert call(folder, pictures, "-o", str(out)) == 0
    new = yaml.safe_load(out.read_text(encoding="utf-8"))
    how = new["calibrated"]
    assert new["optics"]["numerical_aperture"] == how["numerical_aperture"]["value"]
    for key, true in (
        ("numerical_aperture", APERTURE), ("focus_zero_um", ZERO_UM),
        ("focus_scale", 1.0),
    ):  # fmt: skip
        off = abs(how[key]["value"] - true)
        assert off < SIGMAS * how[key]["standard_deviation"]
        assert off < 0.02


def test_steps_on_one_side_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    steps = [Reading(focus_um=z_um) for z_um in (0.7, 1.2, 1.9, 2.4, 3.1)]
    assert call(folder, write_readings(folder / "above", lens(), steps)) == 2
    said = capsys.readouterr().err
    assert "0 readings below the sharpest" in said
    assert "photograph the part at nine focus readings" in said
