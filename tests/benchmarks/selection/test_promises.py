"""A sample of the random selection problems, and how they are judged."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.selection import promises as selection
from benchmarks.selection.problems import draw
from benchmarks.selection.promises import judge


def test_the_problems_differ_in_what_is_hard_about_them() -> None:
    cases = [draw(index).case for index in range(selection.PROBLEMS)]
    kinds = [case.target.kind for case in cases]
    assert 40 < kinds.count("circle") < 160
    assert 60 < sum(bool(case.static) for case in cases) < 140
    assert sum(case.tolerance_theta_rad is not None for case in cases) > 20
    tolerances = np.array([case.tolerance_um for case in cases])
    assert tolerances.min() < 0.02
    assert tolerances.max() > 0.8
    focus = np.array([case.spread.focus_sigma_um for case in cases])
    assert focus.min() < 0.1
    assert focus.max() > 3
    assert draw(3) == draw(3)


def test_a_problem_is_judged_on_fresh_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(selection, "TRIALS", 24)
    monkeypatch.setattr(selection, "FRESH", 40)
    found = judge(2)
    assert found.decided
    assert found.broken == ()
    for squares, halves in found.claims:
        assert 0 < len(squares) == len(halves) <= 40
        # 40 squares of normals have a mean of 1 +- .22, and 24 trials are as unsure
        assert 0.2 < (squares**2).mean() < 2.6
    assert found.need is not None
    assert found.need > 1
