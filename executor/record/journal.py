"""The run's log: one JSON object a line, in order, for whoever reads what happened."""

from __future__ import annotations

import json
from typing import Any, TextIO

from microplan.executor.devices.drivers import Clock
from microplan.executor.devices.errors import ExecutorError
from microplan.schemas.codec import to_data

# a name or a driver's words may hold a lone half of a character, which UTF-8 has not;
# written so it is what JSON calls it
ESCAPED = "backslashreplace"


class Journal:
    """Writes numbered events to a stream as they happen."""

    def __init__(self, stream: TextIO, clock: Clock, *, seq: int = 0) -> None:
        self._stream = stream
        self._clock = clock
        self._seq = seq  # of the last event that is there
        self._step = ""

    @property
    def step(self) -> str:
        """Return the step that events belong to, "" between steps."""
        return self._step

    def enter(self, step: str) -> None:
        """Name the step that the events to come belong to."""
        self._step = step

    def write(self, event: str, **details: Any) -> None:
        """Append one event; `details` are JSON data or frozen dataclasses.

        Raises
        ------
        ExecutorError
            MP863 if it cannot be written.
        """
        self._seq += 1
        line = {
            "seq": self._seq,
            "t_s": round(self._clock.now_s(), 6),
            "step": self._step,
            "event": event,
            **{name: to_data(value) for name, value in details.items()},
        }
        try:
            self._stream.write(json.dumps(line, ensure_ascii=False) + "\n")
            self._stream.flush()
        except OSError as error:
            raise ExecutorError("MP863", f"event {self._seq}: {error}") from error
