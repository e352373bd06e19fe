"""What is known of a sweep before a row is made: values and files that cannot be."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

from microplan.planner.source.changed_values import NO_SWEEP
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.folder import not_written
from microplan.planner.sweep.rows import foreign
from microplan.planner.sweep.table import is_table
from microplan.planner.sweep.variants import Setting, Variant, changes
from microplan.planner.task.read_task import load_task

_MOST_HEAD = 1 << 20  # characters of a table's first line


def check_values(file: str, asked: Sequence[Setting], report: Report) -> str:
    """Return the task's name; each value is reported that the task refuses."""
    task = load_task(file, report)
    if task is None:
        return ""
    after = math.prod(len(setting.values) for setting in asked)  # rows of one value
    for setting in asked:
        after //= len(setting.values)
        first: dict[str, int] = {}  # of several that are alike
        for number, value in enumerate(setting.values):
            first.setdefault(json.dumps(value), number)
        for number in first.values():
            values = {setting.key: setting.values[number]}
            alone = Variant(row=1 + number * after, values=values)
            _check_value(file, alone, report)
    _check_apart(file, asked, report)
    return task.name


def _check_apart(file: str, asked: Sequence[Setting], report: Report) -> None:
    """Report keys that set the same value; nothing else is wrong with all rows."""
    found = Report()
    first = {setting.key: setting.values[0] for setting in asked}
    load_task(file, found, changes(Variant(row=1, values=first)))
    report.files.update(found.files)
    report.found += [each for each in found.in_order if each.code == NO_SWEEP]


def check_table(file: Path) -> None:
    """Raise OutputError, MP701, if another program's table would be replaced."""
    try:
        with file.open(encoding="utf-8", errors="replace") as stream:
            ours = is_table(stream.readline(_MOST_HEAD))
    except FileNotFoundError:
        return
    except OSError as error:
        raise not_written(file, error) from error
    if not ours:
        raise foreign(file)


def _check_value(task: str, alone: Variant, report: Report) -> None:
    """Report what reading the task finds with one value changed."""
    found = Report()
    load_task(task, found, changes(alone))
    report.files.update(found.files)
    for each in found.in_order:
        if each.severity == "error":
            message = f"row {alone.row}, {alone.said}: {each.message}"
            report.error(each.code, each.where, message, each.hint)
