"""Discrepancy of a part's pictures: what was put in comes back, lens errors add."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from microplan.featuresel.look.discrepancy import Discrepancy, drawn
from microplan.planner.cli.main import main
from tests.planner.calibration.geometry.test_stage_series import FRAME, NEAR, WRONG, rig
from tests.planner.calibration.twin_series import LENS, UM_PER_PX, cell_of
from validation.twins.camera import Camera, exposed
from validation.twins.scenes import write_dxf
from validation.twins.series import Frame, Pose, Reading, Rig, write

CAMERA = Camera(full_well=10_000, read_noise=0.255)  # the workcell's
USUAL = {"edge": 0.03, "flat": 0.01, "pixel": 0.03}
FINE_UM = LENS.wavelength_um / LENS.aperture
NONE = {"edge": 0.0, "flat": 0.0, "pixel": 0.0}
PUT_IN = {"edge": 0.05, "flat": 0.02, "pixel": 0.03}
STEP = 0.8 - 0.1  # of light at the frame's edges
SIGMAS = 3.0  # three numbers stay within with 99 %


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a workcell and a frame's drawing."""
    found = tmp_path_factory.mktemp("discrepancy") / "task"
    cell_of(found)
    write_dxf(FRAME, found / "frame.dxf", "FRAME")
    return found


def pictures(
    folder: Path, seen: Rig, places: int, shares: Mapping[str, float] = NONE
) -> Path:
    """Write a picture at each place, in a group of its own, with shares put in."""
    rng = np.random.default_rng(5)
    size = Discrepancy(
        edge=shares["edge"], flat=shares["flat"], pixel=shares["pixel"] * STEP,
        fine_um=FINE_UM, size_um=16.0,
    )  # fmt: skip
    series: list[Frame] = []
    for _ in range(places):
        x_um, y_um = rng.uniform(-6, 6, 2).tolist()
        pose = Pose(x_um=x_um, y_um=y_um)
        light = seen.light(pose, 0.0)
        light = light + drawn(light, size, UM_PER_PX, FINE_UM, rng)
        counts = exposed(light, seen.camera, rng)
        series.append(Frame(counts=counts, truth=pose, reading=Reading()))
    write(folder, series, bits=8)
    names = [f"{index:04d}.tif,{index}" for index in range(places)]
    (folder / "readings.csv").write_text("\n".join(["file,group", *names]))
    return folder


def call(folder: Path, shown: Path, words: Sequence[str] = ()) -> int:
    cell = ("--workcell", str(folder / "workcell.yaml"))
    part = ("--part", str(folder / "frame.dxf"), "--magnification", "20")
    return main(["calibrate", str(shown), *cell, *part, "--near", NEAR, *words])


def found(folder: Path, shown: Path) -> Mapping[str, Mapping[str, float]]:
    """Return what the new workcell says of each share."""
    out = folder / f"{shown.name}.yaml"
    assert call(folder, shown, ["-o", str(out)]) == 0
    new = yaml.safe_load(out.read_text(encoding="utf-8"))
    lines = new["discrepancy"]
    assert list(lines) == [name for name in USUAL if name in lines]
    how = {name: new["calibrated"][f"discrepancy_{name}"] for name in lines}
    assert lines == {name: record["value"] for name, record in how.items()}
    return how


def plain() -> Rig:
    """Return the frame under a perfect lens."""
    return replace(rig(FRAME), camera=CAMERA)


def test_shares_come_back_as_they_were_put_in(folder: Path) -> None:
    told = found(folder, pictures(folder / "drawn", plain(), 16, PUT_IN))
    for name, each in told.items():
        off = each["value"] - PUT_IN[name]
        assert each["standard_deviation"] < PUT_IN[name] / 4
        # pixels are shares of the step that blur leaves: some 7 % less than bare
        own = 0.1 * PUT_IN[name] if name == "pixel" else 0.0
        assert abs(off) < SIGMAS * each["standard_deviation"] + own


def test_exact_pictures_have_hardly_any_and_errors_of_the_lens_add(
    folder: Path,
) -> None:
    exact = found(folder, pictures(folder / "exact", plain(), 3))
    lens = replace(plain(), optics=replace(LENS, halo=(3.0, 0.1)))
    veiled = found(folder, pictures(folder / "veiled", lens, 2))
    bent = replace(plain(), camera=replace(CAMERA, gamma=0.8))
    curved = found(folder, pictures(folder / "curved", bent, 2))
    for name, each in exact.items():
        assert each["value"] < USUAL[name] / 4
        assert "standard_deviation" not in each  # of fewer than six places
    for other in (veiled, curved):
        for name in ("edge", "flat"):
            if name in exact:  # else too few places tell it from none
                assert other[name]["value"] > 2 * exact[name]["value"]
            assert other[name]["value"] > USUAL[name] / 2


def test_groups_tell_something_of_a_known_part_only(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What was moved between pictures is no noise of the camera."""
    shown = pictures(folder / "moved", plain(), 2)
    cell = ("--workcell", str(folder / "workcell.yaml"))
    assert main(["calibrate", str(shown), *cell]) == 2
    assert "groups tell something of a known part only" in capsys.readouterr().err


def test_pictures_of_another_part_tell_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = replace(rig(WRONG), camera=CAMERA)
    assert call(folder, pictures(folder / "wrong", other, 2)) == 2
    assert "shows the part" in capsys.readouterr().err
