"""The conformance suite: our drivers pass, and each bad one fails for its reason."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from microplan.executor.devices.timeouts import Caller, WallClock
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.executor.testing import Bench, ConformanceError, conforms, failures
from microplan.executor.testing.__main__ import main
from microplan.schemas.codec import to_data
from tests.executor.bench import quiet, world

ROLES = ("stage", "robot", "jaws", "lens", "light", "camera", "clock")
BEYOND = {"x_um": 1e6, "opening_um": 900.0, "focus_um": 1e5, "magnification": 900.0}


def cell() -> Cell:
    return build_cell(quiet(world()), 0)


def bench(found: Cell) -> Bench:
    return Bench(clock=found.clock, beyond=BEYOND, call_s=10.0)


@pytest.mark.parametrize("role", ROLES)
def test_the_simulated_devices_conform(role: str) -> None:
    found = cell()
    conforms(getattr(found, role), role, bench(found))


def test_the_wall_clock_conforms() -> None:
    conforms(WallClock(), "clock", Bench())


class Bad:
    """A device with one thing done wrong; the rest is the simulated cell's."""

    def __init__(self, device: Any, found: Cell) -> None:
        self.device, self.cell = device, found

    def __getattr__(self, name: str) -> Any:
        return getattr(self.device, name)


class Relative(Bad):
    def start(self, **target: float) -> None:
        now = self.device.reading()
        self.device.start(**{k: v + getattr(now, k) for k, v in target.items()})


class Blocking(Bad):
    def start(self, **target: float) -> None:
        self.device.move(**target)


class Deaf(Bad):
    def stop(self) -> None:
        """Go on."""


class Toggling(Bad):
    """The second stop starts it again."""

    def __init__(self, device: Any, found: Cell) -> None:
        super().__init__(device, found)
        self.last: dict[str, float] = {}
        self.stopped = False

    def start(self, **target: float) -> None:
        self.last, self.stopped = target, False
        self.device.start(**target)

    def stop(self) -> None:
        self.device.stop()
        if self.stopped:
            self.device.start(**self.last)
        self.stopped = not self.stopped


class Swallowing(Bad):
    def start(self, **target: float) -> None:
        if all(math.isfinite(v) for v in target.values()):
            self.device.start(**target)


class Clamping(Bad):
    def start(self, **target: float) -> None:
        self.device.start(
            **{k: max(min(v, 1000.0), -1000.0) for k, v in target.items()}
        )


class Anonymous(Bad):
    serial = ""


class Endless(Bad):
    def moving(self) -> bool:
        return True


class Hanging(Bad):
    def reading(self) -> object:
        time.sleep(0.5)
        return self.device.reading()


class Taking(Bad):
    """Moves another axis along."""

    def start(self, **target: float) -> None:
        more = {"y_um": target["x_um"]} if "x_um" in target else {}
        self.device.start(**{**target, **more})


@pytest.mark.parametrize(
    ("kind", "check", "why"),
    [
        (Relative, "moves to absolute states", "after a motion"),
        (Blocking, "returns before it has arrived", "does not move"),
        (Deaf, "stops twice as once", "went on to its target"),
        (Toggling, "stops twice as once", "went on to its target"),
        (Swallowing, "refuses nan and infinity", "was accepted"),
        (Clamping, "refuses what is beyond its limits", "was accepted"),
        (Anonymous, "says what it is", "serial is ''"),
        (Endless, "is still at rest", "still moves"),
        (Hanging, "is still at rest", "has not answered"),
        (Taking, "moves to absolute states", "y_um reads"),
    ],
)
def test_a_bad_stage_fails_for_its_reason(
    kind: type[Bad], check: str, why: str
) -> None:
    found = cell()
    limits = replace(bench(found), call_s=0.2 if kind is Hanging else 10.0)
    wrong = {
        r.check: r.wrong for r in failures(kind(found.stage, found), "stage", limits)
    }
    assert why in wrong[check]


class Stale(Bad):
    def grab(self, region: object = None, *, after_s: float) -> object:
        frame = self.device.grab(region, after_s=0.0)
        return replace(frame, exposed_s=frame.exposed_s - 0.1)


class Early(Bad):
    """Does not wait for the time that was asked for."""

    def grab(self, region: object = None, *, after_s: float) -> object:
        return self.device.grab(region, after_s=0.0)


class Whole(Bad):
    def grab(self, region: object = None, *, after_s: float) -> object:
        return self.device.grab(None, after_s=after_s)


class Reused(Bad):
    """All frames share one buffer."""

    buffer: Any = None

    def grab(self, region: object = None, *, after_s: float) -> object:
        frame = self.device.grab(region, after_s=after_s)
        if self.buffer is None or self.buffer.shape != frame.counts.shape:
            self.buffer = np.empty_like(frame.counts)
        self.buffer[:] = frame.counts
        return replace(frame, counts=self.buffer)


class Scaled(Bad):
    def grab(self, region: object = None, *, after_s: float) -> object:
        frame = self.device.grab(region, after_s=after_s)
        return replace(frame, counts=frame.counts / 255.0)


@pytest.mark.parametrize(
    ("kind", "check", "why"),
    [
        (Stale, "gives no stale frame", "a stale frame"),
        (Early, "gives no stale frame", "a stale frame"),
        (Whole, "gives the region asked for", "(480, 640) pixels"),
        (Reused, "gives frames of their own", "overwrites"),
        (Scaled, "gives whole counts", "float64"),
    ],
)
def test_a_bad_camera_fails_for_its_reason(
    kind: type[Bad], check: str, why: str
) -> None:
    found = cell()
    device = kind(found.camera, found)
    wrong = {r.check: r.wrong for r in failures(device, "camera", bench(found))}
    assert why in wrong[check]


def test_a_device_without_a_method_gets_no_further() -> None:
    wrong = failures(object(), "lens", Bench())
    assert [r.check for r in wrong] == ["has all methods"]
    with pytest.raises(ConformanceError, match="no model"):
        conforms(object(), "lens", Bench())


def test_the_command_tells_each_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "world.json"
    path.write_text(json.dumps(to_data(quiet(world()))), encoding="utf-8")
    driver = ["executor.simulated.hub:cell", "--option", f"world='{path}'"]
    assert main([*driver, "--role", "stage", "--part", "stage"]) == 0
    assert "ok      moves to absolute states" in capsys.readouterr().out
    assert main([*driver, "--role", "camera", "--part", "stage"]) == 1
    assert main(["nowhere:nothing", "--role", "stage"]) == 2
    capsys.readouterr()
    assert main([*driver, "--role", "stage"]) == 1
    assert "name what to test by --part: stage, robot, jaws" in capsys.readouterr().err
    assert main([*driver, "--role", "stage", "--part", "table"]) == 2
    assert "has no 'table', parts: stage, robot, jaws" in capsys.readouterr().err


def test_a_late_answer_of_a_call_that_was_given_up_is_followed_by_a_stop() -> None:
    stopped: list[str] = []
    with pytest.raises(Exception, match=r"has not answered for 0.05 s"):
        Caller().call(
            "slow", lambda: time.sleep(0.1), 0.05, late=lambda: stopped.append("late")
        )
    assert not stopped
    time.sleep(0.2)
    assert stopped == ["late"]
