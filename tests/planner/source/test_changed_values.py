"""Values replaced: the task is the one that a file with those values holds."""

from __future__ import annotations

from pathlib import Path

import pytest

from microplan.planner.source.changed_values import ChangedValue, changed
from microplan.planner.source.diagnostics import Report
from microplan.planner.source.source import parse
from microplan.planner.task.read_task import load_task
from tests.planner.examples import EXAMPLE, change, copy_example

# file, its text, the text that is written instead, the key, the value
CELL = "workcell.yaml"
EDITS = [
    ("task.yaml", "seed: 1998", "seed: 7", "seed", 7),
    ("task.yaml", "within_um: 2.9", "within_um: 3", "steps.check_seated.within_um", 3),
    ("task.yaml", "within_um: 2.9", "within_um: 3", "steps.12.within_um", 3),
    ("task.yaml", "humidity: 0.4", "humidity: 0.9", "environment.humidity", 0.9),
    (CELL, "max: 44.5}", "max: 20}", "workcell.optics.magnification.max", 20),
    (CELL, "optics:", "optics:\n  wavefront_rms: 0.1", "workcell.optics.wavefront_rms",
     0.1),
]  # fmt: skip


@pytest.mark.parametrize("edit", EDITS, ids=lambda edit: edit[3])
def test_a_changed_value_is_one_written_in_the_file(
    edit: tuple[str, str, str, str, object], tmp_path: Path
) -> None:
    file, old, new, key, value = edit
    task = copy_example(tmp_path / "task")
    change(task.with_name(file), old, new)
    report = Report()
    written = load_task(task, report)
    one = ChangedValue(key=tuple(key.split(".")), value=value)
    found = load_task(EXAMPLE / "task.yaml", report, [one])
    assert written is not None
    assert found is not None
    assert found.normalised == written.normalised
    assert found.workcell.normalised == written.workcell.normalised


@pytest.mark.parametrize(
    ("key", "said", "hint"),
    [
        ("steps.insertt.speed_um_per_s", "no entry 'insertt'; allowed: find_gear,",
         "did you mean 'insert'?"),
        ("steps.13.id", "no entry '13'", ""),
        ("steps.-1.id", "no entry '-1'", ""),
        ("workcell.optics.wavelength", "unknown key 'wavelength'", ""),
        ("sede", "unknown key 'sede'", "did you mean 'seed'?"),
        ("seed.deep", "seed must be a whole number", ""),
    ],
)  # fmt: skip
def test_a_key_that_leads_nowhere_is_found(key: str, said: str, hint: str) -> None:
    one, report = ChangedValue(key=tuple(key.split(".")), value=1), Report()
    assert load_task(EXAMPLE / "task.yaml", report, [one]) is None
    (found,) = report.in_order
    assert said in found.message
    assert hint in found.hint
    assert found.where.line > 0


def test_the_source_itself_stays() -> None:
    report = Report()
    source = parse("a: {b: [1, {id: x, c: 2}]}", Path(), "f", report)
    assert source is not None
    one = ChangedValue(key=("a", "b", "x", "c"), value=9)
    assert changed(source, [one], report).data == {"a": {"b": [1, {"id": "x", "c": 9}]}}
    assert source.data == {"a": {"b": [1, {"id": "x", "c": 2}]}}
    assert not report.found
