"""Edits that must not change the meaning, on a few hundred random tasks.

Every task is written plainly and in each other form, and what the planner makes of both
before any image is compared; of a few tasks the whole plan is, where an edit may change
no number at all. `tests.planner.same_meaning` says what is required and why.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from tests.planner.random_jobs import FORMS, PLAIN, Form, Job, random_job, write_job
from tests.planner.same_meaning import differences, look_at

JOBS = 300
COMPILED = 2  # tasks of which whole plans are compared
NAMES = (
    "inputs.same_meaning.different",
    "inputs.same_meaning.compared",
    "plans.same_meaning.different",
    "plans.same_meaning.compared",
)
# edits after which a plan's bytes must be the same
_EXACT = ("mm", "circles as two arcs", "another first vertex", "reversed", "in a block")


def job_of(number: int) -> Job:
    """Return one random task."""
    return random_job(np.random.default_rng(number))


def changed(number: int) -> list[str]:
    """Return the edits that change what is made of a task, with what they change."""
    job, found = job_of(number), []
    with TemporaryDirectory() as name:
        one = look_at(write_job(job, PLAIN, Path(name) / "plain"), PLAIN)
        for edit, form in FORMS.items():
            other = look_at(write_job(job, form, Path(name) / edit), form)
            found += [f"{edit}: {what}" for what in differences(one, other, form)[:1]]
    return found


def plan(job: Job, form: Form, folder: Path) -> Mapping[str, Any]:
    """Return the compiled plan of a task, without how its folder is called.

    Raises
    ------
    RuntimeError
        If there is none.
    """
    task = write_job(job, form, folder)
    out = folder / "job.plan"
    call = ["compile", str(task), "-o", str(out), "--preset", "fast"]
    done = subprocess.run(
        [sys.executable, "-m", "microplan.planner.cli.main", *call],
        cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{call} ended with {done.returncode}:\n{done.stderr}")
    found: Mapping[str, Any] = json.loads((out / "plan.json").read_text("utf-8"))
    return found


def plans_changed(number: int) -> list[str]:
    """Return the edits that change a task's whole plan."""
    job = job_of(number)
    with TemporaryDirectory() as name:
        one = plan(job, PLAIN, Path(name) / "plain")
        return [
            edit
            for edit in _EXACT
            if plan(job, FORMS[edit], Path(name) / edit) != one
        ]  # fmt: skip


def _measure(_options: Options) -> Iterator[Figure]:
    wrong = [(k, what) for k in range(JOBS) for what in changed(k)]
    for number, what in wrong:
        print(f"task {number}: {what}", file=sys.stderr)
    yield Figure(name=NAMES[0], value=len(wrong), unit="pairs")
    yield Figure(name=NAMES[1], value=JOBS * len(FORMS), unit="pairs")
    plans = [(k, edit) for k in range(COMPILED) for edit in plans_changed(k)]
    for number, edit in plans:
        print(f"plan {number}: {edit}", file=sys.stderr)
    yield Figure(name=NAMES[2], value=len(plans), unit="pairs")
    yield Figure(name=NAMES[3], value=COMPILED * len(_EXACT), unit="pairs")


BENCHMARK = Benchmark(names=NAMES, measure=_measure)
