"""Recording of a run: every call of a device with its answer, at full precision."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TextIO

from microplan.executor.devices.drivers import AxisReading, Frame
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import AXES
from microplan.executor.devices.station import Station
from microplan.executor.record.frames import Frames, region_data
from microplan.schemas.plan import Region

FORMAT = 1
RESUMES = "journal_lines"  # of the first line: how many a run was resumed from, or 0
CALLS = "calls.jsonl"
MORE_CALLS = "calls-*.jsonl"  # of executors that resumed the run
ROLES: Mapping[str, str] = {  # field of a station -> name of the device
    "stage": "stage", "robot": "robot", "gripper": "jaws", "lens": "lens",
    "light": "light", "camera": "camera", "clock": "clock",
}  # fmt: skip
COMMANDS = (
    "start", "start_magnification", "start_focus_um", "set_level", "grab",
)  # fmt: skip
QUERIES = ("reading", "moving", "now_s")


class CallRecorder:
    """Writes the calls of devices to a stream, a line each.

    Parameters
    ----------
    stream : text stream
        Where the lines go.
    frames : Frames
        Keeps the pictures.
    station : Station
        Whose devices are called.
    facts : mapping
        More for the first line: which plan, which station.
    """

    def __init__(
        self, stream: TextIO, frames: Frames, station: Station, facts: Mapping[str, Any]
    ) -> None:
        self._stream, self._frames, self._found = stream, frames, station
        self._lock = threading.RLock()
        self._count = 0
        self._state: dict[str, Any] = {}  # what the index holds of a frame
        self._begun: dict[int, dict[str, Any]] = {}  # calls that have not returned
        self._open = True
        self._write(
            {
                "microplan_record": FORMAT,
                **facts,
                "devices": station.devices(),
                "offer": plain(station.offer),
                "rules": plain(station.rules),
                "whole_frames": frames.wanted,
            }
        )

    def station(self) -> Station:
        """Return the station with devices whose calls are noted."""
        devices = {
            field: _Noted(device, name, self)
            for field, name in ROLES.items()
            if (device := getattr(self._found, field)) is not None
        }
        return replace(self._found, **devices)  # type: ignore[arg-type]  # by name

    def close(self, code: str | None, why: str = "") -> None:
        """Write how the run ended; calls that come later are not noted."""
        with self._lock:
            for row in self._begun.values():
                self._write({**row, "hung": True})
            self._begun.clear()
            self._write({"ended": code, "why": why})
            self._open = False

    def call(
        self, name: str, call: Callable[..., Any], args: tuple[Any, ...], named: Any
    ) -> Any:
        """Make a call and note it; what it raises is noted and raised."""
        row: dict[str, Any] = {"n": self._next(), "call": name}
        method = name.partition(".")[2]
        if method in COMMANDS:
            row["with"] = _given(args, named)
        with self._lock:
            self._begun[row["n"]] = row
        try:
            answer = call(*args, **named)
        except BaseException as error:  # a driver may raise anything
            row["raised"] = [type(error).__name__, _words(error)]
            self._finish(row)
            raise
        try:
            row["gave"] = self._answer(name, answer, row.get("with", {}))
        except ExecutorError:  # it answered, and that could not be kept
            with self._lock:
                self._begun.pop(row["n"], None)
            raise
        self._finish(row)
        return answer

    def stop(self, name: str, stop: Callable[[], None]) -> None:
        """Stop a device, then note it; a stop must not fail for that.

        Nothing but a stop overlaps a call: one that has not returned was given up.
        """
        for row in list(self._begun.values()):  # no lock: a disk that hangs holds it
            row["hung"] = True
        stop()
        try:
            self._write({"n": self._next(), "call": name})
        except (OSError, ValueError, ExecutorError):
            return

    def _finish(self, row: dict[str, Any]) -> None:
        """Write the row of a call that has returned."""
        with self._lock:
            if self._begun.pop(row["n"], None) is not None:
                self._write(row)

    def _answer(self, name: str, answer: Any, given: Mapping[str, Any]) -> Any:
        """Return a call's answer as JSON data; frames are kept as files."""
        self._remember(name, given)
        if isinstance(answer, Frame):
            return self._kept(answer, given)
        if isinstance(answer, AxisReading):
            values = [_number(getattr(answer, axis)) for axis in AXES]
            self._state[name.partition(".")[0]] = dict(zip(AXES, values, strict=True))
            return values
        if isinstance(answer, tuple):
            return [_number(value) for value in answer]
        if answer is None or isinstance(answer, bool):
            return answer
        return _number(answer)

    def _remember(self, name: str, given: Mapping[str, Any]) -> None:
        """Note what the view is set to."""
        kept = {
            "lens.start_magnification": "magnification",
            "lens.start_focus_um": "focus_um",
            "light.set_level": "light",
        }
        if name in kept:
            self._state[kept[name]] = given.get("value")

    def _kept(self, frame: Frame, given: Mapping[str, Any]) -> dict[str, Any]:
        """Keep a frame; return its path and its hash."""
        exposed_s = _number(frame.exposed_s)
        facts = {**self._state, "exposed_s": exposed_s}
        path = self._frames.save(frame.counts, _region(given.get("region")), facts)
        sha256 = {} if path is None else {"sha256": pixels_sha256(frame.counts)}
        return {"frame": path, **sha256, "exposed_s": exposed_s}

    def _next(self) -> int:
        """Return the number of a call."""
        with self._lock:
            self._count += 1
            return self._count

    def _write(self, row: Mapping[str, Any]) -> None:
        """Append one line; MP863 if it cannot be written."""
        line = json.dumps(row, ensure_ascii=False, separators=(",", ":")) + "\n"
        with self._lock:
            if not self._open:
                return
            try:
                self._stream.write(line)
                self._stream.flush()  # a crash must leave the calls that were made
            except OSError as error:
                raise ExecutorError("MP863", f"{CALLS}: {error}") from error


class _Noted:
    """A device whose calls are noted and passed on."""

    def __init__(self, device: Any, name: str, record: CallRecorder) -> None:
        self._device, self._name, self._record = device, name, record

    def __getattr__(self, method: str) -> Any:
        found = getattr(self._device, method)
        name = f"{self._name}.{method}"
        if method == "stop":
            return lambda: self._record.stop(name, found)
        if method not in COMMANDS and method not in QUERIES:
            return found
        return lambda *args, **named: self._record.call(name, found, args, named)


def plain(value: Any) -> Any:
    """Return dataclasses as JSON data at full precision.

    An infinite limit is left out: JSON has none, and it is the default, "no limit",
    where the key is missing.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        found = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        return {k: plain(v) for k, v in found.items() if not _infinite(v)}
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, tuple | list):
        return [plain(v) for v in value]
    return value


def pixels_sha256(counts: Any) -> str:
    """Return the hash of a frame: its depth, its size and its pixels."""
    head = f"{counts.dtype} {counts.shape} ".encode()
    return hashlib.sha256(head + counts.tobytes()).hexdigest()


def _infinite(value: object) -> bool:
    """Return whether a value is an infinite number."""
    return isinstance(value, float) and math.isinf(value)


def _given(args: tuple[Any, ...], named: Mapping[str, Any]) -> dict[str, Any]:
    """Return a command's arguments; one without a name is `value`."""
    found = {**({"value": args[0]} if args else {}), **named}
    if "after_s" in named:  # the camera's: its other argument is the region
        found["region"] = region_data(found.pop("value", None))
    return {k: _number(v) if isinstance(v, float) else v for k, v in found.items()}


def _region(rows: Any) -> Region | None:
    """Return a region from its four numbers."""
    if rows is None:
        return None
    return Region(row=rows[0], column=rows[1], rows=rows[2], columns=rows[3])


def _words(error: BaseException) -> str:
    """Return the message of an error, "" if it has none."""
    try:
        return str(error)
    except Exception:  # noqa: BLE001 - a driver's class may do what it likes
        return ""


def _number(value: Any) -> Any:
    """Return a number as JSON has it; nan and infinity as words, what is none too."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return repr(value)
    return number if math.isfinite(number) else str(number)
