"""The log and the frames' index, with names that are no whole characters."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from microplan.executor.cli.session import _open
from microplan.executor.record.frames import Frames, read_png
from microplan.executor.record.write_ahead_log import Journal
from microplan.executor.simulated.cell import build_cell
from tests.executor.bench import world

HALF = "cable \udcff, \ud800, \u00b5m"  # bytes of a port, as they are read with Python


def test_words_of_half_a_character_are_kept_as_they_are(tmp_path: Path) -> None:
    """A driver's words must not end the run by another fault than its own."""
    path = tmp_path / "events.jsonl"
    with _open(path, "a") as stream:
        Journal(stream, build_cell(world(), 0).station.clock).write("failed", why=HALF)
    (line,) = path.read_text(encoding="utf-8").splitlines()
    assert json.loads(line)["why"] == HALF


def test_a_frame_of_such_a_look_is_kept(tmp_path: Path) -> None:
    frames = Frames(tmp_path)
    frames.enter(1, "see")
    frames.expect(HALF, None)
    counts = np.arange(12, dtype=np.uint8).reshape(3, 4)
    kept = frames.save(counts, None, {})
    assert kept == "frames/01_see_001.png"
    index = (tmp_path / "frames" / "index.jsonl").read_text(encoding="utf-8")
    assert json.loads(index)["look"] == HALF
    np.testing.assert_array_equal(read_png(tmp_path / kept), counts)


def test_a_picture_that_tells_of_more_than_there_is_cannot_be_read(
    tmp_path: Path,
) -> None:
    head = b"IHDR" + struct.pack(">IIBBBBB", 100_000, 100_000, 8, 0, 0, 0, 0)
    path = tmp_path / "huge.png"
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + struct.pack(">I", 13)
        + head
        + struct.pack(">I", zlib.crc32(head))
        + struct.pack(">I", 64)
        + b"IDAT"
        + bytes(68)
    )
    with pytest.raises(OSError, match="it"):
        read_png(path)
