"""Every diagnostic has a page, and the page's example leads to its code."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from skimage.io import imsave

from microplan.planner.assembly.step_states import StepState, unfold
from microplan.planner.budget.control import tolerance_um
from microplan.planner.budget.methods import method_of
from microplan.planner.budget.step_budget import report_handling, verdicts_of
from microplan.planner.cli.main import main
from microplan.planner.source.changed_values import NO_SWEEP
from microplan.planner.source.diagnostics import TITLES, Report
from microplan.planner.store.memo import Memo
from microplan.planner.store.store import Store, place
from microplan.planner.task.presets import PRESETS
from microplan.planner.task.read_task import load_task
from microplan.planner.task.second_reader import read_twice
from microplan.planner.task.task import Task
from tests.planner.examples import (
    EXAMPLE,
    FEW,
    GRASP,
    ROOT,
    between_jaws,
    beyond_notes,
    change,
    cut,
    one_look,
    one_zoom,
)
from tests.planner.placed import memory, placed

PAGES = ROOT / "docs" / "diagnostics"

_CALL = re.compile(r"^```console\nmicroplan (.*?)\n```$", re.MULTILINE)
_BLOCK = re.compile(r"^```(diff|write) (\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def _load(folder: Path) -> Report:
    report = Report()
    load_task(folder / "task.yaml", report)
    return report


def _second(folder: Path) -> Report:
    """Return what ezdxf finds otherwise in the drawings, as `compile` does first."""
    report = Report()
    task = load_task(folder / "task.yaml", report)
    assert task is not None
    read_twice(task, report, Memo(Store(place())))  # most drawings are as before
    return report


def _unfolded(folder: Path) -> tuple[Task, tuple[StepState, ...], Report]:
    """Return the task of a folder, its states, and what was found on the way."""
    report = Report()
    task = load_task(folder / "task.yaml", report)
    assert task is not None
    return task, unfold(task, report), report


def _unfold(folder: Path) -> Report:
    return _unfolded(folder)[-1]


def _methods(folder: Path) -> Report:
    """Return what the compiler finds of the ways to align, without looks."""
    task, states, report = _unfolded(folder)
    for state in states:
        if state.step.verb == "align":
            within = tolerance_um(task, states, state, None)
            method_of(task, states, state, within, {}, report)
    return report


def _handling(folder: Path) -> Report:
    """Return what the compiler finds of grasps and releases, without looks."""
    task, states, report = _unfolded(folder)
    for state in states:
        _, grasp, release = verdicts_of(task, states, state)
        report_handling(state, grasp, release, report)
    return report


def _placing(folder: Path) -> Report:
    """Return what the compiler finds of the laser die's release, by given looks."""
    task, states, report = _unfolded(folder)
    here = next(state for state in states if state.step.verb == "release")
    found = placed(task, memory())
    assert found is not None
    report_handling(here, None, None, report, found[1])
    return report


# first characters of a code -> what finds it in the example's folder
RUNNERS: dict[str, Callable[[Path], Report]] = {
    "MP0": _load,
    "MP1": _load,
    "MP2": _load,
    "MP226": _second,
    "MP227": _second,
    "MP3": _unfold,
    "MP612": _methods,  # so would this one's
    "MP613": _handling,
    "MP614": _handling,
    "MP615": _placing,
}
CODES = sorted(page.stem for page in PAGES.glob("MP[0-79]*.md"))
# of plans, not of a task: see test_diff.py and exporting/test_export.py
TOLD_ELSEWHERE = {"MP710", "MP720", "MP721", "MP722"}
EXPENSIVE = {"MP615"}  # works out a whole placement
CALLED = [
    code
    for code in CODES
    if code not in RUNNERS and _CALL.search((PAGES / f"{code}.md").read_text("utf-8"))
]


def _see_post(folder: Path) -> None:
    """Cut the example down to one look."""
    one_look(folder / "task.yaml")
    one_zoom(folder / "task.yaml")


def _see_post_well(folder: Path) -> None:
    """Do so, with images as good as the example asks for."""
    _see_post(folder)
    change(folder / "task.yaml", "max_image_error: 0.06", "max_image_error: 0.002")


def _grasp_and_release(folder: Path) -> None:
    """Cut the example down to two steps without a look."""
    between_jaws(folder / "task.yaml")
    release = "{id: release, do: release, target: gear, opening_um: 130}"
    cut(folder / "task.yaml", GRASP, release)


def _two_frames(folder: Path) -> None:
    """Write two pictures of a still scene."""
    (folder / "frames").mkdir()
    rng = np.random.default_rng(2)
    for name in ("a.png", "b.png"):
        counts = rng.integers(90, 110, (48, 64)).astype(np.uint8)
        imsave(str(folder / "frames" / name), counts, check_contrast=False)


def _readings(folder: Path) -> None:
    """Put the page's table of readings among the drawings."""
    (folder / "parts" / "readings.csv").write_text("file,depth\n", encoding="utf-8")


# what a page says the example is cut down to, so that its call takes seconds
PREPARED: Mapping[str, Callable[[Path], None]] = {
    "MP501": _see_post,
    "MP503": _see_post_well,
    "MP504": _see_post_well,
    "MP602": _grasp_and_release,
    "MP616": _see_post,
    "MP904": _two_frames,
    "MP905": _readings,
}


# what calls say of an example before it is spoilt, by call, example and preparation:
# exit status and lines
_BEFORE: dict[
    tuple[str, Path, Callable[[Path], None] | None], tuple[int, list[str]]
] = {}


def runner(code: str) -> Callable[[Path], Report]:
    """Return what finds a code in the example's folder."""
    return RUNNERS.get(code) or RUNNERS[code[:3]]


@cache
def messages_before(run: Callable[[Path], Report], source: Path) -> frozenset[str]:
    """Return what is found in an example as it is: notes, without its folder."""
    before = run(source)
    assert beyond_notes(before) == []
    return frozenset(f.message.replace(str(source), "") for f in before.found)


def apply_page(page: str, folder: Path) -> None:
    """Change the example in `folder` as the blocks of a page say."""
    blocks = _BLOCK.findall(page)
    assert blocks, "the page has no example"
    for kind, name, body in blocks:
        file = folder / name
        if kind == "write":
            file.write_bytes(_raw(body))
            continue
        lines = body.splitlines()
        old = "\n".join(line[1:] for line in lines if line.startswith("-"))
        new = "\n".join(line[1:] for line in lines if line.startswith("+"))
        before = file.read_bytes()
        assert old, "a diff block takes something away"
        assert _raw(old) in before, f"{name} does not hold {old!r}"
        file.write_bytes(before.replace(_raw(old), _raw(new), 1))


def _raw(text: str) -> bytes:
    """Return `text` as UTF-8, with \\xNN as one byte."""
    return re.sub(
        rb"\\x([0-9a-f]{2})",
        lambda match: bytes.fromhex(match[1].decode()),
        text.encode(),
    )


@pytest.fixture
def example(tmp_path: Path, code: str) -> Path:
    """Return a copy of the page's example that may be spoilt."""
    page = (PAGES / f"{code}.md").read_text(encoding="utf-8")
    return Path(shutil.copytree(_source(page), tmp_path / "example"))


def _source(page: str) -> Path:
    """Return the example that a page changes."""
    laser = "In the laser-die example:" in page
    return EXAMPLE.with_name("laser_die") if laser else EXAMPLE


@pytest.mark.parametrize(
    "code",
    [
        pytest.param(code, marks=[pytest.mark.slow] if code in EXPENSIVE else [])
        for code in sorted({*CODES} - {*CALLED} - TOLD_ELSEWHERE)
    ],
)
def test_the_example_of_a_page_leads_to_its_code(code: str, example: Path) -> None:
    run, page = runner(code), (PAGES / f"{code}.md").read_text(encoding="utf-8")
    known = messages_before(run, _source(page))
    apply_page(page, example)
    there = str(example)
    found = [
        f for f in run(example).in_order if f.message.replace(there, "") not in known
    ]
    assert code in {finding.code for finding in found}
    assert all(finding.where.line for finding in found if finding.code != "MP011")


@pytest.mark.parametrize("code", CALLED)
def test_the_call_of_a_page_leads_to_its_code(
    code: str,
    example: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    page = (PAGES / f"{code}.md").read_text(encoding="utf-8")
    (call,) = _CALL.findall(page)
    if code in PREPARED:
        PREPARED[code](example)
    monkeypatch.setattr(
        "microplan.planner.plan.compiler.PRESETS", {**PRESETS, "fast": FEW}
    )
    monkeypatch.chdir(example)

    def headlines() -> tuple[int, list[str]]:
        """Return the call's exit status and the lines that it warns by."""
        status = main(shlex.split(call))
        said = capsys.readouterr().err.replace(str(example), "EXAMPLE")
        return status, said.splitlines()

    before: list[str] = []
    if _BLOCK.search(page):  # else the call itself is the mistake
        untouched = (call, _source(page), PREPARED.get(code))
        if untouched not in _BEFORE:
            _BEFORE[untouched] = headlines()
        status, before = _BEFORE[untouched]
        assert status == 0
        apply_page(page, example)
    status, lines = headlines()
    after = {line for line in lines if f"[{code}]" in line}
    after -= {*before}
    assert after
    severities = {line.partition("[")[0] for line in after}
    worst = {"error": 2, "infeasible": 1}
    assert status == max(worst.get(severity, 0) for severity in severities)


@pytest.mark.parametrize("code", CODES)
def test_a_page_is_headed_by_its_code_and_title(code: str) -> None:
    page = (PAGES / f"{code}.md").read_text(encoding="utf-8")
    assert page.startswith(f"# {code}: {TITLES[code]}\n\n")
    assert "## How to mend it" in page


def test_every_code_of_the_readers_has_a_title_and_a_page() -> None:
    used = set()
    for folder in ("source", "drawings", "task"):
        for module in (ROOT / "planner" / folder).rglob("*.py"):
            if module.name != "diagnostics.py":
                text = module.read_text(encoding="utf-8")
                used |= set(re.findall(r'"(MP\d{3})"', text))
    readers = ("MP0", "MP1", "MP2")
    used -= {NO_SWEEP}
    assert used == {code for code in TITLES if code.startswith(readers)}
    assert used == {code for code in CODES if code.startswith(readers)}


def test_every_code_of_the_compiler_has_a_title_and_a_page() -> None:
    used = set()
    for module in (ROOT / "planner").rglob("*.py"):
        if module.name != "diagnostics.py":
            text = module.read_text(encoding="utf-8")
            used |= set(re.findall(r'"(MP[0-79]\d\d)"', text))
    assert used == set(TITLES) == set(CODES)
    assert list(TITLES) == sorted(TITLES)
