"""Lines of the journal: on the disk, in order, and proof against damage."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.record.recovery import journal_in, read_journal
from microplan.executor.record.write_ahead_log import (
    FILE,
    FileStore,
    WriteAheadLog,
    opened,
    sealed,
)

READING = {"x_um": 0.0, "y_um": 0.0, "z_um": 0.0, "theta_rad": 0.0}
HEADER = {
    "format": 1,
    "header": {
        "plan_sha256": "", "station": "sim", "seed": 0, "faults": [], "devices": {},
    },
    "standing": {"stage": READING, "robot": None, "opening_um": None},
}  # fmt: skip


class Disk:
    """A store in memory."""

    def __init__(self) -> None:
        self.data = b""

    def append(self, line: bytes) -> None:
        """Keep a line."""
        self.data += line


def journal(errors: int) -> bytes:
    """Return the bytes of a journal of a step with some errors."""
    disk = Disk()
    write_ahead = WriteAheadLog(disk)
    write_ahead.write("run", **HEADER)
    write_ahead.write("begin", step="over_shaft")
    for number in range(errors):
        write_ahead.write("error", error_um=1 / 3 + number)
    return disk.data


def test_a_line_is_on_the_disk_before_the_call_returns(tmp_path: Path) -> None:
    synced: list[int] = []

    def sync(number: int) -> None:
        synced.append(os.fstat(number).st_size)

    store = FileStore(tmp_path / FILE, sync=sync)
    write_ahead = WriteAheadLog(store)
    for step in ("a", "b"):
        write_ahead.write("begin", step=step)
        assert synced[-1] == (tmp_path / FILE).stat().st_size
    store.close()
    lines = (tmp_path / FILE).read_text(encoding="ascii").splitlines()
    assert [json.loads(line)["seq"] for line in lines] == [1, 2]


def test_numbers_come_back_exactly() -> None:
    assert journal_in(journal(3)).state.errors_um == [1 / 3, 4 / 3, 7 / 3]


@given(st.dictionaries(st.text(min_size=1), st.text()), st.integers(0, 2**32 - 1))
def test_what_was_sealed_opens_with_the_same_chain_only(
    data: dict[str, str], chain: int
) -> None:
    line, after = sealed(json.dumps({"seq": 1, **data}), chain)
    assert opened(line, chain) == ({"seq": 1, **data}, after)
    assert opened(line, chain ^ 1) is None


@given(st.data())
def test_a_journal_cut_anywhere_tells_of_its_whole_lines(data: st.DataObject) -> None:
    whole = journal(6)
    cut = data.draw(st.integers(whole.index(b"\n") + 1, len(whole)))
    found = journal_in(whole[:cut])
    assert found.size == whole[:cut].rfind(b"\n") + 1
    assert found.seq == whole[:cut].count(b"\n")
    assert len(found.state.errors_um) == max(found.seq - 2, 0)


@given(st.data())
def test_a_changed_byte_is_found_wherever_it_is(data: st.DataObject) -> None:
    whole = bytearray(journal(6))
    at = data.draw(st.integers(0, len(whole) - 1))
    whole[at] ^= data.draw(st.integers(1, 255))
    told = code_of(bytes(whole))
    if at > journal(6)[:-1].rfind(b"\n"):  # the last line is dropped, it may be torn
        assert told is None
        assert journal_in(bytes(whole)).seq == 7
    else:
        assert told in ("MP867", "MP868")


def code_of(data: bytes) -> str | None:
    """Return why a journal is refused, None if it is not."""
    try:
        journal_in(data)
    except ExecutorError as error:
        return error.code
    return None


def without_a_line(lines: list[bytes]) -> list[bytes]:
    return lines[:3] + lines[4:]


def with_a_line_twice(lines: list[bytes]) -> list[bytes]:
    return lines[:4] + lines[3:]


def with_two_lines_exchanged(lines: list[bytes]) -> list[bytes]:
    return [*lines[:3], lines[4], lines[3], *lines[5:]]


@pytest.mark.parametrize(
    ("spoil", "line"),
    [(without_a_line, 4), (with_a_line_twice, 5), (with_two_lines_exchanged, 4)],
)
def test_lines_that_are_lost_or_moved_are_found(
    spoil: Callable[[list[bytes]], list[bytes]], line: int, tmp_path: Path
) -> None:
    lines = spoil(journal(6).splitlines(keepends=True))
    (tmp_path / FILE).write_bytes(b"".join(lines))
    with pytest.raises(ExecutorError, match=f"line {line} is damaged") as caught:
        read_journal(tmp_path / FILE)
    assert caught.value.code == "MP867"


def test_a_whole_line_that_means_nothing_is_refused() -> None:
    disk = Disk()
    write_ahead = WriteAheadLog(disk)
    write_ahead.write("run", **{**HEADER, "format": 99})
    write_ahead.write("begin", step="")
    with pytest.raises(ExecutorError, match="no journal of format 1"):
        journal_in(disk.data)


def test_errors_count_on_after_a_kill_and_not_after_a_failure() -> None:
    """A run that gave up after so many looks may be mended, and tries anew."""
    disk = Disk()
    write_ahead = WriteAheadLog(disk)
    write_ahead.write("run", **HEADER)
    write_ahead.write("begin", step="over_shaft")
    write_ahead.write("error", error_um=2.0)
    assert journal_in(disk.data).state.errors_um == [2.0]
    write_ahead.write("end", code="MP830", why="too many looks")
    assert journal_in(disk.data).state.errors_um == []


def test_an_empty_journal_has_nothing_to_resume() -> None:
    with pytest.raises(ExecutorError) as caught:
        journal_in(b"")
    assert caught.value.code == "MP868"


@pytest.mark.parametrize("number", [errno.EIO, errno.ENOSPC])
def test_after_a_line_that_failed_no_other_is_written(
    number: int, tmp_path: Path
) -> None:
    failing = [False]

    def sync(_: int) -> None:
        if failing[0]:
            raise OSError(number, os.strerror(number))

    store = FileStore(tmp_path / FILE, sync=sync)
    write_ahead = WriteAheadLog(store)
    write_ahead.write("run", **HEADER)
    failing[0] = True
    for _ in range(2):
        with pytest.raises(ExecutorError, match=r"line 2 of journal\.jsonl") as caught:
            write_ahead.write("begin", step="a")
        assert caught.value.code == "MP863"
        failing[0] = False  # the disk may recover, a torn line does not
    store.close()
    assert read_journal(tmp_path / FILE).seq <= 2


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has /dev/full")
def test_a_full_disk_is_told() -> None:
    with Path("/dev/full").open("wb", buffering=0) as full:

        class Full:
            def append(self, line: bytes) -> None:
                full.write(line)

        with pytest.raises(ExecutorError, match="No space left") as caught:
            WriteAheadLog(Full()).write("begin", step="a")
    assert caught.value.code == "MP863"


def test_a_torn_line_is_cut_off_before_the_next_is_written(tmp_path: Path) -> None:
    path, whole = tmp_path / FILE, journal(2)
    path.write_bytes(whole + b'{"crc": "01')
    found = read_journal(path)
    store = FileStore(path, found.size)
    WriteAheadLog(store, seq=found.seq, chain=found.chain).write("error", error_um=9.0)
    store.close()
    assert read_journal(path).state.errors_um[-1] == 9.0
