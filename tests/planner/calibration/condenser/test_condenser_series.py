"""Settings of a condenser: from files to a coherence, and what is refused instead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
import yaml

from microplan.planner.cli.main import main
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from tests.planner.calibration.coherent_twin import (
    CAMERA,
    CondenserRig,
    CondenserShot,
    write_condenser,
)
from tests.planner.calibration.geometry.test_stage_series import FRAME, NEAR
from tests.planner.calibration.twin_series import LENS, cell_of
from validation.twins.scenes import write_dxf

SIGMAS = 2.0  # with room for what images of two makers differ by, they state
SHARE = 0.03  # of a coherence
PLACES = [(x, y) for x in (-7.9, 0.13, 8.2) for y in (-4.93, 4.61)]
ETCHED_UM = 0.1
SHOWN = "sensor_um:"
GREY = "black_level: 0, response: 1.0, sensor_um:"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with workcells and a drawing."""
    found = tmp_path_factory.mktemp("condenser") / "task"
    cell = cell_of(found)
    text = cell.read_text(encoding="utf-8").replace(
        "coherence: incoherent", "coherence: [0.2, 0.9]"
    )
    cell.write_text(text, encoding="utf-8")
    (found / "grey.yaml").write_text(text.replace(SHOWN, GREY), encoding="utf-8")
    write_dxf(FRAME, found / "frame.dxf", "FRAME")
    return found


def call(folder: Path, pictures: Path, *words: str, cell: str = "grey") -> int:
    workcell = ("--workcell", str(folder / f"{cell}.yaml"))
    part = ("--part", str(folder / "frame.dxf"), "--magnification", "20")
    return main(["calibrate", str(pictures), *workcell, *part, "--near", NEAR, *words])


def etched(**changes: Any) -> CondenserRig:
    """Return a frame whose edges lie farther out than drawn."""
    return CondenserRig(FRAME.buffer(ETCHED_UM, join_style="mitre"), **changes)


def shots(settings: Sequence[float], scale: float = 1.0) -> list[CondenserShot]:
    """Return pictures of all places; readings are the true apertures over a scale."""
    return [
        CondenserShot(
            coherence=s, reading=round(s * LENS.aperture / scale, 6), at_um=at
        )
        for s in settings
        for at in PLACES
    ]


def told(folder: Path, pictures: Path, cell: str = "grey") -> Any:
    """Return the workcell that a call writes."""
    out = folder / f"new_{pictures.name}.yaml"
    assert call(folder, pictures, "-o", str(out), cell=cell) == 0
    return yaml.safe_load(out.read_text(encoding="utf-8"))


def holds(new: Any, settings: Sequence[float]) -> None:
    """Check each setting's coherence and the part's own offset."""
    how = new["calibrated"]
    keys = [key for key in how if key.startswith("coherence_at_")]  # rising
    for key, true in zip(keys, sorted(settings), strict=True):
        off = abs(how[key]["value"] - true)
        assert off < SIGMAS * how[key]["standard_deviation"]
        assert off < SHARE * true
    first = how["coherence"]
    assert new["optics"]["coherence"] == pytest.approx(first["value"], rel=1e-5)
    for key, true, most in (
        ("coherence", settings[0], SHARE * settings[0]),
        ("own_edge_offset_um", ETCHED_UM, 0.01),
    ):
        off = abs(how[key]["value"] - true)
        assert off < SIGMAS * how[key]["standard_deviation"]
        assert off < most


def test_coherence_and_an_etched_edge_come_apart(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pictures = write_condenser(folder / "two", etched(), shots((0.3, 0.6)))
    new = told(folder, pictures)
    holds(new, (0.3, 0.6))
    said = capsys.readouterr()
    assert "at all settings" in said.out
    assert "contradicts" not in said.err
    text = (folder / "task.yaml").read_text(encoding="utf-8")
    task = folder / "with_new.yaml"
    task.write_text(text.replace("workcell.yaml", "new_two.yaml"), encoding="utf-8")
    report = Report()
    assert load_task(task, report) is not None
    assert not report.failed


@pytest.mark.slow
@pytest.mark.parametrize("settings", [(0.3, 0.6, 0.9), (0.9, 0.3), (0.6, 0.9)])
def test_each_setting_first(folder: Path, settings: tuple[float, ...]) -> None:
    name = "first_" + "_".join(map(str, settings))
    pictures = write_condenser(folder / name, etched(), shots(settings))
    holds(told(folder, pictures), settings)


@pytest.mark.slow
def test_readings_off_by_a_factor_are_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = shots((0.3, 0.6), scale=0.9)
    new = told(folder, write_condenser(folder / "scale", etched(), rows))
    holds(new, (0.3, 0.6))
    said = capsys.readouterr()
    assert "condenser_aperture contradicts the edges: 0.14 means 0.333" in said.err
    assert "seen over read: 0." in said.out


@pytest.mark.slow
def test_one_setting_that_reads_wrong_is_its_own(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [*shots((0.3,)), *shots((0.6,), scale=1.15)]
    new = told(folder, write_condenser(folder / "own", etched(), rows))
    holds(new, (0.3, 0.6))
    assert "readings share no factor" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("stated", [0.40, 0.44])
def test_another_aperture_than_stated_is_in_the_deviations(
    folder: Path, stated: float, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (folder / "grey.yaml").read_text(encoding="utf-8")
    name = f"aperture_{stated}"
    text = text.replace("numerical_aperture: 0.42", f"numerical_aperture: {stated}")
    (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    pictures = write_condenser(folder / name, etched(), shots((0.3, 0.6)))
    holds(told(folder, pictures, name), (0.3, 0.6))
    assert "optics.numerical_aperture" in capsys.readouterr().err


@pytest.mark.slow
def test_images_have_the_wavefront_error_that_is_stated(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    terms = ((8, 0.08), (11, 0.05))
    rows = ", ".join(f"{{noll: {noll}, waves: {waves}}}" for noll, waves in terms)
    text = (folder / "grey.yaml").read_text(encoding="utf-8")
    text = text.replace("optics:", f"optics:\n  wavefront: [{rows}]")
    (folder / "coma.yaml").write_text(text, encoding="utf-8")
    rig = etched(zernike=terms)
    pictures = write_condenser(folder / "coma", rig, shots((0.3, 0.6)))
    holds(told(folder, pictures, "coma"), (0.3, 0.6))
    assert "the side of focus is left out" in capsys.readouterr().out


@pytest.mark.slow
def test_edges_out_of_focus_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pictures = write_condenser(
        folder / "blurred", etched(defocus_um=1.6), shots((0.3, 0.6))
    )
    assert call(folder, pictures) == 2
    said = capsys.readouterr().err
    assert "no coherence: the edges are out of focus by 0.2" in said
    assert "photograph the part in focus at two settings" in said


@pytest.fixture(scope="module")
def few(folder: Path) -> Path:
    """Return a folder of two pictures at settings that differ."""
    rows = [CondenserShot(coherence=s, reading=s * LENS.aperture) for s in (0.3, 0.6)]
    return write_condenser(folder / "few", etched(), rows)


@pytest.mark.parametrize(
    ("readings", "cell", "said"),
    [
        ((0.12, 0.14), "grey", "the largest is 1.17 times the least"),
        ((0.12, 0.9), "grey", "means 2.14, only below 2 it is told"),
        ((0.01, 0.02), "grey", "means 0.0238, 0.08 is the least"),
        ((0.1260001, 0.1260002), "grey", "the largest is 1 times the least"),
        ((0.12, 0.25), "workcell", "no camera.response and no camera.black_level"),
        ((0.12, 0.25), "ring", "light.kind is ring"),
    ],
)
def test_what_tells_no_coherence_is_refused(
    folder: Path,
    few: Path,
    readings: tuple[float, float],
    cell: str,
    said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    ring = (folder / "grey.yaml").read_text(encoding="utf-8")
    ring = ring.replace("kind: coaxial", "kind: ring, elevation_deg: [30, 40]")
    (folder / "ring.yaml").write_text(ring, encoding="utf-8")
    rows = [f"000{k}.tif,{each}" for k, each in enumerate(readings)]
    table = ["file,condenser_aperture", *rows]
    (few / "readings.csv").write_text("\n".join(table), encoding="utf-8")
    assert call(folder, few, cell=cell) == 2
    found = capsys.readouterr().err
    assert "MP904" in found
    assert said in found


def test_the_first_row_s_setting_is_not_taken_from_another(
    folder: Path, few: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its picture does not show the part."""
    shown = tifffile.imread(few / "0000.tif")
    tifffile.imwrite(few / "dark.tif", np.full_like(shown, shown.min()))
    rows = ("dark.tif,0.06", "0000.tif,0.12", "0001.tif,0.25")
    text = "\n".join(("file,condenser_aperture", *rows))
    (few / "readings.csv").write_text(text, encoding="utf-8")
    assert call(folder, few) == 2
    assert "no picture of it is left" in capsys.readouterr().err


def test_saturated_pictures_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [CondenserShot(coherence=s, reading=s * LENS.aperture) for s in (0.3, 0.6)]
    bright = etched(camera=replace(CAMERA, gain=1.3))
    assert call(folder, write_condenser(folder / "bright", bright, rows)) == 2
    assert "is saturated in" in capsys.readouterr().err
