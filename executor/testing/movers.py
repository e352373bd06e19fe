"""Conformance checks of everything that moves: axes, jaws, zoom, focus."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from microplan.executor.devices.safety import AXES as AXIS_NAMES
from microplan.executor.testing.bench import BAD, Bench, Check, identity, must


@dataclass(frozen=True, slots=True)
class _Kind:
    """Kind of moving device: how it is ordered and read, by its targets' names."""

    names: tuple[str, ...]
    start: Callable[[Any, Mapping[str, float]], None]
    read: Callable[[Any], dict[str, float]]
    together: bool  # one order may name several targets


def _start_axes(device: Any, target: Mapping[str, float]) -> None:
    device.start(**target)


def _read_axes(device: Any) -> dict[str, float]:
    found = device.reading()
    return {name: float(getattr(found, name)) for name in AXIS_NAMES}


def _start_jaws(device: Any, target: Mapping[str, float]) -> None:
    device.start(target["opening_um"])


def _read_jaws(device: Any) -> dict[str, float]:
    return {"opening_um": float(device.reading())}


def _start_lens(device: Any, target: Mapping[str, float]) -> None:
    for name, value in target.items():
        getattr(device, f"start_{name}")(value)


def _read_lens(device: Any) -> dict[str, float]:
    zoom, focus_um = device.reading()
    return {"magnification": float(zoom), "focus_um": float(focus_um)}


def _read(kind: _Kind, device: Any, bench: Bench) -> dict[str, float]:
    """Return finite readings."""
    found = bench.call("reading", lambda: kind.read(device))
    for name, value in found.items():
        must(math.isfinite(value), f"{name} reads {value}")
    return found


def _go(kind: _Kind, device: Any, bench: Bench, target: Mapping[str, float]) -> None:
    """Order a motion and wait until it has ended."""
    bench.call("start", lambda: kind.start(device, target))
    bench.rest(device)


def _at(
    kind: _Kind, device: Any, bench: Bench, wanted: Mapping[str, float], why: str
) -> None:
    """The device must read what is wanted, within the bench's windows."""
    found = _read(kind, device, bench)
    for name, value in wanted.items():
        off = abs(found[name] - value)
        must(
            off <= bench.window[name],
            f"{why}: {name} reads {found[name]:.6g}, must be {value:.6g}",
        )


def _still_at_rest(kind: _Kind, device: Any, bench: Bench) -> None:
    """A device at rest says so and reads the same twice."""
    bench.rest(device)
    before = _read(kind, device, bench)
    bench.clock.wait(bench.poll_s)
    _at(kind, device, bench, before, "it was at rest")


def _absolute(kind: _Kind, device: Any, bench: Bench) -> None:
    """A target is a state: ordered twice, the second order changes nothing."""
    home = _read(kind, device, bench)
    for name in kind.names:
        target = {name: home[name] + bench.step[name]}
        for why in ("after a motion", "after the same order again"):
            _go(kind, device, bench, target)
            _at(kind, device, bench, {**home, **target}, why)
        _go(kind, device, bench, {name: home[name]})
        _at(kind, device, bench, home, "after the way back")


def _together(kind: _Kind, device: Any, bench: Bench) -> None:
    """One order moves all the axes that it names."""
    home = _read(kind, device, bench)
    target = {name: home[name] + bench.step[name] for name in kind.names[:2]}
    _go(kind, device, bench, target)
    _at(kind, device, bench, {**home, **target}, "after an order of two axes")
    _go(kind, device, bench, home)


def _does_not_wait(kind: _Kind, device: Any, bench: Bench) -> None:
    """An order returns while the motion is under way, and `moving` says so."""
    home = _read(kind, device, bench)
    name = kind.names[0]
    target = {name: home[name] + bench.step[name]}
    bench.call("start", lambda: kind.start(device, target))
    must(bench.call("moving", device.moving), "it does not move after `start` returned")
    bench.rest(device)
    _go(kind, device, bench, home if kind.together else {name: home[name]})


def _stops(
    kind: _Kind, device: Any, bench: Bench, stop: Callable[[], None], why: str
) -> None:
    """Stop a motion under way; it must end short of its target, and stay there."""
    home = _read(kind, device, bench)
    name = kind.names[0]
    goal = home[name] + bench.step[name]
    bench.call("start", lambda: kind.start(device, {name: goal}))
    stop()
    bench.rest(device)
    first = _read(kind, device, bench)
    must(
        abs(first[name] - goal) > bench.window[name],
        f"{why}: {name} went on to its target",
    )
    bench.clock.wait(10 * bench.poll_s)
    _at(kind, device, bench, first, f"{why}, some time later")
    _go(kind, device, bench, {name: home[name]})
    _at(kind, device, bench, home, f"{why}, after the next order")


def _stop_is_idempotent(kind: _Kind, device: Any, bench: Bench) -> None:
    """Stopping twice, in a motion and at rest, does no more than stopping once."""

    def twice() -> None:
        for _ in range(2):
            bench.call("stop", device.stop)

    _stops(kind, device, bench, twice, "stopped twice")
    before = _read(kind, device, bench)
    twice()
    _at(kind, device, bench, before, "stopped at rest")


def _stop_from_another_thread(kind: _Kind, device: Any, bench: Bench) -> None:
    """A stop may come from any thread."""
    wrong: list[BaseException] = []

    def stop() -> None:
        try:
            device.stop()
        except BaseException as error:  # noqa: BLE001 - reported by the main thread
            wrong.append(error)

    def elsewhere() -> None:
        thread = threading.Thread(target=stop, daemon=True)
        thread.start()
        thread.join(bench.call_s)
        must(not thread.is_alive(), "stop from another thread does not return")
        must(not wrong, f"stop from another thread raised {wrong}")

    _stops(kind, device, bench, elsewhere, "stopped from another thread")


def _refuses_bad_numbers(kind: _Kind, device: Any, bench: Bench) -> None:
    """Nan and infinity are refused, and nothing moves."""
    _refuses(kind, device, bench, dict.fromkeys(kind.names, BAD))


def _keeps_limits(kind: _Kind, device: Any, bench: Bench) -> None:
    """A target beyond the limits is refused, and nothing moves."""
    beyond = {n: (bench.beyond[n],) for n in kind.names if n in bench.beyond}
    _refuses(kind, device, bench, beyond)


def _refuses(
    kind: _Kind, device: Any, bench: Bench, targets: Mapping[str, tuple[float, ...]]
) -> None:
    """Order targets, each of which must be refused while nothing moves."""
    home = _read(kind, device, bench)
    for name, values in targets.items():
        for value in values:
            bench.refused(
                f"start({name}={value:g})",
                lambda name=name, value=value: kind.start(device, {name: value}),  # type: ignore[misc]  # bound names
            )
    bench.rest(device)
    _at(kind, device, bench, home, "after orders that were refused")


_CHECKS: Mapping[str, Callable[[_Kind, Any, Bench], None]] = {
    "is still at rest": _still_at_rest,
    "moves to absolute states": _absolute,
    "moves what one order names": _together,
    "returns before it has arrived": _does_not_wait,
    "stops twice as once": _stop_is_idempotent,
    "stops from another thread": _stop_from_another_thread,
    "refuses nan and infinity": _refuses_bad_numbers,
    "refuses what is beyond its limits": _keeps_limits,
}


def _bound(kind: _Kind) -> Mapping[str, Check]:
    """Return the checks of one kind of device."""

    def bind(check: Callable[[_Kind, Any, Bench], None]) -> Check:
        return lambda device, bench: check(kind, device, bench)

    named = {name: bind(check) for name, check in _CHECKS.items()}
    if not kind.together:
        del named["moves what one order names"]
    return {"says what it is": identity, **named}


_AXES = _Kind(AXIS_NAMES, _start_axes, _read_axes, together=True)
AXES = _bound(_AXES)
JAWS = _bound(replace(_AXES, names=("opening_um",), start=_start_jaws, read=_read_jaws,
                      together=False))  # fmt: skip
LENS = _bound(_Kind(("magnification", "focus_um"), _start_lens, _read_lens, False))  # noqa: FBT003 - together
