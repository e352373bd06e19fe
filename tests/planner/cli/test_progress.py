"""The line that says how far a compile has come, by a clock that tests turn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from microplan.planner.cli.progress import (
    KNOWN_S,
    LINES_S,
    Pace,
    Progress,
    barred,
    duration,
    kept_words,
    words,
)
from microplan.planner.looks.progress.work import CompileProgress, Images
from microplan.planner.store.store import Store


def reached(
    made: float = 0.0, look: str = "a", here: Images | None = None
) -> CompileProgress:
    """Return how far a compile of 100 images in two looks has come."""
    found = here or Images(made, 50)
    return CompileProgress(
        step="find", look=look, stage="race", steps=1, all_steps=3, here=found,
        all=Images(made, 100),
    )  # fmt: skip


class Clock:
    """Says what time a test has made it."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


def test_at_an_even_pace_the_time_left_is_what_it_will_take() -> None:
    pace = Pace()
    for made in range(100):
        look = "a" if made < 50 else "b"
        here = Images(made % 50, 50)
        left_s = pace.left_s(reached(made, look, here), 2.0 * made)
        if 2.0 * made >= KNOWN_S and made >= 5:
            assert left_s == pytest.approx(2.0 * (100 - made))
        else:
            assert left_s is None


def test_no_time_is_told_before_enough_is_known() -> None:
    assert Pace().left_s(reached(0), 1000.0) is None  # no image yet: no division
    assert Pace().left_s(reached(4), 1000.0) is None
    assert Pace().left_s(reached(99), KNOWN_S - 0.1) is None
    assert "left" not in words(reached(4), None)


def test_a_slow_look_is_foretold_by_its_own_pace() -> None:
    """Ten times as slow as the one before: the mean would promise a third of it."""
    pace = Pace()
    pace.left_s(reached(50, "a", Images(50, 50)), 50.0)
    pace.left_s(reached(50, "b", Images(0, 50)), 50.0)
    left_s = pace.left_s(reached(60, "b", Images(10, 50)), 150.0)
    assert left_s == pytest.approx(40 * 10.0)


def test_what_another_process_made_before_is_no_pace_of_this_look() -> None:
    pace = Pace()
    pace.left_s(reached(40, "b", Images(40, 50)), 40.0)
    left_s = pace.left_s(reached(45, "b", Images(45, 50)), 60.0)
    assert left_s == pytest.approx(5 * 4.0 + 50 * 60 / 45)


def test_a_look_that_makes_nothing_has_no_pace() -> None:
    """A cache has all of it, or it was not planned."""
    pace = Pace()
    pace.left_s(reached(50, "a"), 50.0)
    for spent_s in (50.0, 100.0):
        left_s = pace.left_s(reached(50, "c", Images()), spent_s)
        assert left_s == pytest.approx(50 * spent_s / 50)


def test_elsewhere_than_on_a_terminal_a_line_comes_every_ten_seconds(
    capsys: pytest.CaptureFixture[str],
) -> None:
    clock = Clock()
    shown = Progress(clock=clock, width=lambda: None)
    for tenth in range(1, 350):
        clock.now_s = 1000 + tenth / 10
        shown(reached(tenth / 10))
        if tenth / 10 < LINES_S:
            assert capsys.readouterr().err == ""
    shown.clear()
    lines = capsys.readouterr()
    assert lines.out == ""
    assert lines.err.splitlines() == [
        f"compiling find, race: 1 of 3 steps, {done} %, about 2 min left"
        for done in (10, 20, 30)
    ]


def test_a_terminal_has_one_line_that_is_left_empty(
    capsys: pytest.CaptureFixture[str],
) -> None:
    clock = Clock()
    shown = Progress(clock=clock, width=lambda: 60)
    for hundredth in range(100):
        clock.now_s = 1000 + hundredth / 100
        shown(reached(hundredth / 2))
    shown.clear()
    err = capsys.readouterr().err
    assert "\n" not in err
    drawn = [line for line in err.split("\r") if line]
    assert {len(line) for line in drawn} == {59}  # the last column would wrap
    assert 9 <= len(drawn) - 1 <= 11  # ten a second
    assert drawn[0].startswith("compiling find, race: 1 of 3 steps, 0 % [....")
    assert drawn[-1] == " " * 59


def test_nothing_that_was_not_drawn_is_cleared(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Progress(clock=Clock(), width=lambda: 60).clear()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("width", [1, 20, 40, 55, 80, 300])
@pytest.mark.parametrize("done", [0.0, 0.5, 1.0])
def test_a_bar_keeps_to_its_width(width: int, done: float) -> None:
    line = barred("compiling find: 1 of 3 steps", done, width)
    assert len(line) <= width
    full, left = line.count("#"), line.count(".")
    assert full == int(done * (full + left))
    assert (full + left == 0) == (width < 28 + 3 + 10)
    assert full + left <= 40


def test_a_compile_is_not_done_before_its_last_step() -> None:
    assert "99 %" in words(reached(100), 3.0)


@pytest.mark.parametrize(
    ("time_s", "said"),
    [
        (0.0, "about 5 s"),
        (11.0, "about 15 s"),
        (59.0, "about 60 s"),
        (61.0, "about 2 min"),
        (3600.0, "about 60 min"),
        (7201.0, "about 3 h"),
    ],
)
def test_times_are_told_as_roughly_as_they_are_known(time_s: float, said: str) -> None:
    assert duration(time_s) == said


def test_what_is_kept_is_what_is_on_the_disk(tmp_path: Path) -> None:
    assert kept_words(reached(1), Store(tmp_path)).startswith("kept: 1 of 3 steps")
    assert "cannot be written" in kept_words(reached(1), Store(tmp_path / "none"))
    assert "--no-cache" in kept_words(reached(1), None)
    none = replace(reached(1), steps=0)
    assert kept_words(none, Store(tmp_path)) == "nothing of use is kept yet"
    assert kept_words(None, None) == "nothing was computed yet"
