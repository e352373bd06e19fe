"""Where a station's devices come from: drivers of their own, or parts of hubs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from microplan.executor.devices.errors import ExecutorError, meant
from microplan.executor.devices.loading import build, check_role, load, part_of
from microplan.executor.devices.tables import Table


@dataclass(frozen=True, slots=True, kw_only=True)
class DriverOfTable:
    """A driver as its table asks for it."""

    key: str
    place: str  # of its name in the file
    driver: str
    options: Mapping[str, Any]

    def made(self) -> Any:
        """Return what the driver's name leads to, made with its options."""
        with _pointing(self.place):
            return build(load(self.driver, self.key), self.key, self.options)

    def device(self, role: str, _hubs: Mapping[str, Any]) -> Any:
        """Return a device of its own."""
        device = self.made()
        with _pointing(self.place):
            check_role(device, role, self.key)
        return device


@dataclass(frozen=True, slots=True, kw_only=True)
class HubPart:
    """A part of a hub as a device's table asks for it."""

    key: str
    place: str
    hub: str
    part: str

    def device(self, role: str, hubs: Mapping[str, Any]) -> Any:
        """Return the hub's part."""
        with _pointing(self.place):
            device = part_of(hubs[self.hub], self.part, self.key)
            if device is None:
                raise ExecutorError(
                    "MP813", f"{self.key}: hub {self.hub!r} has no {self.part!r}"
                )
            check_role(device, role, self.key)
        return device


@contextmanager
def _pointing(place: str) -> Iterator[None]:
    """Let MP813 point at a place in the file."""
    try:
        yield
    except ExecutorError as error:
        if error.code == "MP813" and error.place is None:
            error.place = place
        raise


def driver_of(table: Table, folders: Mapping[str, str]) -> DriverOfTable:
    """Return the driver of a table; the rest of its keys are the driver's options."""
    driver = table.text("driver")
    options = {k: _filled(v, folders) for k, v in table.rest().items()}
    return DriverOfTable(
        key=table.path(""),
        place=table.place("driver"),
        driver=driver,
        options=options,
    )


def _filled(value: Any, folders: Mapping[str, str]) -> Any:
    """Return an option with the names of folders filled in."""
    if isinstance(value, str):
        for name, folder in folders.items():
            value = value.replace(name, folder)
    return value


def source_of(
    table: Table, role: str, hubs: tuple[str, ...], folders: Mapping[str, str]
) -> DriverOfTable | HubPart:
    """Return where one device comes from: its own driver, or a part of a hub."""
    if not table.has("hub"):
        return driver_of(table, folders)
    hub = table.text("hub")
    if hub and hub not in hubs:
        known = ", ".join(hubs) or "none"
        table.refuse("hub", f"found {hub!r}{meant(hub, hubs)}", f"allowed: {known}")
    part = table.text("part", role)
    table.finish()
    return HubPart(key=table.path(""), place=table.place("hub"), hub=hub, part=part)
