"""Marked pictures: the contour is where the target is, in the verdict's colour."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from microplan.planner.cli.main import main
from tests.planner.measure.small_look import CALL, post_look, save, taken, task_file

GREEN = (0, 200, 0)  # blue, green, red


def mark(*words: str | Path) -> int:
    """Return the exit status of a call."""
    return main(["measure", "--task", str(task_file()), *CALL, *map(str, words)])


def test_the_contour_lies_about_the_post(tmp_path: Path) -> None:
    save(tmp_path / "a.png", taken(3.0, -2.0))
    assert mark(tmp_path / "a.png", "--mark", tmp_path / "marks") == 0
    image = cv2.imread(str(tmp_path / "marks" / "a.png"))
    assert image is not None
    window, scope = post_look().case.window, post_look().case.microscope
    scale = image.shape[1] // window.columns
    assert image.shape[1] >= 400
    row, column = np.nonzero((image == GREEN).all(axis=2))
    x_px = (column + 0.5) / scale - 0.5 + window.column - (scope.width_px - 1) / 2
    y_px = (scope.height_px - 1) / 2 - ((row + 0.5) / scale - 0.5 + window.row)
    far_um = np.hypot(x_px * scope.um_per_px - 3.0, y_px * scope.um_per_px + 2.0)
    outer = far_um[far_um > 10]  # not the cross in the middle
    dot_um = 1.5 * scope.um_per_px / scale  # a dot reaches so far off its place
    assert len(outer) > 300
    assert np.abs(outer - 22.0).max() < 2 * dot_um


def test_a_refused_target_is_drawn_in_red(tmp_path: Path) -> None:
    file = save(tmp_path / "a.png", taken(15.0, 0.0))  # gates allow 13.5 um
    assert mark(file, "--chain", "otsu", "--mark", tmp_path / "marks") == 1
    image = cv2.imread(str(tmp_path / "marks" / "a.png"))
    assert image is not None
    assert (image == (0, 0, 255)).all(axis=2).sum() > 300
    assert not (image == GREEN).all(axis=2).any()


def test_pictures_of_one_name_get_marks_of_their_own(tmp_path: Path) -> None:
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        save(tmp_path / folder / "a.png", taken(0.0, 0.0, seed=len(folder)))
    mark(tmp_path / "one", tmp_path / "two", "--mark", tmp_path / "marks")
    names = sorted(file.name for file in (tmp_path / "marks").iterdir())
    assert names == ["a-2.png", "a.png"]


def test_pictures_are_never_replaced_by_marks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = save(tmp_path / "a.png", taken(0.0, 0.0))
    before = file.read_bytes()
    assert mark(file, "--mark", tmp_path) == 2
    assert "MP703" in capsys.readouterr().err
    assert file.read_bytes() == before
