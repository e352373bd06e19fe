"""Saved files are noticed once they are whole; the wait is the test's own."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from microplan.planner.source.saved_files import GONE_S, POLL_S, file_sha256, next_saved


class StoppedError(Exception):
    """No file was saved."""


class Hands:
    """Does one thing at each wait, as a person at an editor may; then stops."""

    def __init__(self, *acts: Callable[[], object]) -> None:
        self.acts = [*acts, *[nothing] * 20]

    def __call__(self, seconds: float) -> None:
        assert seconds == POLL_S
        if not self.acts:
            raise StoppedError
        self.acts.pop(0)()


def nothing() -> None:
    """Leave everything as it is for one wait."""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "task.yaml"
    path.write_text("a", encoding="utf-8")
    return path


def saved(file: Path, *acts: Callable[[], object]) -> list[str]:
    """Return what the file holds when it is told as saved, [] if it never is."""
    try:
        assert next_saved({str(file): file_sha256(str(file))}, Hands(*acts)) == (
            str(file),
        )
    except StoppedError:
        return []
    return [file.read_text(encoding="utf-8") if file.exists() else ""]


def test_what_is_written_in_pieces_is_read_whole(file: Path) -> None:
    def more(text: str) -> Callable[[], object]:
        return lambda: file.write_text(text, encoding="utf-8")

    assert saved(file, nothing, more("b"), more("bc"), more("bcd")) == ["bcd"]


def test_a_new_time_is_no_change(file: Path) -> None:
    assert saved(file, nothing, lambda: os.utime(file, (1, 1))) == []


def test_a_file_that_is_gone_for_a_moment_is_not_missing(file: Path) -> None:
    few = int(GONE_S / POLL_S) - 2
    back = (file.unlink, *[nothing] * few, lambda: file.write_text("b"))
    assert saved(file, *back) == ["b"]


def test_a_file_that_stays_away_is_missing(file: Path) -> None:
    assert saved(file, file.unlink) == [""]


def test_a_folder_in_its_place_is_no_bug(tmp_path: Path) -> None:
    missing = tmp_path / "no.yaml"
    assert saved(missing, missing.mkdir) == []
