"""`microplan compile --watch`: a task compiled again whenever a file of it changes."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from microplan.planner.diff.change_text import headline
from microplan.planner.diff.compare import compare_plans
from microplan.planner.diff.diffing import DiffError, read_plan
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.summary import success
from microplan.planner.store.whole import MOST_BYTES
from microplan.schemas.plan import Plan

POLL_S = 0.25  # between two looks at the files: soon enough for a person, and no load
# An editor that moves a file away and a new one into its place leaves none for a
# moment; a file that is gone for longer is told as missing.
GONE_S = 2.0

Stamp: TypeAlias = tuple[int, int, int, int] | None  # None: there is no such file
Compile: TypeAlias = Callable[[Report], Plan | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Round:
    """One compile: why, and what came of it."""

    number: int  # from 1 on
    changed: tuple[str, ...]  # files, () in the first round
    report: Report
    plan: Plan | None  # None: errors, the plan before stands
    before: Plan | None  # the last good plan
    took_s: float


def watch(
    task: str,
    compiled: Compile,
    before: Plan | None,
    wait: Callable[[float], None] = time.sleep,
) -> Iterator[Round]:
    """Yield a round for the task as it is, and one after each change; never ends.

    A change is one of what a file holds, not of its time. It counts when no file has
    changed any more since the look before, so that what an editor writes in pieces is
    read whole. What changes while a round is being compiled is seen after it.

    Parameters
    ----------
    task : str
        The task file.
    compiled : callable
        Compiles it and writes the plan; adds findings and the files read to a report;
        None if the files are at fault.
    before : Plan or None
        What the first round is compared with.
    wait : callable
        Waits some seconds.
    """
    known: dict[str, str | None] = {str(Path(task)): None}
    changed: tuple[str, ...] = ()
    number = 0
    while True:
        number += 1
        report, started = Report(), time.perf_counter()
        plan = compiled(report)
        yield Round(
            number=number,
            changed=changed,
            report=report,
            plan=plan,
            before=before,
            took_s=time.perf_counter() - started,
        )
        before = plan or before
        if plan is not None:  # else a mistake may have kept it from reading more
            known = {}
        known |= dict.fromkeys(report.sought, None) | report.files
        changed = _next_change(known, wait)
        known |= {path: digest(path) for path in changed}


def round_text(found: Round, folder: Path) -> str:
    """Return a round in one line: its number, what changed, what came of it, how long.

    `folder` is the task's; files in it are named as seen from there.
    """
    why = ", ".join(_short(path, folder) for path in found.changed)
    said = [f"[{found.number}]" + (f" {why}" if why else ""), _outcome(found)]
    return f"{': '.join(said)}; {found.took_s:.1f} s"


def last_plan(folder: Path | None) -> Plan | None:
    """Return the plan that is in a folder already, None if none can be read."""
    try:
        return None if folder is None else read_plan(folder)
    except DiffError:
        return None


def digest(path: str) -> str | None:
    """Return the sha256 of a file, None if there is none that a compile would read."""
    try:
        if not Path(path).is_file():  # a pipe might wait for ever
            return None
        with Path(path).open("rb") as stream:
            data = stream.read(MOST_BYTES + 1)
    except (OSError, ValueError):
        return None
    return None if len(data) > MOST_BYTES else hashlib.sha256(data).hexdigest()


def _next_change(
    known: Mapping[str, str | None], wait: Callable[[float], None]
) -> tuple[str, ...]:
    """Wait until files hold something else than what is known; return them."""
    seen: dict[str, Stamp] = {}  # the first look at them reads them all
    asked: dict[str, Stamp] = {}
    gone_s = 0.0
    while True:
        now = {path: _stamp(path) for path in sorted(known)}
        gone = any(now[path] is None and known[path] is not None for path in now)
        settled = now == seen and not (gone and gone_s < GONE_S)
        if settled and now != asked:
            asked = now
            changed = tuple(path for path in now if digest(path) != known[path])
            if changed:
                return changed
        seen = now
        gone_s = gone_s + POLL_S if gone else 0.0
        wait(POLL_S)


def _stamp(path: str) -> Stamp:
    """Return what tells that a file may hold something else, without reading it."""
    try:
        found = os.stat(path)  # noqa: PTH116 - a name that is no path is no file either
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_ctime_ns, found.st_size, found.st_ino


def _outcome(found: Round) -> str:
    """Return what came of a round, without its time."""
    plan, before = found.plan, found.before
    if plan is None:
        count = sum(d.severity == "error" for d in found.report.in_order)
        errors = f"{count} error" + ("" if count == 1 else "s")
        kept = "" if before is None else ", the last good plan is kept"
        return errors + kept
    chance = f"{plan.status}, P(success) {success(plan)}"
    if before is None:
        return chance
    changes = tuple(compare_plans(before, plan))
    return f"{chance}, {headline(changes)}"


def _short(path: str, folder: Path) -> str:
    """Return a path as seen from a folder, if it is in it."""
    there = Path(path)
    return str(there.relative_to(folder) if there.is_relative_to(folder) else there)
