"""Values that devices answer, checked for kind; each fault with its code."""

from __future__ import annotations

import math
import numbers
from typing import Any

import numpy as np

from microplan.executor.devices.drivers import AxisReading, Clock, Frame
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import AXES
from microplan.executor.devices.timeouts import reason


def as_reading(name: str, found: Any) -> AxisReading:
    """Return the reading of an axis group; MP841 if it is none."""
    if not isinstance(found, AxisReading):
        raise _other(name, found, "an AxisReading")
    read = {a: as_number(f"{name}.{a}", getattr(found, a)) for a in AXES}
    return AxisReading(**read)


def as_number(name: str, found: Any) -> float:
    """Return a number as a float, also nan; MP841 if it is none."""
    if isinstance(found, bool | np.bool_) or not isinstance(found, numbers.Real):
        raise _other(name, found, "a number")
    try:
        return float(found)
    except OverflowError:
        return math.inf


def as_pair(name: str, found: Any) -> tuple[float, float]:
    """Return two numbers; MP841 if they are none."""
    if not isinstance(found, tuple | list) or len(found) != 2:
        raise _other(name, found, "two numbers")
    return as_number(name, found[0]), as_number(name, found[1])


def as_truth(name: str, found: Any) -> bool:
    """Return a truth value; MP841 if it is none."""
    if not isinstance(found, bool | np.bool_):
        raise _other(name, found, "True or False")
    return bool(found)


def as_frame(name: str, found: Any) -> Frame:
    """Return a frame of counts; MP841 if it is none."""
    if not isinstance(found, Frame):
        raise _other(name, found, "a Frame")
    counts = found.counts
    if not isinstance(counts, np.ndarray) or counts.ndim != 2:
        raise _other(f"{name}.counts", counts, "an array of rows and columns")
    if counts.dtype not in (np.uint8, np.uint16):
        raise ExecutorError("MP841", f"{name}.counts are {counts.dtype}, not uint8 "
                            "or uint16")  # fmt: skip
    exposed_s = as_number(f"{name}.exposed_s", found.exposed_s)
    return Frame(counts=counts, exposed_s=exposed_s)


class CheckedClock:
    """A driver's clock whose answers are checked."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock

    def now_s(self) -> float:
        """Return the time; MP841 if it is none, MP847 if it is not finite."""
        found_s = as_number("clock.now_s", self._asked("now_s"))
        if not math.isfinite(found_s):
            raise ExecutorError("MP847", f"clock.now_s is {found_s}")
        return found_s

    def wait(self, seconds: float) -> None:
        """Let time pass; MP841 if that fails."""
        self._asked("wait", seconds)

    def _asked(self, method: str, *given: float) -> Any:
        """Return what the clock answers; what it raises is a device's fault."""
        try:
            return getattr(self._clock, method)(*given)
        except KeyboardInterrupt:  # the operator's: a clock is called where he is heard
            raise
        except BaseException as error:
            raise ExecutorError("MP841", f"clock.{method}: {reason(error)}") from error


def _other(name: str, found: Any, wanted: str) -> ExecutorError:
    """Return the error about an answer of another kind, shown in brief."""
    try:
        shown = repr(found)
    except Exception as error:  # noqa: BLE001 - a driver's class may do what it likes
        shown = f"something whose repr raises {type(error).__name__}"
    short = shown if len(shown) <= 80 else shown[:77] + "..."
    kind = type(found).__name__
    return ExecutorError("MP841", f"{name} gave {short} ({kind}), not {wanted}")
