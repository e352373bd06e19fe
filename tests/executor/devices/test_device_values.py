"""Devices that answer what they should not: a code, never a crash."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from typing import Any

import numpy as np
import pytest

from microplan.executor.devices.device_values import CheckedClock
from microplan.executor.devices.drivers import AxisReading, Frame
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.loading import check_role
from microplan.executor.devices.station import Station, preflight
from microplan.executor.motion.motion import Motion
from microplan.executor.simulated.cell import build_cell
from microplan.schemas.plan import AxisMove
from tests.executor.bench import plan_of, world


class Rude:
    """Raises even when it is asked what it is."""

    def __repr__(self) -> str:
        raise ValueError("no")


RUBBISH: list[Any] = [
    None, "", "nan", b"1", [], {}, (), (1.0,), (1.0, 2.0, 3.0), ("a", 1.0), (None, 1.0),
    True, 1j, Decimal(1), object(), Rude(), np.zeros(2), np.array(["x"]),
    AxisReading(x_um=None, y_um=0.0, z_um=0.0, theta_rad=0.0),  # type: ignore[arg-type]
    AxisReading(x_um=10**400, y_um=0.0, z_um=0.0, theta_rad=0.0),
    AxisReading(x_um=math.nan, y_um=0.0, z_um=0.0, theta_rad=0.0),
    Frame(counts=None, exposed_s=0.0),  # type: ignore[arg-type]
    Frame(counts=np.zeros((4, 4)), exposed_s=0.0),  # type: ignore[arg-type]
    Frame(counts=np.zeros((4, 4, 3), np.uint8), exposed_s=0.0),
    Frame(counts=np.zeros((4, 4), np.uint8), exposed_s="0"),  # type: ignore[arg-type]
    "x" * 10_000, 10**400,
]  # fmt: skip


class Saying:
    """A device of which one method answers something else."""

    def __init__(self, device: Any, method: str, answer: Any) -> None:
        self._device, self._method, self._answer = device, method, answer

    def __getattr__(self, name: str) -> Any:
        if name == self._method:
            return lambda *_args, **_named: self._answer
        return getattr(self._device, name)


TO = AxisMove(axes="stage", x_um=-599.0)
ASKED: dict[tuple[str, str], Callable[[Motion, Station], object]] = {
    ("stage", "reading"): lambda m, s: m.reading(s, "stage"),
    ("stage", "moving"): lambda m, s: m.travel(s, TO, "approach"),
    ("robot", "reading"): lambda m, s: m.reading(s, "robot"),
    ("gripper", "reading"): lambda m, s: m.opening(s),
    ("gripper", "moving"): lambda m, s: m.grip(s, 120.0),
    ("lens", "reading"): lambda m, s: m.magnification(s),
    ("lens", "moving"): lambda m, s: m.focus(s, 1.0),
    ("camera", "grab"): lambda m, s: m.grab(s, None),
}


def rigged(station: Station, device: str, rude: Any) -> Station:
    """Return the station with another device."""
    return replace(station, **{device: rude})


@pytest.mark.parametrize(("device", "method"), ASKED)
def test_rubbish_has_a_code(device: str, method: str) -> None:
    station = build_cell(world(), 0).station
    right: tuple[type, ...] = (bool,) if method == "moving" else ()
    told = set()
    for answer in RUBBISH:
        if isinstance(answer, right):
            continue
        rude = Saying(getattr(station, device), method, answer)
        with pytest.raises(ExecutorError) as caught:
            ASKED[device, method](Motion(), rigged(station, device, rude))
        assert caught.value.code in ("MP841", "MP847")
        assert method in caught.value.message or caught.value.code == "MP847"
        assert len(caught.value.message) < 300
        told.add(caught.value.code)
    assert "MP841" in told


class Leaving(BaseException):
    """What no driver should raise, without words."""

    def __str__(self) -> str:
        raise ValueError("no")


class Raising(Saying):
    """A device of which one method raises."""

    def __getattr__(self, name: str) -> Any:
        if name == self._method:
            return self._raise
        return getattr(self._device, name)

    def _raise(self, *_args: Any, **_named: Any) -> None:
        raise self._answer


@pytest.mark.parametrize(("device", "method"), [*ASKED, ("stage", "start")])
def test_what_is_no_exception_has_a_code_at_once(device: str, method: str) -> None:
    """SystemExit in a driver ends neither the process nor only its thread."""
    station = build_cell(world(), 0).station
    travel = ASKED["stage", "moving"]
    for error in (SystemExit(0), KeyboardInterrupt(), GeneratorExit(), Leaving()):
        rude = Raising(getattr(station, device), method, error)
        with pytest.raises(ExecutorError) as caught:
            ASKED.get((device, method), travel)(Motion(), rigged(station, device, rude))
        assert caught.value.code == "MP841"
        assert type(error).__name__ in caught.value.message


def test_a_stop_that_raises_what_is_no_exception_is_told() -> None:
    station = build_cell(world(), 0).station
    rude = Raising(station.stage, "stop", SystemExit(0))
    (left,) = Motion().stop(rigged(station, "stage", rude))
    assert left == "stage.stop: SystemExit: 0"


@pytest.mark.parametrize("device", ["stage", "robot", "gripper"])
def test_rubbish_before_a_run_has_a_code(device: str) -> None:
    station = build_cell(world(), 0).station
    for answer in RUBBISH:
        rude = Saying(getattr(station, device), "reading", answer)
        with pytest.raises(ExecutorError) as caught:
            preflight(plan_of(()), rigged(station, device, rude))
        assert caught.value.code in ("MP841", "MP847")


def test_a_clock_that_tells_no_time_has_a_code() -> None:
    clock = build_cell(world(), 0).station.clock
    for answer in [*RUBBISH, math.nan, math.inf]:
        with pytest.raises(ExecutorError) as caught:
            CheckedClock(Saying(clock, "now_s", answer)).now_s()
        assert caught.value.code in ("MP841", "MP847")
    with pytest.raises(ExecutorError, match=r"clock\.wait: SystemExit"):
        CheckedClock(Raising(clock, "wait", SystemExit(0))).wait(1.0)
    with pytest.raises(ExecutorError, match=r"clock\.wait: AttributeError"):
        CheckedClock(object()).wait(1.0)  # type: ignore[arg-type]
    assert CheckedClock(clock).now_s() == clock.now_s()


class Silent:
    """A device that does not say what it is, or says it by failing."""

    def __init__(self, trouble: Callable[[], object]) -> None:
        self._trouble = trouble

    @property
    def model(self) -> str:
        """Return nothing, ever."""
        return str(self._trouble())

    serial = "0"


def cable() -> object:
    """Fail as a driver does."""
    raise OSError("cable")


def test_a_device_that_does_not_say_what_it_is_has_a_code(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    station = build_cell(world(), 0).station
    safety = replace(station.rules.safety, call_s=0.05)
    station = replace(station, rules=replace(station.rules, safety=safety))
    never = threading.Event()
    for trouble, code in ((never.wait, "MP844"), (cable, "MP841")):
        with pytest.raises(ExecutorError, match="the light's model") as caught:
            replace(station, light=Silent(trouble)).devices()  # type: ignore[arg-type]
        assert caught.value.code == code
    monkeypatch.setattr("microplan.executor.devices.loading.ASK_S", 0.05)
    for trouble, why in ((never.wait, "has not answered"), (cable, "cable")):
        with pytest.raises(ExecutorError, match=why) as caught:
            check_role(Silent(trouble), "light", "devices.light")
        assert caught.value.code == "MP813"
    never.set()
