"""Interrupts by the operator: one Ctrl-C is a pause, two are a stop."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any

from microplan.executor.devices.errors import ExecutorError

# a terminal that is closed; Windows has no SIGHUP
CLOSED = getattr(signal, "SIGHUP", signal.SIGTERM)


class Operator:
    """Takes interrupts while it is entered.

    The first lets the present motion end; then `pause` asks whether to go on. The
    second, even while it asks, raises KeyboardInterrupt at once, and so does a request
    to terminate, or a terminal that is closed, unless that is ignored (nohup); more are
    ignored, so that nothing disturbs the stopping.

    Parameters
    ----------
    ask : callable or None
        Return whether to go on; None without an operator: a pause is a stop then.
    """

    def __init__(self, ask: Callable[[], bool] | None = None) -> None:
        self._ask = ask
        self._asked = False
        self._stopping = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Operator:
        """Take interrupts; only the main thread can."""
        if threading.current_thread() is threading.main_thread():
            for number in dict.fromkeys((signal.SIGINT, signal.SIGTERM, CLOSED)):
                self._before[number] = signal.signal(number, self.interrupt)
            if self._before[CLOSED] == signal.SIG_IGN:
                signal.signal(CLOSED, signal.SIG_IGN)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Restore the former handlers of interrupts."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def interrupt(self, number: int, _frame: FrameType | None = None) -> None:
        """Note the first interrupt; raise KeyboardInterrupt at the second."""
        if self._stopping:
            return
        if self._asked or number != signal.SIGINT:
            self._stopping = True
            raise KeyboardInterrupt
        self._asked = True

    def pause(self) -> None:
        """Return at once, or after the operator said so; MP860 if he says stop."""
        if not self._asked:
            return
        if self._ask is None or not self._ask():
            raise ExecutorError("MP860", "stopped by the operator between two motions")
        self._asked = False
