"""Drives that go their way in steps, and drives that are ordered together."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.executor.micromanager.drives import DeviceScale
from microplan.executor.micromanager.movers import MMAxes, MMLens
from microplan.executor.micromanager.paced import LONGEST_S, Paced

ROOT = Path(__file__).parents[3]


class Jumps:
    """A drive that is where it is sent at once."""

    def __init__(
        self, name: str = "z_um", on_go: Callable[[], None] | None = None
    ) -> None:
        self.names, self.label = (name,), name
        self.at, self.stops = 0.0, 0
        self.on_go = on_go

    def check(self, targets: Mapping[str, float]) -> None:
        for value in targets.values():
            if not math.isfinite(value):
                raise ValueError(f"{self.label} = {value}")

    def pace(self, per_s: float | None) -> None:
        """Have none."""

    def go(self, targets: Mapping[str, float]) -> None:
        if self.on_go is not None:
            self.on_go()
        self.at = targets[self.label]

    def read(self) -> dict[str, float]:
        return {self.label: self.at}

    def busy(self) -> bool:
        return False

    def stop(self) -> None:
        self.stops += 1


class Hand:
    """A clock that is set by hand."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@given(
    st.floats(-300.0, 300.0),
    st.floats(0.5, 500.0),
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=40),
)
def test_a_paced_drive_is_never_faster_and_never_beyond(
    goal: float, per_s: float, waits: list[float]
) -> None:
    clock, drive = Hand(), Jumps()
    paced = Paced(drive, own_per_s=500.0, now_s=clock)
    paced.pace(per_s)
    paced.go({"z_um": goal})
    went_s = 0.0
    for wait_s in waits:
        clock.now += wait_s
        went_s += min(wait_s, LONGEST_S)
        paced.read()
        assert abs(drive.at) <= min(per_s * went_s, abs(goal)) + 1e-9 * (1 + abs(goal))
        assert drive.at * goal >= 0
    while paced.busy():  # it ends: each look takes it further on
        clock.now += LONGEST_S
    assert drive.at == goal


def test_a_slower_order_holds_for_one_motion() -> None:
    clock, drive = Hand(), Jumps()
    paced = Paced(drive, own_per_s=100.0, now_s=clock)
    for per_s, wanted in ((10.0, 1.0), (None, 10.0), (1000.0, 10.0)):
        paced.pace(per_s)
        drive.at = 0.0
        paced.go({"z_um": 50.0})
        clock.now += LONGEST_S
        assert paced.read()["z_um"] == pytest.approx(wanted)
    for bad in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="a speed of"):
            paced.pace(bad)


def test_a_stop_during_a_step_is_followed_by_another() -> None:
    """The step was on its way to the device when the stop came from elsewhere."""
    clock, begun, go_on = Hand(), threading.Event(), threading.Event()

    def wait() -> None:
        begun.set()
        assert go_on.wait(10.0)

    drive = Jumps(on_go=wait)
    paced = Paced(drive, own_per_s=100.0, now_s=clock)
    paced.go({"z_um": 50.0})
    clock.now += 0.05
    looking = threading.Thread(target=paced.read)
    looking.start()
    assert begun.wait(10.0)
    paced.stop()  # does not wait for the step
    assert drive.stops == 1
    go_on.set()
    looking.join(10.0)
    assert drive.stops == 2
    assert not paced.busy()


def test_a_stop_between_two_drives_keeps_the_second_from_moving() -> None:
    first, second = Jumps("z_um"), Jumps("theta_rad")
    axes = MMAxes("", "robot", [first, second])
    first.on_go = axes.stop
    axes.start(z_um=5.0, theta_rad=1.0)
    assert second.at == 0.0
    assert (first.stops, second.stops) == (2, 2)


def test_one_bad_target_of_an_order_moves_nothing() -> None:
    first, second = Jumps("z_um"), Jumps("theta_rad")
    axes = MMAxes("", "robot", [first, second])
    for bad in ({"theta_rad": math.nan}, {"x_um": 1.0}, {"speed_um_per_s": math.nan}):
        with pytest.raises(ValueError, match=r"nan|has no x_um"):
            axes.start(**{"z_um": 5.0, **bad})
    assert (first.at, second.at) == (0.0, 0.0)


def test_a_drive_that_cannot_be_stopped_keeps_no_other_from_it() -> None:
    class Broken(Jumps):
        def stop(self) -> None:
            raise OSError("E07")

    second = Jumps("focus_um")
    lens = MMLens("", "lens", [Broken("magnification"), second])
    with pytest.raises(RuntimeError, match="magnification: E07"):
        lens.stop()
    assert second.stops == 1


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e2), st.floats(-1e4, 1e4))
def test_a_scale_goes_both_ways(zero: float, per: float, value: float) -> None:
    scale = DeviceScale(zero=zero, per=-per)
    assert scale.value(scale.number(value)) == pytest.approx(value, abs=1e-9)


def test_without_the_extra_a_station_says_what_is_missing() -> None:
    program = (
        "import sys\n"
        "sys.modules['pymmcore_plus'] = None\n"
        "from microplan.executor.devices.loading import build, load\n"
        "made = load('executor.micromanager.hub:hub', 'hubs.mm')\n"
        "build(made, 'hubs.mm', {})\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True, text=True, cwd=ROOT, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert "hubs.mm: ModuleNotFoundError: import of pymmcore_plus" in done.stderr
