"""Shares of a process's time: what is on the stack when the clock says so."""

from __future__ import annotations

import signal
from collections.abc import Callable, Sequence
from itertools import chain, repeat

import numpy as np
import numpy.typing as npt
import pytest

from benchmarks.share import Share
from microplan import optics
from microplan.optics.transfer.node_refinement import refined


def _shared(work: Callable[[], None], clock_s: Sequence[float]) -> Share:
    times = chain(clock_s, repeat(clock_s[-1]))
    share = Share(package=optics, clock=lambda: next(times))
    share.of(work)
    return share


def _tick(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    signal.raise_signal(signal.SIGPROF)  # as the timer does
    return x


def _outside() -> None:
    _tick(np.zeros(1))


def _within() -> None:
    refined(_tick, 0.0, 1.0, 33)


def _both() -> None:
    _outside()
    _within()


@pytest.mark.parametrize(
    ("work", "clock_s", "value"),
    [
        (_outside, [5.0, 6.0], 0.0),
        (_within, [5.0, 6.0], 1.0),
        (_both, [0.0, 1.0, 10.0], 0.9),  # a call that nothing interrupts takes 9 s
        (_both, [0.0, 0.0], 0.0),
    ],
)
def test_a_package_has_what_it_calls(
    work: Callable[[], None], clock_s: Sequence[float], value: float
) -> None:
    before = signal.getsignal(signal.SIGPROF)
    assert _shared(work, clock_s).value == value
    assert signal.getsignal(signal.SIGPROF) is before
