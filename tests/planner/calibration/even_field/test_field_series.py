"""`microplan calibrate` of pictures of an even field, from files to a workcell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from microplan.arrays import FloatArray
from microplan.planner.cli.main import main
from tests.planner.calibration.twin_series import SIZE, cell_of
from tests.planner.measure.small_look import save
from validation.twins.camera import Camera, exposed, graded

CAMERA = Camera(full_well=20_000.0, read_noise=1.0, black=12.0, gamma=0.7)
LIGHT = graded(np.full(SIZE, 0.5), 0.12, -0.05)
OTHER = graded(np.full(SIZE, 0.5), -0.12, 0.05)
STATED = "black_level: 12, response: 0.7"


def series(
    folder: Path, lights: list[FloatArray], head: str = "file,scene", cell: str = "even"
) -> Path:
    """Write a picture of each light, and a table."""
    folder.mkdir()
    rows = [head]
    for number, light in enumerate(lights):
        counts = exposed(light, CAMERA, np.random.default_rng(number))
        save(folder / f"{number}.png", counts.astype(np.uint8))
        rows.append(f"{number}.png,{cell.format(number)}")
    (folder / "readings.csv").write_text("\n".join(rows), encoding="utf-8")
    return folder


def station(tmp_path: Path, lines: str = STATED) -> Path:
    """Return a workcell whose camera states how counts follow the light."""
    cell = cell_of(tmp_path / "task")
    text = cell.read_text(encoding="utf-8")
    if lines:
        cell.write_text(text.replace("pixels: [", f"{lines}, pixels: ["))
    return cell


def test_an_even_field_gives_the_workcell_its_gradient(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell, out = station(tmp_path), tmp_path / "task" / "new.yaml"
    pictures = series(tmp_path / "p", [LIGHT] * 4)
    call = ["calibrate", str(pictures), "--workcell", str(cell), "-o", str(out)]
    assert main(call) == 0
    assert "light in 4 pictures of an even field" in capsys.readouterr().out
    new = yaml.safe_load(out.read_text(encoding="utf-8"))
    assert new["light"]["gradient"] == pytest.approx(0.13, abs=0.003)
    how = new["calibrated"]
    for key, true in {"light_gradient_x": 0.12, "light_gradient_y": -0.05}.items():
        off = how[key]["value"] - true
        assert abs(off) < 4 * how[key]["standard_deviation"]
    assert how["light_departure_rms"]["value"] < 0.003


@pytest.mark.parametrize(
    ("lights", "lines", "said"),
    [
        ([LIGHT * 2.2], STATED, "MP904"),
        ([LIGHT * 2.2], STATED, "0.png is saturated"),
        ([LIGHT * 0.02], STATED, "of full scale, less than 5%"),
        ([LIGHT], "", "states no camera.response and no camera.black_level: counts"),
        ([LIGHT], "response: 0.7", "the workcell states no camera.black_level: counts"),
        ([LIGHT], "black_level: 12", "the workcell states no camera.response: counts"),
        ([LIGHT, OTHER], STATED, "1.png contradicts the first picture: its gradient"),
        (
            [LIGHT[:, :100]],
            STATED,
            "is 100 x 96 px, the workcell's camera has 128",
        ),
        ([LIGHT + 0.2 * (np.indices(SIZE)[1] > 60)], STATED, "something"),
    ],
)
def test_pictures_that_tell_no_gradient_are_findings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str],
    lights: list[FloatArray], lines: str, said: str,
) -> None:  # fmt: skip
    cell, pictures = station(tmp_path, lines), series(tmp_path / "p", lights)
    assert main(["calibrate", str(pictures), "--workcell", str(cell)]) == 2
    shown = capsys.readouterr().err
    assert said in shown
    assert "photograph" in shown


def test_counts_that_are_all_alike_tell_no_more_than_their_step(
    tmp_path: Path,
) -> None:
    """Of a gamma of .7 a count of 88 is a share of 1 / (.7 88) of the light."""
    cell, out = station(tmp_path), tmp_path / "task" / "new.yaml"
    pictures = series(tmp_path / "p", [LIGHT])
    save(pictures / "0.png", np.full(SIZE, 100, dtype=np.uint8))
    call = ["calibrate", str(pictures), "--workcell", str(cell), "-o", str(out)]
    assert main(call) == 0
    how = yaml.safe_load(out.read_text(encoding="utf-8"))["calibrated"]
    at_a_border = 1 / (0.7 * 88) / 12**0.5
    sigma = how["light_departure_rms"]["standard_deviation"]
    assert sigma == pytest.approx(at_a_border, rel=0.02)
    assert how["light_gradient_x"]["standard_deviation"] > 2**0.5 * at_a_border


@pytest.mark.parametrize(
    ("head", "cell", "said"),
    [
        ("file,scene", "mirror", "scene is 'mirror'"),
        ("file,scene,light", "even,{}", "light changes beside an even field"),
        ("file,scene,z_um", "even,{}", "focus changes beside an even field"),
        ("file,group,scene", "{},even", ""),
    ],
)
def test_tables_of_an_even_field_change_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], head: str, cell: str, said: str
) -> None:
    pictures = series(tmp_path / "p", [LIGHT] * 2, head, cell)
    call = ["calibrate", str(pictures), "--workcell", str(station(tmp_path))]
    assert main(call) == (2 if said else 0)
    assert said in capsys.readouterr().err


def test_other_scenes_beside_an_even_field_are_a_finding(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pictures = series(tmp_path / "p", [LIGHT] * 2)
    table = pictures / "readings.csv"
    table.write_text("file,scene\n0.png,even\n1.png,\n", encoding="utf-8")
    call = ["calibrate", str(pictures), "--workcell", str(station(tmp_path))]
    assert main(call) == 2
    assert "not all scenes are even" in capsys.readouterr().err
