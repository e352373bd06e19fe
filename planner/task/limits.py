"""Readings and openings in a task against what the workcell's axes and tools allow."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from microplan.planner.source.diagnostics import Report
from microplan.planner.source.schema import Checked
from microplan.planner.source.source import Key

_AXES = ("x_um", "y_um", "z_um", "theta_deg")


def check_limits(task: Checked, cell: Checked | None, report: Report) -> None:
    """Report axis readings and jaw openings that cannot be reached."""
    if cell is None:
        return
    for where, axes in _readings(task):
        limits = ("axes", axes, "limits")
        for key in _AXES:
            if task.good(*where, key) and cell.good(*limits, key):
                name = f"{axes} {key}"
                _check(task, (*where, key), cell, (*limits, key), name, report)
    for where, tool in _openings(task):
        allowed = ("tools", tool, "opening_um")
        if task.good(*where) and cell.good(*allowed):
            _check(task, where, cell, allowed, f"{tool} opening_um", report)


def _check(
    task: Checked, where: tuple[Key, ...], cell: Checked, limits: tuple[Key, ...],
    name: str, report: Report,
) -> None:  # fmt: skip
    """Report the value at `where` if it is outside the interval at `limits`."""
    value = task.source.get(*where)
    low, high = cell.source.get(*limits)
    if low <= high and not low <= value <= high:
        span = cell.source.value(*limits)
        message = f"{name} {value} is outside the workcell's {low} to {high}"
        hint = f"the limits stand in {span.file}:{span.line}"
        report.error("MP118", task.source.value(*where), message, hint)


def _readings(task: Checked) -> Iterator[tuple[tuple[Key, ...], str]]:
    """Yield where axis readings stand, and of which axes."""
    yield ("start", "stage"), "stage"
    for name in task.source.mapping("start"):
        if task.source.get("start", name, "on") == "robot":
            yield ("start", name), "robot"
    for index, _ in _steps(task):
        for number, move in enumerate(task.source.items("steps", index, "move")):
            for axes in move if isinstance(move, dict) else ():
                if axes in ("stage", "robot"):
                    yield ("steps", index, "move", number, axes), axes


def _openings(task: Checked) -> Iterator[tuple[tuple[Key, ...], str]]:
    """Yield where jaw openings stand, and of which tool."""
    tools = []
    for name in task.source.mapping("start"):
        if task.source.get("start", name, "on") == "robot":
            tools.append(name)
            yield ("start", name, "opening_um"), name
    for index, step in _steps(task):
        tool = step.get("with")
        if step.get("do") == "release" and len(tools) == 1:
            tool = tools[0]  # the only one that can hold anything
        if isinstance(tool, str):
            yield ("steps", index, "opening_um"), tool


def _steps(task: Checked) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the steps that are mappings."""
    for index, step in enumerate(task.source.items("steps")):
        if isinstance(step, dict):
            yield index, step
