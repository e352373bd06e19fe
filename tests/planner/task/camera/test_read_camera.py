"""Cameras as the workcell states them, and findings where their numbers disagree."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.planner.task.light.test_check_light import loaded

PLAIN = "bits: 8, "
TABLE = "[[0, 0], [0.1, 0.4], [1, 1]]"


def stated(text: str) -> dict[str, str]:
    """Return a change of the workcell that states more of the camera."""
    return {PLAIN: f"{PLAIN}{text}, "}


def test_a_camera_counts_in_proportion_if_nothing_else_is_stated(
    tmp_path: Path,
) -> None:
    task, _ = loaded(tmp_path, {})
    assert task is not None
    assert task.workcell.camera.sensor.is_plain


def test_a_table_is_read_between_black_and_white(tmp_path: Path) -> None:
    text = f"response: {TABLE}, black_level: -10, white_level: 240"
    task, _ = loaded(tmp_path, stated(text))
    assert task is not None
    response = task.workcell.camera.sensor.response
    assert response is not None
    assert response.rows == ((0.0, -10.0), (0.1, 90.0), (1.0, 240.0))


def test_a_number_is_a_power(tmp_path: Path) -> None:
    task, _ = loaded(tmp_path, stated("response: 0.5"))
    assert task is not None
    curve = task.workcell.camera.sensor.curve
    light = np.array([0.04, 0.25, 0.81])
    np.testing.assert_allclose(curve.counts_of(light), 255 * light**0.5, atol=0.02)


def test_levels_alone_are_a_straight_response(tmp_path: Path) -> None:
    task, _ = loaded(tmp_path, stated("black_level: 12"))
    assert task is not None
    response = task.workcell.camera.sensor.response
    assert response is not None
    assert response.rows == ((0.0, 12.0), (1.0, 255.0))


def test_noise_and_pattern_are_the_sensors(tmp_path: Path) -> None:
    text = "noise_table: [[10, 25], [240, 2]], pattern: {gain: 0.01, offset_counts: 2}"
    task, _ = loaded(tmp_path, stated(text))
    assert task is not None
    sensor = task.workcell.camera.sensor
    assert sensor.noise == ((10.0, 25.0), (240.0, 2.0))
    assert (sensor.pattern_gain, sensor.pattern_counts) == (0.01, 2.0)


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        ("response: [[0, 0], [0.5, 0.5], [0.4, 1]]", "[[0, 0]", "must rise"),
        ("response: [[0, 0], [0.5, 0.5], [0.7, 0.5], [1, 1]]", "[[0, 0]", "must rise"),
        ("response: [[0, 0.1], [1, 1]]", "[[0, 0.1]", "[0, 0.1] to [1, 1]"),
        ("response: [[0, 0], [0.9, 1]]", "[[0, 0]", "[0, 0] to [0.9, 1]"),
        ("white_level: 300", "300", "above 255, the top count of 8 bits"),
        ("black_level: 90, white_level: 80", "90", "leaves -10 counts"),
        ("black_level: 250", "250", "leaves 5 counts up to white_level 255, 8 at"),
        ("black_level: -600", "-600", "cuts off more than half of all levels"),
        ("noise_table: [[8, 25], [90, 90000]]", "[[8, 25]", "variances above 16256"),
        ("black_level: -0.2, white_level: 0.4", "-0.2", "leaves 0.4 counts"),
        ("response: [[0, 0], [0.5, 1.0e-18], [1, 1]]", "[[0, 0]", "must rise"),
        ("noise_table: [[10, 4], [256, 1]]", "[[10, 4]", "levels above 255"),
        ("noise_table: [[9, 2], [9, 3]]", "[[9, 2]", "must rise, got [9, 2], [9, 3]"),
    ],
)
def test_numbers_that_contradict_each_other_are_found_at_their_line(
    tmp_path: Path, text: str, column: str, words: str
) -> None:
    task, found = loaded(tmp_path, stated(text))
    assert task is None
    (error,) = (d for d in found if d.severity == "error")
    assert error.code == "MP116"
    assert words in error.message
    start = error.where.text.index(column)
    assert error.where.column == start + 1
    assert error.hint


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("noise_table: [8, 25]", "as [10, 25]"),
        ("noise_table: {8: 25}", "as [[10, 25], [240, 2]]"),
        ("response: [[0, 8], [1, 247]]", "light or level, a share of its range"),
        ("response: '0.45'", "write 0.45"),
        ("response: bright", "as 0.45"),
        ("pattern: 0.01", "as {gain: 0.01, offset_counts: 1}"),
    ],
)
def test_a_hint_says_how_it_is_written(tmp_path: Path, text: str, hint: str) -> None:
    task, found = loaded(tmp_path, stated(text))
    assert task is None
    assert {d.hint for d in found if d.severity == "error"} == {hint}


@pytest.mark.parametrize(
    "text",
    [
        "response: 0",
        "response: 1.0e-18",
        "response: true",
        "response: [[0, 0]]",
        "response: [[0, 0, 0], [1, 1, 1]]",
        "response: gamma",
        "response: .nan",
        "noise_table: []",
        "noise_table: [[0, -1]]",
        "pattern: {gain: 2}",
        "pattern: {prnu: 0.1}",
        "white_level: 0",
    ],
)
def test_what_the_schema_refuses_has_a_place(tmp_path: Path, text: str) -> None:
    task, found = loaded(tmp_path, stated(text))
    assert task is None
    errors = [d for d in found if d.severity == "error"]
    assert errors
    assert all(text.split(":")[0] in d.where.text for d in errors)
