"""Plans of other versions: older and newer minors run, other majors are refused."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from microplan.executor.cli.main import main as executor
from microplan.planner.cli.main import main as compiler
from microplan.schemas.plan import FORMAT_VERSION, AxisMove, parse_plan
from tests.executor.bench import QUICK, Folder, assembly, world

Data = dict[str, Any]
pytestmark = pytest.mark.usefixtures("one_render_a_state")

MAJOR, MINOR = (int(part) for part in FORMAT_VERSION.split("."))


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the plan folder of the whole job; the gear lies near its place."""
    folder = tmp_path_factory.mktemp("plans") / "gear.plan"
    maker = Folder(folder)
    found = world()
    parts = tuple(
        dataclasses.replace(p, sigma_xy_um=min(p.sigma_xy_um, 8.0)) for p in found.parts
    )
    maker.write(assembly(maker), dataclasses.replace(found, parts=parts))
    return folder


def changed(built: Path, folder: Path, change: Callable[[Data], object]) -> Path:
    """Return a copy of a plan folder, its plan changed."""
    copied = Path(shutil.copytree(built, folder))
    data: Data = json.loads((copied / "plan.json").read_text(encoding="utf-8"))
    change(data)
    (copied / "plan.json").write_text(json.dumps(data), encoding="utf-8")
    return copied


def stated(value: Any) -> Callable[[Data], object]:
    """Return what makes a plan state a version."""
    return lambda data: data.update(format_version=value)


def to_first(data: Data) -> None:
    """Make a plan one of the first minor: what has a default came later."""
    plan = parse_plan(json.dumps(data))
    data.clear()
    data.update(_walked(plan, first=True), format_version=f"{MAJOR}.0")


def to_next(data: Data) -> None:
    """Make a plan one of a newer minor: keys that nobody here knows, everywhere."""
    plan = parse_plan(json.dumps(data))
    data.clear()
    data.update(_walked(plan, first=False), format_version=f"{MAJOR}.{MINOR + 1}")


def _walked(value: Any, *, first: bool) -> Any:
    """Return a plan's data without what has a default, or with unknown keys."""
    if isinstance(value, Mapping):
        return {k: _walked(v, first=first) for k, v in value.items()}
    if isinstance(value, tuple):
        return [_walked(v, first=first) for v in value]
    if not dataclasses.is_dataclass(value):
        return value
    found = {
        f.name: _walked(getattr(value, f.name), first=first)
        for f in dataclasses.fields(value)
        if not first or _was_first(value, f)
    }
    return found if first else {**found, "unheard_of": {"kind": "new", "is": [1, "2"]}}


def _was_first(holder: Any, field: dataclasses.Field[Any]) -> bool:
    """Return whether a key was there from the first: an axis left out stays."""
    if isinstance(holder, AxisMove) or field.name == "kind":
        return True
    return field.default is dataclasses.MISSING


@pytest.mark.parametrize("change", [to_first, to_next], ids=["older", "newer minor"])
def test_another_minor_is_checked_listed_and_compared(
    built: Path,
    tmp_path: Path,
    change: Callable[[Data], None],
    capsys: pytest.CaptureFixture[str],
) -> None:
    other = changed(built, tmp_path / "other.plan", change)
    newer = change is to_next
    for mode in ("check", "dry-run"):
        assert executor([str(other), "--station", "sim", "--mode", mode]) == 0
        heard = capsys.readouterr()
        assert ("what is new in it is passed over" in heard.err) == newer
        assert heard.out
    status = compiler(["diff", str(built), str(other), "--no-images"])
    heard = capsys.readouterr()
    assert ("what is new in it is passed over" in heard.err) == newer
    if newer:
        assert status == 0
        assert heard.out.startswith("the plans mean the same\nP(success) ")
    else:
        assert status == 1  # what is not told there is a difference


@pytest.mark.parametrize("change", [to_first, to_next], ids=["older", "newer minor"])
def test_another_minor_runs_to_its_end(
    built: Path, tmp_path: Path, change: Callable[[Data], None]
) -> None:
    other = changed(built, tmp_path / "other.plan", change)
    words = [
        *QUICK,
        "--seed",
        "3",
        "--no-frames",
        "--run-dir",
    ]
    assert executor([str(other), *words, str(tmp_path / "run")]) == 0


REFUSED = [
    (f"{MAJOR + 1}.0", "update microplan"),
    (f"{MAJOR - 1}.9", "compile the task again"),
    (None, "must be text"),
    ("2", "must be text"),
    (2.3, "must be text"),
    ("2.3.1", "must be text"),
    ("-2.3", "must be text"),
    (f"{MAJOR}.{'9' * 5000}", "must be text"),
    ("\u001b[31m2.3", "must be text"),
]


@pytest.mark.parametrize(("value", "says"), REFUSED)
def test_what_no_reader_takes_is_said_by_each(
    built: Path,
    tmp_path: Path,
    value: Any,
    says: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    other = str(changed(built, tmp_path / "other.plan", stated(value)))
    run = str(tmp_path / "run")
    sim = [*QUICK]
    calls = [
        [*sim, "--run-dir", run], [*sim, "--mode", "check"],
        [*sim, "--mode", "dry-run"],
        [*sim, "--resume", "--run-dir", run], ["--mode", "replay", "--from", run],
        ["--mode", "compare", "--runs", run],
    ]  # fmt: skip
    for words in calls:
        assert executor([other, *words]) == 2
        heard = capsys.readouterr()
        assert heard.out == ""
        assert "error[MP802]: format_version " in heard.err
        assert says in heard.err
        assert "\u001b" not in heard.err
    assert not Path(run).exists()
    for words in ([str(built), other], [other, str(built)]):
        assert compiler(["diff", *words]) == 2
        heard = capsys.readouterr()
        assert heard.out == ""
        assert "error[MP704]" in heard.err
        assert says in heard.err


def test_a_plan_without_a_version_is_refused(built: Path, tmp_path: Path) -> None:
    other = changed(
        built, tmp_path / "other.plan", lambda data: data.pop("format_version")
    )
    assert executor([str(other), "--station", "sim", "--mode", "check"]) == 2
    assert compiler(["diff", str(built), str(other)]) == 2
