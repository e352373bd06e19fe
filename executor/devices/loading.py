"""Loading of drivers: an entry point of `microplan.drivers`, or `module:attribute`."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.timeouts import Caller, reason

GROUP = "microplan.drivers"
ASK_S = 5.0  # limit of asking a device for an attribute

# what a device must have, by role; `microplan.executor.devices.drivers` says what each
# must do
_DEVICE = ("model", "serial")
_MOVER = (*_DEVICE, "reading", "moving", "stop")
ROLES: Mapping[str, tuple[str, ...]] = {
    "stage": (*_MOVER, "start"),
    "robot": (*_MOVER, "start"),
    "jaws": (*_MOVER, "start"),
    "lens": (*_MOVER, "start_magnification", "start_focus_um"),
    "light": (*_DEVICE, "set_level"),
    "camera": (*_DEVICE, "grab"),
    "clock": ("now_s", "wait"),
}


def load(name: str, key: str) -> Callable[..., Any]:
    """Return the callable that makes a driver.

    Parameters
    ----------
    name : str
        An entry point's name, or "module:attribute".
    key : str
        Where it is asked for, for the message.

    Raises
    ------
    ExecutorError
        MP813 if there is no such thing, or it cannot be called.
    """
    made = _attribute(name, key) if ":" in name else _entry_point(name, key)
    if not callable(made):
        raise ExecutorError("MP813", f"{key}: {name!r} cannot be called")
    return made  # type: ignore[no-any-return]  # what is behind a name is not known


def build(made: Callable[..., Any], key: str, options: Mapping[str, Any]) -> Any:
    """Return a driver made with its options; MP813 if that fails."""
    with _refused(key):
        return made(**options)


def part_of(hub: object, part: str, key: str) -> Any:
    """Return a hub's attribute, None if it has none; MP813 if asking for it fails."""
    with _refused(f"{key}.{part}"):
        return getattr(hub, part, None)


def check_role(device: object, role: str, key: str) -> None:
    """Raise MP813 if a device lacks what its role needs."""
    for name in ROLES[role]:
        if not _has(device, name, key):
            kind = type(device).__name__
            raise ExecutorError(
                "MP813", f"{key}: {kind} is no {role}, it has no {name}"
            )


def _has(device: object, name: str, key: str) -> bool:
    """Return whether a device has an attribute; MP813 if asking for it fails."""
    try:  # a property may ask the device itself
        return Caller().call(f"{key}.{name}", lambda: hasattr(device, name), ASK_S)
    except ExecutorError as error:
        raise ExecutorError("MP813", error.message) from error


def _attribute(name: str, key: str) -> Any:
    """Return an attribute of a module."""
    module, _, attribute = name.partition(":")
    if module.startswith("executor."):  # station files name our drivers without it
        module = f"microplan.{module}"
    with _refused(f"{key}: {name!r}"):
        found: Any = importlib.import_module(module)
        for part in attribute.split("."):
            found = getattr(found, part)
    return found


def _entry_point(name: str, key: str) -> Any:
    """Return what an entry point of the group names."""
    from importlib.metadata import entry_points  # slow, and only named drivers need it

    points = {point.name: point for point in entry_points(group=GROUP)}
    if name not in points:
        known = ", ".join(sorted(points)) or "none"
        raise ExecutorError(
            "MP813", f"{key}: no driver {name!r} in {GROUP}, installed: {known}"
        )
    with _refused(f"{key}: {name!r}"):
        return points[name].load()


@contextmanager
def _refused(what: str) -> Iterator[None]:
    """Report what a driver's own code raises, SystemExit too, as MP813.

    An interrupt is the operator's.
    """
    try:
        yield
    except (ExecutorError, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise ExecutorError("MP813", f"{what}: {reason(error)}") from error
