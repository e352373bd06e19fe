"""Files that are missing, endless, waiting or elsewhere count as empty."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from microplan.schemas.folders import contents, contents_within

FEW = 1 << 10


def test_a_file_is_read_up_to_a_size(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"x" * FEW)
    assert contents_within(tmp_path, "a", FEW) == b"x" * FEW
    assert contents_within(tmp_path, "a", FEW - 1) == b""


def test_what_never_ends_or_never_begins_is_no_file(tmp_path: Path) -> None:
    (tmp_path / "zero").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "pipe")
    for name in ("zero", "pipe", "", "."):
        assert contents_within(tmp_path, name, FEW) == b""


@pytest.mark.parametrize("name", ["../secret", "in/../../secret", "a\0b", "n" * 9999])
def test_nothing_is_read_outside_or_under_an_impossible_name(
    tmp_path: Path, name: str
) -> None:
    (tmp_path / "secret").write_bytes(b"x")
    inside = tmp_path / "in"
    inside.mkdir()
    assert contents_within(inside, name, FEW) == b""
    assert contents_within(inside, str(tmp_path / "secret"), FEW) == b""
    assert contents(inside / "none", FEW) == b""
