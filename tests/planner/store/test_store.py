"""Results on disk: whole or absent, verified, bounded, shared."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import time
from pathlib import Path

import pytest

from microplan.planner.store.store import Store


def key(number: int) -> str:
    return hashlib.sha256(str(number).encode()).hexdigest()


def files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]


def test_what_was_put_is_got(tmp_path: Path) -> None:
    store = Store(tmp_path / "cache")
    assert store.get(key(1)) is None
    for number in range(20):
        store.put(key(number), bytes([number]) * number)
    for number in range(20):
        assert store.get(key(number)) == bytes([number]) * number
    assert len(files(tmp_path)) == 20


@pytest.mark.parametrize("spoil", ["flip", "cut", "empty", "longer", "moved"])
def test_a_spoilt_result_counts_as_absent_and_goes(tmp_path: Path, spoil: str) -> None:
    store = Store(tmp_path)
    store.put(key(1), b"result")
    (file,) = files(tmp_path)
    data = file.read_bytes()
    asked = key(1)
    if spoil == "moved":  # a result under another's key
        asked = key(2)
        other = tmp_path / asked[:2]
        other.mkdir(exist_ok=True)
        (other / f"{asked[2:]}.result").write_bytes(data)
    else:
        changed = {"flip": data[:-1] + b"?", "cut": data[:-1], "empty": b"",
                   "longer": data + b"x"}[spoil]  # fmt: skip
        file.write_bytes(changed)
    assert store.get(asked) is None
    assert store.get(asked) is None
    assert len(files(tmp_path)) == (1 if spoil == "moved" else 0)


def test_the_least_used_goes_first(tmp_path: Path) -> None:
    store = Store(tmp_path, most_bytes=3 * 132)
    for number in range(5):
        store.put(key(number), bytes(100))
        (file,) = [f for f in files(tmp_path) if f.name.startswith(key(number)[2:])]
        os.utime(file, ns=(number, number))
    assert store.get(key(0)) == bytes(100)  # used just now
    store.trim()
    left = [number for number in range(5) if store.get(key(number)) is not None]
    assert left == [0, 3, 4]


def test_what_has_no_room_is_not_kept(tmp_path: Path) -> None:
    store = Store(tmp_path, most_bytes=100)
    store.put(key(1), bytes(100))
    assert files(tmp_path) == []


def test_what_dead_processes_left_goes_a_day_later(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.put(key(1), b"x")
    folder = next(tmp_path.iterdir())
    names = (".begun-old", ".begun-new", ".mine", "mine")
    for name in names:
        (folder / name).write_bytes(b"half")
    beside = tmp_path / "project"  # a folder of somebody else
    beside.mkdir()
    (beside / ".begun-old").write_bytes(b"mine")
    old_s = time.time() - 2 * 86400
    for path in (
        *(folder / name for name in names if "new" not in name),
        *beside.iterdir(),
    ):
        os.utime(path, (old_s, old_s))
    store.trim()
    left = {path.name for path in folder.iterdir() if path.suffix != ".result"}
    assert left == {".begun-new", ".mine", "mine"}
    assert (beside / ".begun-old").exists()
    assert store.get(key(1)) == b"x"


def test_a_folder_that_cannot_be_used_stops_nothing(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_bytes(b"mine")
    store = Store(blocked)
    store.put(key(1), b"x")
    assert store.get(key(1)) is None
    store.trim()
    assert blocked.read_bytes() == b"mine"


@pytest.mark.parametrize("bad", ["", "../x", "AB", "a/b"])
def test_a_key_is_a_digest(tmp_path: Path, bad: str) -> None:
    with pytest.raises(ValueError, match="digest"):
        Store(tmp_path).get(bad)


def _write(folder: Path, seed: int) -> None:
    store = Store(folder)
    for number in range(50):
        store.put(key(number), str(number).encode() * 1000)
        found = store.get(key((number * 7 + seed) % 50))
        assert found is None or found == str((number * 7 + seed) % 50).encode() * 1000


def test_processes_share_a_store(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    workers = [context.Process(target=_write, args=(tmp_path, s)) for s in range(2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
        assert worker.exitcode == 0
    store = Store(tmp_path)
    assert all(store.get(key(n)) == str(n).encode() * 1000 for n in range(50))
    assert len(files(tmp_path)) == 50
