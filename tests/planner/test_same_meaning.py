"""Edits that must not change the meaning of a task, on random tasks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.planner.random_jobs import FORMS, PLAIN, random_job, write_job
from tests.planner.same_meaning import differences, look_at

JOBS = 4  # here; `python -m benchmarks.robustness.same_meaning` takes a few hundred


@pytest.mark.parametrize("edit", FORMS)
def test_an_edit_without_meaning_changes_nothing(edit: str, tmp_path: Path) -> None:
    form = FORMS[edit]
    for number in range(JOBS):
        job = random_job(np.random.default_rng(number))
        one = look_at(write_job(job, PLAIN, tmp_path / f"{number}"), PLAIN)
        other = look_at(write_job(job, form, tmp_path / f"{number}e"), form)
        assert one.numbers, one.words  # the task itself is in order
        assert differences(one, other, form) == []
