"""`microplan calibrate`: from files to a workcell, and what pictures do not tell."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from microplan.arrays import FloatArray
from microplan.planner.calibration.calibrated_cell import (
    calibrated_text,
    first_of_each,
)
from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    CalibrationSeries,
    PictureSource,
)
from microplan.planner.calibration.count_levels import count_levels
from microplan.planner.calibration.photon_transfer import noise_rows
from microplan.planner.calibration.picture_series import NoiseByLevel
from microplan.planner.calibration.workcell_lines import with_calibrated
from microplan.planner.cli.main import main
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.task.read_task import load_task
from tests.planner.calibration.simulated_camera import Camera, patches
from tests.planner.calibration.test_photon_transfer import steps
from tests.planner.examples import EXAMPLE
from tests.planner.measure.small_look import Counts, save

READ = 1.7  # counts of noise, of every level


def frames(count: int, light: FloatArray | None = None) -> list[Counts]:
    """Return frames of a chart with the same noise everywhere."""
    rng = np.random.default_rng(2)
    mean = 255 * (steps() if light is None else light)
    noisy = [mean + rng.normal(0, READ, mean.shape) for _ in range(count)]
    return [np.clip(np.rint(each), 0, 255).astype(np.uint8) for each in noisy]


def written(folder: Path, pictures: Sequence[Any]) -> Path:
    """Write pictures as files, in their order, and return their folder."""
    folder.mkdir()
    for number, picture in enumerate(pictures):
        save(folder / f"{number:03}.png", picture)
    return folder


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """Return the example's workcell in a folder of its own."""
    shutil.copytree(EXAMPLE, tmp_path / "task", dirs_exist_ok=True)
    return tmp_path / "task" / "workcell.yaml"


def test_a_workcell_gets_the_noise_that_pictures_have(
    tmp_path: Path, cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All else stays as it is, comments included, and the task compiles with it."""
    pictures, out = written(tmp_path / "p", frames(16)), cell.with_name("new.yaml")
    assert (
        main(["calibrate", str(pictures), "--workcell", str(cell), "-o", str(out)]) == 0
    )
    said = capsys.readouterr().out
    assert "noise in 16 pictures" in said
    new = yaml.safe_load(out.read_text(encoding="utf-8"))
    old = yaml.safe_load(cell.read_text(encoding="utf-8"))
    table, how = new["camera"].pop("noise_table"), new.pop("calibrated")
    assert new == old
    for _, variance in table:
        assert variance == pytest.approx(READ**2 + 1 / 12, rel=0.1)
    assert how["noise_table"]["pictures"] == 16
    assert len(how["noise_table"]["standard_deviation"]) == len(table) == 24
    kept = set(cell.read_text(encoding="utf-8").splitlines())
    left = kept - set(out.read_text(encoding="utf-8").splitlines())
    assert {line[:7] for line in left} == {"camera:"}
    task = cell.with_name("task.yaml")
    text = task.read_text(encoding="utf-8")
    task.write_text(text.replace("workcell.yaml", "new.yaml"), encoding="utf-8")
    report = Report()
    read = load_task(task, report)
    assert read is not None
    assert not report.failed
    assert read.workcell.camera.sensor.noise[0][1] == table[0][1]


def test_calibrating_again_replaces_what_was_found(tmp_path: Path, cell: Path) -> None:
    out = cell.with_name("new.yaml")
    for number, count in enumerate((8, 10)):
        pictures = written(tmp_path / str(number), frames(count))
        words = ["--workcell", str(cell if number == 0 else out), "-o", str(out)]
        assert main(["calibrate", str(pictures), *words]) == 0
    new = yaml.safe_load(out.read_text(encoding="utf-8"))
    assert new["calibrated"]["noise_table"]["pictures"] == 10
    assert out.read_text(encoding="utf-8").count("noise_table") == 2


TABLE = CalibratedValue(
    key="noise_table", value=((5.0, 6.0),), sigma=(0.5,), unit="counts", method="d",
    source=PictureSource(pictures=9, sha256="ab" * 32), where=("camera", "noise_table"),
)  # fmt: skip
BLOCK = """# a cell
camera:
  # its sensor
  bits: 8
  noise_table:   # old
    - [1, 2]
    - [3, 4]  # the last
  full_well_e: 10000
calibrated:
  response: {method: m, pictures: 1, sha256: aa}
# after
light: {kind: coaxial}
"""


def test_lines_are_put_into_a_file_written_in_blocks() -> None:
    found = with_calibrated(BLOCK, [TABLE])
    data = yaml.safe_load(found)
    assert data["camera"] == {
        "bits": 8, "noise_table": [[5, 6]], "full_well_e": 10000,
    }  # fmt: skip
    assert set(data["calibrated"]) == {"noise_table", "response"}
    assert data["light"] == {"kind": "coaxial"}
    for line in ("# a cell", "  # its sensor", "# after", "# the last"):
        assert line in found
    bare = with_calibrated("camera: {bits: 8}  # b\n", [TABLE])
    assert yaml.safe_load(bare)["camera"] == {"noise_table": [[5, 6]], "bits": 8}
    assert "# b" in bare


@pytest.mark.parametrize(
    "before", ['{"camera": {"bits": 8}}', "{camera: {bits: 8},\n}"]
)
def test_lines_are_put_into_a_file_in_braces(before: str) -> None:
    older = replace(TABLE, value=((1.0, 2.0),))
    for text in (before, with_calibrated(before, [older])):
        data = yaml.safe_load(with_calibrated(text, [TABLE]))
        assert data["camera"] == {"bits": 8, "noise_table": [[5, 6]]}
        assert data["calibrated"]["noise_table"] == TABLE.record


def refused(
    pictures: Path, cell: Path, capsys: pytest.CaptureFixture[str], *words: str
) -> str:
    """Return what is said of a call that fails and writes nothing."""
    out = cell.with_name("none.yaml")
    call = ["calibrate", str(pictures), "--workcell", str(cell), "-o", str(out)]
    assert main([*call, *words]) == 2
    assert not out.exists()
    return capsys.readouterr().err


def test_pictures_that_do_not_tell_the_noise_are_refused(
    tmp_path: Path, cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = written(tmp_path / "few", frames(3))
    assert "3 pictures tell no noise, 8 are needed" in refused(few, cell, capsys)
    one = frames(1) * 9
    same = refused(written(tmp_path / "same", one), cell, capsys)
    assert "exactly the pixels of picture 1" in same
    white = written(tmp_path / "w", frames(9, np.full((64, 64), 1.0)))
    assert "no pixel is clear of edges" in refused(white, cell, capsys)
    other = [*frames(9), np.zeros((5, 5), dtype=np.uint8)]
    sizes = refused(written(tmp_path / "sizes", other), cell, capsys)
    assert "it is 5 x 5 px, 000.png is 256 x 256" in sizes
    deep = [each.astype(np.uint16) * 16 for each in frames(9)]
    assert "full scale is 65535" in refused(
        written(tmp_path / "deep", deep), cell, capsys
    )
    good = written(tmp_path / "good", frames(9))
    assert "full scale is 4095" in refused(good, cell, capsys, "--bits", "12")
    assert "full scale is 15" in refused(good, cell, capsys, "--bits", "4")
    lost = cell.with_name("lost.yaml")
    assert main(["calibrate", str(good), "--workcell", str(lost)]) == 2
    assert "MP001" in capsys.readouterr().err


def test_nothing_else_is_overwritten(
    tmp_path: Path, cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = written(tmp_path / "good", frames(9))
    task = cell.with_name("task.yaml")
    before = task.read_bytes()
    call = ["calibrate", str(good), "--workcell", str(cell), "-o"]
    assert main([*call, str(task)]) == 2
    assert "error[MP703]" in capsys.readouterr().err
    assert task.read_bytes() == before
    assert main([*call, str(tmp_path / "away.yaml")]) == 2
    assert "error[MP904]" in capsys.readouterr().err


def test_what_is_cut_off_is_said_and_the_rest_is_told(
    tmp_path: Path, cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    light = steps()
    light[:64] = -0.1
    light[192:] = 1.1
    pictures = written(tmp_path / "cut", frames(9, light))
    assert main(["calibrate", str(pictures), "--workcell", str(cell)]) == 0
    said = capsys.readouterr()
    assert "with -o FILE they are put into a workcell" in said.out
    assert "of the counts are 0: the black level cuts off" in said.err
    assert "of the counts are saturated, at 255" in said.err


def test_many_copies_are_one_finding_and_an_empty_folder_one(
    tmp_path: Path, cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pictures = [*frames(9), *frames(1) * 5]
    copies = written(tmp_path / "copies", pictures)
    assert main(["calibrate", str(copies), "--workcell", str(cell)]) == 0
    said = capsys.readouterr().err
    assert said.count("warning[MP904]") == 1
    assert "010.png" not in said
    assert "and 4 more are copies" in said
    (tmp_path / "empty").mkdir()
    none = refused(tmp_path / "empty", cell, capsys)
    assert none.count("error[") == 1


def test_read_noise_is_that_of_the_black_level() -> None:
    """Of 10 000 electrons over 4000 counts, with 9 e and black at 100."""
    camera = Camera(black=100.0, white=4100.0, read_e=9.0)
    scene = camera.scene(0.9 * patches(96), 16, np.random.default_rng(1))
    levels = count_levels(scene.codes, 4095)
    rows = noise_rows(scene, levels)
    for black, said in ((None, None), (100.0, 9.0)):
        noise = NoiseByLevel(
            frames=16, levels=levels, rows=rows, source=TABLE.source, black_level=black
        )
        *_, words = noise.series.notes
        assert "electrons a count" in words
        assert ("of read noise" in words) == (said is not None)
        if said is not None:
            number = float(words.split(", ")[1].split()[0])
            assert number == pytest.approx(said, rel=0.25)


def valued(value: float, sigma: float | None, heading: str) -> CalibrationSeries:
    one = replace(TABLE, key="black_level", value=value, sigma=(sigma,))
    return CalibrationSeries(heading=heading, values=(one,))


def test_a_value_that_is_left_out_is_a_finding_with_both() -> None:
    report, first = Report(), valued(12.0, 0.1, "first")
    kept = first_of_each([first, valued(14.0, 0.1, "other")], Span(file="cell"), report)
    assert kept == [*first.values]
    (found,) = report.found
    assert "12 +- 0.1 by the first, 14 +- 0.1 by the other" in found.message
    assert "14 standard deviations apart: they contradict" in found.message
    near = Report()
    first_of_each([first, valued(12.1, None, "other")], Span(file="cell"), near)
    assert "contradict" not in near.found[0].message
    assert not first_of_each([], Span(file="cell"), near)


def test_of_values_that_a_stated_key_contradicts_nothing_is_written(
    tmp_path: Path, cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Lights darker than a black level of 249 that only white_level 255 leaves."""
    text = cell.read_text(encoding="utf-8")
    cell.write_text(
        text.replace("camera: {", "camera: {white_level: 20, black_level: 2, "),
        encoding="utf-8",
    )
    values = [
        replace(TABLE, key="black_level", value=18.0, sigma=(0.1,),
                where=("camera", "black_level"))
    ]  # fmt: skip
    report = Report()
    new = cell.with_name("new.yaml")
    assert calibrated_text(cell.read_text(), values, new, report) is None
    assert report.found[-1].hint == "mend camera.white_level in the workcell"
