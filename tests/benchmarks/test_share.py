"""Shares of a process's time: what is on the stack when the clock says so."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from benchmarks.share import Share

HERE = Path(__file__).parent.name
TIMES = 3


def _work() -> str:
    for _ in range(TIMES):
        signal.raise_signal(signal.SIGPROF)  # as the timer does
    return "done"


@pytest.mark.parametrize(("package", "value"), [(HERE, 1.0), ("optics", 0.0)])
def test_a_package_has_what_it_calls(package: str, value: float) -> None:
    before = signal.getsignal(signal.SIGPROF)
    share = Share(package=package)
    assert share.of(_work) == "done"
    assert share.samples >= TIMES
    assert share.value == value
    assert signal.getsignal(signal.SIGPROF) is before


def test_nothing_sampled_is_no_share() -> None:
    assert Share(package="optics").value == 0.0
