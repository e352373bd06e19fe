"""Offline compiler for vision-guided microassembly, and the runtime of its plans.

`load_task` reads a task file, `compile_task` makes its plan, `parse_plan` and
`dump_plan` read and write plan.json. Names are loaded when they are first used.
"""

from __future__ import annotations

import os

TYPE_CHECKING = False  # as in typing, which takes 6 ms to load
if TYPE_CHECKING:
    from microplan.planner.plan.compiler import compile_task
    from microplan.planner.plan.options import Options
    from microplan.planner.source.diagnostics import Diagnostic, Report
    from microplan.planner.task.read_task import load_task
    from microplan.planner.task.task import Task
    from microplan.schemas.plan import Plan, dump_plan, parse_plan

__all__ = [
    "Diagnostic", "Options", "Plan", "Report", "Task",
    "compile_task", "dump_plan", "load_task", "parse_plan",
]  # fmt: skip

_HOMES = {
    "Diagnostic": "planner.source.diagnostics",
    "Options": "planner.plan.options",
    "Plan": "schemas.plan",
    "Report": "planner.source.diagnostics",
    "Task": "planner.task.task",
    "compile_task": "planner.plan.compiler",
    "dump_plan": "schemas.plan",
    "load_task": "planner.task.read_task",
    "parse_plan": "schemas.plan",
}

# The folders of a checkout lie beside this one. Links lead to them; where links are
# missing (a source distribution) or mere text (Windows), this finds them.
_HERE = os.path.dirname(__file__)  # noqa: PTH120 - pathlib takes 8 ms to load
if not os.path.isdir(f"{_HERE}/planner"):  # noqa: PTH112 - as above
    __path__.append(os.path.dirname(_HERE))  # noqa: PTH120 - as above


def __getattr__(name: str) -> object:
    """Return a public name from the module that defines it."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
