"""Compiles with a cache give what compiles without one give."""

from __future__ import annotations

import contextlib
import io
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

from microplan.optics import ledger
from microplan.planner.assembly.step_states import unfold
from microplan.planner.cli.main import main
from microplan.planner.looks.scenario import build_case
from microplan.planner.report import margins
from microplan.planner.report.report import write_report
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.memo import Memo, digest
from microplan.planner.store.store import Store, place
from microplan.planner.task import read_task
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task
from microplan.planner.views.requests import requests
from microplan.planner.views.target_views import views
from tests.planner.examples import (
    FEW,
    GRASP,
    between_jaws,
    change,
    copy_example,
    cut,
    one_look,
    read,
)

Compile = Callable[..., dict[str, bytes]]
NOT_COMPARED = {"timings.json"}  # measured times


@pytest.fixture(autouse=True, scope="module")
def _fewer_trials() -> Iterator[None]:
    """Spend less on a look than any preset does."""
    few = dict.fromkeys(("fast", "balanced"), FEW)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("microplan.planner.plan.compiler.PRESETS", few)
        yield


def written(folder: Path, *words: str) -> dict[str, bytes]:
    """Return the files of the plan that the task in a folder compiles to."""
    out = folder / "new"
    with contextlib.chdir(folder):  # the plan names its inputs as they are called
        call = ["compile", "task/task.yaml", "-o", str(out), "--preset", "fast"]
        assert main([*call, *words]) == 0
    return {
        p.relative_to(out).as_posix(): p.read_bytes()
        for p in sorted(out.rglob("*"))
        if p.is_file() and p.name not in NOT_COMPARED
    }


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return the files of the plan that no cache has touched."""
    folder = tmp_path_factory.mktemp("plain")
    one_look(copy_example(folder / "task"))
    return written(folder, "--no-cache")


@dataclass(frozen=True, slots=True, kw_only=True)
class Filled:
    """A cache after its first compile, and what that compile gave."""

    cache: Path
    files: dict[str, bytes]
    said: tuple[str, str]  # on stdout and stderr
    kept: int  # results


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Filled:
    """Return a cache that the task filled; tests use copies of it."""
    folder = tmp_path_factory.mktemp("filled")
    one_look(copy_example(folder / "task"))
    printed, warned = io.StringIO(), io.StringIO()
    with (
        noted_results() as names,
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(warned),
    ):
        files = written(folder, "--cache", str(folder / "cache"))
    out, err = (each.getvalue().replace(str(folder), "") for each in (printed, warned))
    return Filled(cache=folder / "cache", files=files, said=(out, err), kept=len(names))


@contextlib.contextmanager
def noted_results() -> Iterator[list[str]]:
    """Yield a list that takes the keys of results that were not there yet."""
    names: list[str] = []
    put = Store.put

    def noted(self: Store, key: str, result: bytes) -> None:
        names.append(key)
        put(self, key, result)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Store, "put", noted)
        yield names


@pytest.fixture
def task(tmp_path: Path) -> Path:
    file = copy_example(tmp_path / "task")
    one_look(file)
    return file


@pytest.fixture
def files(task: Path, tmp_path: Path) -> Compile:
    """Return what compiles the task, and gives the plan folder's files."""
    return partial(written, tmp_path)


@pytest.fixture
def cache(filled: Filled, tmp_path: Path) -> tuple[str, str]:
    """Return the words that name a copy of the filled cache."""
    return "--cache", str(shutil.copytree(filled.cache, tmp_path / "cache"))


@pytest.fixture
def made() -> Iterator[list[str]]:
    """Return the keys of the results that were not there yet."""
    with noted_results() as names:
        yield names


def test_a_cache_changes_nothing_but_the_time(
    files: Compile,
    plain: dict[str, bytes],
    filled: Filled,
    cache: tuple[str, str],
    made: list[str],
    tmp_path: Path,
    task: Path,
) -> None:
    assert filled.files == plain
    assert filled.kept > 3
    told = files(*cache, "--report")  # all of it kept
    assert made == []
    again = write_report(tmp_path / "new", tmp_path / "again.html")
    assert told.pop("report.html") == again.read_bytes()
    assert told == plain
    change(task, "seed: 1998", "seed: 1999")
    fresh = files(*cache)
    kept = len(made)
    assert kept > 0
    assert fresh == files("--no-cache") != plain
    assert len(made) == kept


def test_an_unchanged_task_is_not_even_read(
    files: Compile,
    filled: Filled,
    cache: tuple[str, str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    task: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    reads: list[str] = []

    def noted(path: str, report: Report) -> Task | None:
        reads.append(path)
        return load_task(path, report)

    monkeypatch.setattr(read_task, "load_task", noted)
    assert files(*cache) == filled.files
    said = (text.replace(str(tmp_path), "") for text in capsys.readouterr())
    assert tuple(said) == filled.said  # its findings are told again
    assert reads == []
    drawing = task.parent / "parts" / "shaft_plate.dxf"
    drawing.write_bytes(drawing.read_bytes() + b"\n")
    files(*cache)
    assert len(reads) == 1
    files(*cache, "--preset", "balanced", "--max-image-error", "0.5")
    assert len(reads) == 2
    drawing.unlink()
    assert main(["compile", str(task), *cache]) == 2
    assert len(reads) == 3


def test_a_spoilt_cache_is_computed_anew(
    files: Compile, filled: Filled, cache: tuple[str, str], made: list[str]
) -> None:
    for kept in Path(cache[1]).rglob("*.result"):
        data = bytearray(kept.read_bytes())
        data[len(data) // 2] ^= 1
        kept.write_bytes(data)
    assert files(*cache) == filled.files
    assert len(made) == filled.kept


def test_a_cache_that_cannot_be_written_stops_nothing(
    files: Compile, made: list[str], tmp_path: Path, task: Path
) -> None:
    between_jaws(task)
    cut(task, GRASP, "{id: release, do: release, target: gear, opening_um: 130}")
    blocked = tmp_path / "blocked"
    blocked.write_bytes(b"")
    assert files("--cache", str(blocked)) == files("--no-cache")
    assert made  # it was to keep something


def test_the_place_is_the_users_cache(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "mine"))
    assert place() == tmp_path / "mine" / "microplan"
    monkeypatch.setenv("XDG_CACHE_HOME", "not/absolute")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert place() == tmp_path / ".cache" / "microplan"
    assert Memo().store is None


def test_a_changed_step_asks_anew_for_its_own_look_alone(tmp_path: Path) -> None:
    file, memo = copy_example(tmp_path / "task"), Memo(Store(tmp_path / "cache"))
    steps = ("find_gear", "see_fingers")

    def keys() -> dict[str, str]:
        task, report = read(file), Report()
        states, found = unfold(task, report), {}
        low, _ = task.workcell.optics.magnification
        for index, state in enumerate(states):
            if state.step.id in steps:
                (request,) = requests(task, states, index, None)
                (view, *_) = views(task, request, low, report)
                case, _ = build_case(task, request, view, 0.01, memo)
                found[state.step.id] = digest(case)
        return found

    first = keys()
    change(file, "{robot: {x_um: 0, y_um: 0}}", "{robot: {x_um: 1, y_um: 0}}")
    second = keys()
    assert {step for step in steps if first[step] != second[step]} == {"see_fingers"}


def test_an_unchanged_task_loads_nothing_that_computes() -> None:
    script = (
        "import sys, microplan.planner.cli.main, microplan.planner.cli.compiling\n"
        "import microplan.planner.plan.cached_compile\n"
        "import microplan.planner.store.store, microplan.planner.plan.options\n"
        "import microplan.planner.store.folder\n"
        "heavy = ('scipy', 'skimage', 'shapely', 'ezdxf', 'yaml', 'jsonschema',\n"
        "         'cv2', 'microplan.schemas.plan', 'microplan.planner.diff.diffing')\n"
        "sys.exit(', '.join(name for name in heavy if name in sys.modules))"
    )
    call = [sys.executable, "-c", script]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


def test_the_report_knows_the_ledgers_unit() -> None:
    assert margins.CONTRAST == ledger.CONTRAST
