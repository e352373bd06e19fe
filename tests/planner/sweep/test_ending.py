"""Sweeps that end early, in folders of others, with rows that fail: nothing is lost."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from microplan.planner.cli.main import main
from microplan.planner.queue.work_queue import WorkerDiedError
from microplan.planner.source.diagnostics import CallError, Report
from microplan.planner.store.store import Store
from microplan.planner.sweep.rows import RowFile, SweepRow, compile_row
from microplan.planner.sweep.sweeping import ROWS, TABLE, SweepCall, write_sweep
from microplan.planner.task.task import Task
from tests.planner.examples import change
from tests.planner.sweep.no_looks import SETTINGS, no_looks, readings, swept, table

SWEEPING = "microplan.planner.sweep.sweeping"
MORE = (SETTINGS[0], ("seed", "1,2,3"))


def call_of(out: Path, **others: Any) -> SweepCall:
    return SweepCall(
        **{"settings": SETTINGS, "out": out, "store": Store(readings()), **others}
    )


def lines(out: Path) -> list[dict[str, Any]]:
    """Return the rows that a folder keeps."""
    return [json.loads(line) for line in (out / ROWS).read_bytes().splitlines()]


@pytest.mark.parametrize(
    ("file", "edit"),
    [
        ("task.yaml", partial(change, old="seed: 1998", new="seed: 7")),
        ("task.yaml", partial(change, old="microplan:", new="microplan")),
        ("workcell.yaml", partial(change, old="max: 44.5}", new="max: 20}")),
        ("parts/gear18.dxf", Path.unlink),
    ],
)
def test_a_file_that_is_edited_meanwhile_ends_the_sweep(
    file: str, edit: Callable[[Path], object], tmp_path: Path
) -> None:
    task, out, shown = no_looks(tmp_path / "task"), tmp_path / "out", list[str]()
    edited = task.with_name("task.yaml").parent / file
    before = edited.read_bytes()

    def show(line: str) -> None:
        shown.append(line)
        if len(shown) == 1 + 2:
            edit(edited)

    with pytest.raises(CallError, match=f"{file} changed while it was swept") as found:
        write_sweep(str(task), call_of(out, show=show), Report())
    assert found.value.code == "MP730"
    assert len(lines(out)) == len(table(out)) == 2
    edited.write_bytes(before)
    assert swept(task, out) == swept(task, tmp_path / "other")


def test_a_scheduler_that_fails_takes_no_row_away(tmp_path: Path) -> None:
    task, out = no_looks(tmp_path / "task"), tmp_path / "out"
    swept(task, out)
    before = table(out)
    nobody = partial(call_of, out, scheduler="tcp://nowhere", settings=MORE)
    with pytest.raises(CallError, match=r"scheduler|Dask"):
        write_sweep(str(task), nobody(), Report())
    rows = [{k: v for k, v in row.items() if k != "row"} for row in table(out)]
    assert rows == [{k: v for k, v in row.items() if k != "row"} for row in before]
    full = (out / TABLE).read_bytes()
    change(task, "roughness_nm: 20", "roughness_nm: 200")  # no row is known then
    with pytest.raises(CallError):
        write_sweep(str(task), nobody(), Report())
    assert (out / TABLE).read_bytes() == full


@pytest.mark.parametrize(
    ("name", "data"),
    [
        (ROWS, b'{"a": 1}\n'),
        (ROWS, b"[]"),
        (TABLE, b"a,b\n1,2\n"),
        (TABLE, b"\0\0\n"),
        (TABLE, b"row"),
        (TABLE, b"\nrow,other_cpu"),
    ],
)
def test_files_of_others_are_left_untouched(
    name: str, data: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task, out = no_looks(tmp_path / "task"), tmp_path / "out"
    out.mkdir()
    (out / name).write_bytes(data)
    assert main(["sweep", str(task), "--set", "seed=1", "-o", str(out)]) == 2
    assert "error[MP701]" in capsys.readouterr().err
    assert (out / name).read_bytes() == data
    assert [path.name for path in out.iterdir()] == [name]


def test_a_sweep_stopped_in_its_first_row_goes_on(tmp_path: Path) -> None:
    task, out = no_looks(tmp_path / "task"), tmp_path / "out"
    first = swept(task, out)
    (out / ROWS).write_bytes((out / ROWS).read_bytes()[:17])
    (out / TABLE).write_bytes(b"")
    assert swept(task, out) == first


def test_a_line_of_odd_types_counts_as_absent(tmp_path: Path) -> None:
    task, out = no_looks(tmp_path / "task"), tmp_path / "out"
    first = swept(task, out)
    good, *_ = lines(out)
    odd = [
        {**good, "key": []},
        {**good, "key": 1},
        {**good, "time_s": "long"},
        {**good, "status": None},
        {**good, "worst_sigma_um": True},
        {**good, "format_version": {}},
        [good],
    ]
    more = [b"[" * 100_000, b'"\xff"']
    text = b"\n".join([json.dumps(each).encode() for each in odd] + more) + b"\n"
    (out / ROWS).write_bytes(text)
    assert RowFile(out / ROWS).rows == {}
    assert swept(task, out) == first


def failing(task: Task, store: Store | None) -> SweepRow:
    """Compile a row, but for one seed."""
    if task.seed == 2:
        raise ZeroDivisionError("no such pose")
    return compile_row(task, store)


class DyingQueue:
    """Loses the workers of the second chunk, and does the others."""

    def __init__(self) -> None:
        self.begun = 0

    def submit(self, chunk: Callable[[], Any], _priority: float = 0.0) -> Future[Any]:
        self.begun += 1
        handle: Future[Any] = Future()
        if self.begun == 2:
            handle.set_exception(WorkerDiedError("compile_row"))
        else:
            handle.set_result(chunk())
        return handle

    def close(self) -> None:
        """Nothing runs on."""


def test_a_row_that_fails_is_told_and_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    task, out = no_looks(tmp_path / "task"), tmp_path / "out"
    with monkeypatch.context() as patched:
        patched.setattr(f"{SWEEPING}.compile_row", failing)
        rows = swept(task, out)
    bad = [row for row in rows if row["status"] == "error"]
    assert [row["seed"] for row in bad] == ["2", "2", "2"]
    assert {row["reason"] for row in bad} == {"ZeroDivisionError: no such pose"}
    assert [row["set"]["seed"] for row in lines(out)] == [1, 1, 1]
    assert swept(task, out) == swept(task, tmp_path / "other")


def test_a_row_that_kills_its_workers_ends_no_sweep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def opened(_jobs: int, _scheduler: str | None) -> Iterator[DyingQueue]:
        yield DyingQueue()

    monkeypatch.setattr(f"{SWEEPING}.opened", opened)
    task, out = no_looks(tmp_path / "task"), tmp_path / "out"
    rows = swept(task, out, jobs=2)
    assert [n for n, row in enumerate(rows) if row["status"] == "error"] == [1]
    assert "WorkerDiedError" in rows[1]["reason"]
    assert len(lines(out)) == 5
