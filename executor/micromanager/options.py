"""Options of a Micro-Manager hub in a station file, read into drives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from microplan.executor.devices.tables import Table
from microplan.executor.micromanager.core import LoadedDevice, describe
from microplan.executor.micromanager.drives import (
    DeviceScale,
    Drive,
    Speed,
    StageDrive,
    XYDrive,
)
from microplan.executor.micromanager.exposure import MMLight
from microplan.executor.micromanager.movers import MMAxes, Moved
from microplan.executor.micromanager.paced import Paced
from microplan.executor.micromanager.properties import PropertyDrive, StateDrive

if TYPE_CHECKING:
    from pymmcore_plus import CMMCorePlus

M = TypeVar("M", bound=Moved)
HOLD_UM = 0.1  # more than any encoder's step, less than anyone moves a stage by hand


def loaded_devices(table: Table) -> list[LoadedDevice]:
    """Return the devices to load, by label."""
    found = []
    for label in table.names():
        row = table.table(label)
        found.append(
            LoadedDevice(
                label=label,
                adapter=row.text("adapter"),
                device=row.text("device"),
                before=_texts(row.table("before")),
                properties=_texts(row.table("properties")),
            )
        )
        row.finish()
    return found


def axes(core: CMMCorePlus, table: Table, role: str) -> MMAxes:
    """Return the drives of a stage or robot."""
    drives: list[Drive] = []
    if table.has("xy"):
        drives.append(_xy(core, table.table("xy")))
    for key, name in (("z", "z_um"), ("theta", "theta_rad")):
        if table.has(key):
            drives.append(drive(core, table.table(key), name))
    table.finish()
    if not drives:
        table.refuse("xy", "no axis at all", "allowed: xy, z, theta")
    return moved(MMAxes, core, role, drives)


def moved(kind: type[M], core: CMMCorePlus, role: str, drives: list[Drive]) -> M:
    """Return drives as one device, named by what is behind them."""
    model = ", ".join(describe(core, drive.label) for drive in drives)
    labels = "+".join(drive.label for drive in drives)
    return kind(model, f"{role} {labels}", drives)


def drive(core: CMMCorePlus, table: Table, name: str) -> Drive:
    """Return the drive of one number: a stage device, a property, or states.

    Angles are in degrees in the file, and in rad outside of it.
    """
    label = table.text("device")
    unit = math.radians(1.0) if name == "theta_rad" else 1.0
    if table.has("states"):
        states = _states(table)
        table.finish()
        return StateDrive(core, label, name, states)
    low, high = table.interval("limits")
    limits = (low * unit, high * unit)
    scale = DeviceScale(
        zero=unit * table.number("zero", 0.0), per=unit * _not_0(table, "per", 1.0)
    )
    property_name = table.text("property", "")
    speed, paced = _speed(table, unit)
    table.finish()
    made = StageDrive(core, label, name, limits, scale, speed)
    if property_name:
        made = PropertyDrive(core, label, name, limits, scale, speed, property_name)
    return Paced(made, own_per_s=speed.own_per_s) if paced else made


def light(core: CMMCorePlus, table: Table) -> MMLight:
    """Return the light."""
    shutter, label = table.text("shutter", ""), table.text("device", "")
    if not (label or shutter):
        table.refuse("device", "it is missing", "a device or a shutter is needed")
    property_name = table.text("property") if label else ""
    full = _not_0(table, "full", 1.0)
    table.finish()
    return MMLight(core, label, property_name, full=full, shutter=shutter)


def _xy(core: CMMCorePlus, table: Table) -> Drive:
    """Return the drive of x and y."""
    limits = {name: table.interval(f"limits_{name}") for name in XYDrive.names}
    zero, per = table.pair("zero_um", (0.0, 0.0)), table.pair("per", (1.0, 1.0))
    if 0.0 in per:
        table.refuse("per", f"found {list(per)}", "it must not be 0")
    scales = {
        name: DeviceScale(zero=a, per=b)
        for name, a, b in zip(XYDrive.names, zero, per, strict=True)
    }
    speed, paced = _speed(table, 1.0)
    made = XYDrive(
        core,
        table.text("device"),
        limits=limits,
        scales=scales,
        speed=speed,
        hold_um=table.number("hold_um", HOLD_UM, least=0),
    )
    table.finish()
    return Paced(made, own_per_s=speed.own_per_s) if paced else made


def _speed(table: Table, unit: float) -> tuple[Speed, bool]:
    """Return how the speed is ordered, and whether the drive is to be paced."""
    own_per_s = unit * table.number("speed", above=0)
    paced = _flag(table, "paced")
    if not table.has("speed_property"):
        return Speed(own_per_s=own_per_s), paced
    if paced:
        table.refuse("paced", "found true", "not beside speed_property")
    name, per = table.text("speed_property"), _not_0(table, "speed_per", 1.0)
    return Speed(own_per_s=own_per_s, name=name, per=per / unit), False


def _flag(table: Table, name: str) -> bool:
    """Return a yes or no; no if it is left out."""
    value = table.value(name) if table.has(name) else False
    if not isinstance(value, bool):
        table.refuse(name, f"found {value!r}", "allowed: true, false")
        return False
    return value


def _not_0(table: Table, name: str, default: float) -> float:
    """Return a number that one can divide by."""
    value = table.number(name, default)
    if value == 0:
        table.refuse(name, "found 0", "it must not be 0")
    return value


def _states(table: Table) -> Mapping[float, int]:
    """Return states by their value, from pairs [value, state]."""
    found: dict[float, int] = {}
    rows = table.value("states")
    if not isinstance(rows, list) or not rows:
        table.refuse("states", f"found {rows!r}", "pairs [value, state] are needed")
        return found
    for row in rows:
        value, state = _pair(table, row)
        if value in found or state in found.values():
            table.refuse("states", f"found {row!r}", "each value and state once")
        found[value] = state
    return found


def _pair(table: Table, row: Any) -> tuple[float, int]:
    """Return one value and its state."""
    value, state = row if isinstance(row, list) and len(row) == 2 else (None, None)
    real = isinstance(value, int | float) and not isinstance(value, bool)
    if value is None or not real or type(state) is not int or state < 0:
        table.refuse("states", f"found {row!r}", "pairs [value, state] are needed")
        return (0.0, 0)
    return (float(value), state)


def _texts(table: Table) -> dict[str, str]:
    """Return properties as texts, which is what Micro-Manager takes."""
    found = {}
    for name in table.names():
        value = table.value(name)
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            table.refuse(name, f"found {value!r}", "a text or a number is needed")
        found[name] = str(value)
    return found
