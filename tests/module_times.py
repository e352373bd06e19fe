"""CPU and waiting time of test modules, and the order that fills all workers.

`pytest --module-times` prints the ten slowest modules. With `--dist loadscope` a module
stays on one worker, so that a fixture of a module is made once; the slowest modules go
first, so that no worker is left with one of them at the end.
"""

from __future__ import annotations

import os
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

SHOWN = 10
# modules of some six seconds and more, waiting included, slowest first:
# `--module-times` has them
SLOWEST = (
    "tests/browser/test_pages.py",
    "tests/planner/source/test_diagnostic_pages.py",
    "tests/executor/record/test_run_folder.py",
    "tests/executor/test_diagnostic_pages.py",
    "tests/executor/serial/test_serial.py",
    "tests/planner/plan/test_cached_compile.py",
    "tests/executor/whole_runs/test_fault_matrix.py",
    "tests/project/test_walks.py",
    "tests/optics/layers/solids/test_solid_images.py",
    "tests/planner/calibration/through_focus/test_focus_series.py",
    "tests/project/test_wheel.py",
    "tests/executor/micromanager/test_micromanager_run.py",
    "tests/executor/whole_runs/test_closed_loop.py",
    "tests/planner/looks/test_coarse_to_fine.py",
    "tests/executor/cli/test_replay.py",
    "tests/planner/plan/test_compile.py",
    "tests/executor/cli/test_main.py",
    "tests/executor/whole_runs/test_stated_lens.py",
    "tests/featuresel/routines/likelihood/test_side_of_focus.py",
    "tests/featuresel/routines/likelihood/test_foreground_model.py",
    "tests/featuresel/routines/likelihood/test_occluder_modes.py",
    "tests/planner/tradeoff/test_task_tradeoff.py",
    "tests/executor/micromanager/test_micromanager.py",
    "tests/planner/looks/test_compile_look.py",
    "tests/planner/measure/test_marks.py",
)

_spent: dict[str, list[float]] = {}  # module -> CPU s, wall s


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --module-times."""
    what = f"CPU and waiting time of the {SHOWN} slowest test modules"
    parser.addoption("--module-times", action="store_true", help=what)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the slowest modules first; the order within a module stays."""
    rank = {name: place for place, name in enumerate(SLOWEST)}
    items.sort(key=lambda item: rank.get(item.nodeid.partition("::")[0], len(rank)))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, None, None]:
    """Add up what a test takes, with its fixtures and the processes it starts."""
    cpu_s, wall_s = sum(os.times()[:4]), time.perf_counter()
    yield
    spent = _spent.setdefault(item.nodeid.partition("::")[0], [0.0, 0.0])
    spent[0] += sum(os.times()[:4]) - cpu_s
    spent[1] += time.perf_counter() - wall_s


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Hand a worker's times to the controller."""
    output = getattr(session.config, "workeroutput", None)
    if output is not None:
        output["module_times"] = _spent


class Collecting:
    """Gathers the times of all workers."""

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Add the times of a worker that has ended; one that died tells none."""
        told = getattr(node, "workeroutput", {}).get("module_times", {})
        for name, (cpu_s, wall_s) in told.items():
            spent = _spent.setdefault(name, [0.0, 0.0])
            spent[0] += cpu_s
            spent[1] += wall_s


def pytest_configure(config: pytest.Config) -> None:
    """Listen to workers."""
    config.pluginmanager.register(Collecting())


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Print the slowest modules, if they are asked for."""
    if not config.getoption("--module-times"):
        return
    cpu_s, wall_s = (sum(spent[k] for spent in _spent.values()) for k in (0, 1))
    write = terminalreporter.write_line
    write(
        f"CPU {cpu_s:.0f} s, waiting {max(wall_s - cpu_s, 0):.0f} s; slowest modules:"
    )
    slowest = sorted(_spent.items(), key=lambda item: -item[1][1])
    for name, (cpu_s, wall_s) in slowest[:SHOWN]:
        waited_s = max(wall_s - cpu_s, 0.0)
        write(
            f"  {cpu_s:5.1f} s CPU {waited_s:5.1f} s waiting  {Path(name).as_posix()}"
        )
