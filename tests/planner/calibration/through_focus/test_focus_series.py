"""Focus steps of a part: from files to an aperture, and what is refused instead."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

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
WAVES = {6: 0.03, 8: -0.025, 11: 0.03}  # rms, by Noll's index


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a workcell and a drawing."""
    found = tmp_path_factory.mktemp("focus") / "task"
    cell_of(found)
    write_dxf(FRAME, found / "frame.dxf", "FRAME")
    return found


def lens(aperture: float = APERTURE) -> Rig:
    """Return a frame under a lens of another aperture, focused lower than it reads."""
    optics = replace(LENS, aperture=aperture, focus_um=-ZERO_UM)
    return replace(rig(FRAME), optics=optics)


def call(folder: Path, pictures: Path, *words: str, cell: str = "workcell") -> int:
    workcell = ("--workcell", str(folder / f"{cell}.yaml"))
    part = ("--part", str(folder / "frame.dxf"), "--magnification", "20")
    return main(["calibrate", str(pictures), *workcell, *part, "--near", NEAR, *words])


@pytest.fixture(scope="module")
def pictures(folder: Path) -> Path:
    """Return focus steps."""
    readings = np.linspace(-5.3, 6.7, 7).tolist()
    steps = [Reading(focus_um=z_um) for z_um in readings]
    return write_readings(folder / "steps", lens(), steps)


def stating(folder: Path, aperture: float) -> str:
    """Write a workcell that states an aperture, and return its name."""
    text = (folder / "workcell.yaml").read_text(encoding="utf-8")
    stated = text.replace("numerical_aperture: 0.42", f"numerical_aperture: {aperture}")
    name = f"stating_{aperture}"
    (folder / f"{name}.yaml").write_text(stated, encoding="utf-8")
    return name


def told(folder: Path, pictures: Path, cell: str) -> Any:
    """Return the workcell that a call writes."""
    out = folder / f"new_{cell}.yaml"
    assert call(folder, pictures, "-o", str(out), cell=cell) == 0
    return yaml.safe_load(out.read_text(encoding="utf-8"))


@pytest.mark.parametrize("stated", [0.28, pytest.param(0.56, marks=pytest.mark.slow)])
def test_aperture_and_focus_come_out_within_their_deviations(
    folder: Path, pictures: Path, stated: float
) -> None:
    """Of a workcell whose aperture is .7 or 1.4 of the true one."""
    new = told(folder, pictures, stating(folder, stated))
    how = new["calibrated"]
    assert new["optics"]["numerical_aperture"] == how["numerical_aperture"]["value"]
    for key, true in (
        ("numerical_aperture", APERTURE), ("focus_zero_um", ZERO_UM),
        ("focus_scale", 1.0),
    ):  # fmt: skip
        off = abs(how[key]["value"] - true)
        assert off < SIGMAS * how[key]["standard_deviation"]
        assert off < 0.02
    assert "wavefront" not in new["optics"]


@pytest.fixture(scope="module")
def aberrated(folder: Path) -> Path:
    """Return focus steps of a lens with astigmatism, coma, spherical aberration."""
    readings = [Reading(focus_um=z) for z in np.linspace(-5.3, 6.7, 7).tolist()]
    optics = replace(lens().optics, zernike=WAVES)
    return write_readings(
        folder / "aberrated", replace(lens(), optics=optics), readings
    )


def test_aberrations_come_out_with_their_signs(folder: Path, aberrated: Path) -> None:
    new = told(folder, aberrated, "workcell")
    found = {row["noll"]: row for row in new["optics"]["wavefront"]}
    assert {*found} == {*WAVES}
    for noll, true in WAVES.items():
        off = abs(found[noll]["waves"] - true)
        assert off < SIGMAS * found[noll]["sigma_waves"]
        assert off < 0.1 * abs(true)
    how = new["calibrated"]["numerical_aperture"]
    assert abs(how["value"] - APERTURE) < SIGMAS * how["standard_deviation"]
    assert len(new["calibrated"]["wavefront"]["standard_deviation"]) == len(WAVES)


def test_steps_on_one_side_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    steps = [Reading(focus_um=z_um) for z_um in (0.7, 1.2, 1.9, 2.4, 3.1)]
    assert call(folder, write_readings(folder / "above", lens(), steps)) == 2
    said = capsys.readouterr().err
    assert "0 readings below the sharpest" in said
    assert "photograph the part at nine focus readings" in said


def test_an_aperture_many_times_as_stated_is_refused(
    folder: Path, pictures: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = call(folder, pictures, cell=stating(folder, 0.1))
    assert found == 2
    said = capsys.readouterr().err
    assert "none is settled on" in said
    assert "numerical_aperture about right?" in said
