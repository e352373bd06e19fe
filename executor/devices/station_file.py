"""Station files, station.toml: devices, what they offer, the rules for them.

A name that is too long, a loop of links and a folder without permission raise in
`pathlib`. What is wrong is reported when the path is opened.
"""

from __future__ import annotations

import itertools
import math
import stat
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from microplan.executor.devices.calibration import Calibration, ZoomPoint
from microplan.executor.devices.device_values import CheckedClock
from microplan.executor.devices.errors import ExecutorError, meant, why
from microplan.executor.devices.loading import ROLES
from microplan.executor.devices.safety import (
    PHASES,
    Phase,
    PhaseLimit,
    Rules,
    Safety,
    Settle,
    Speeds,
)
from microplan.executor.devices.station import Offer, Station
from microplan.executor.devices.tables import Mistakes, Table
from microplan.executor.devices.timeouts import WallClock
from microplan.executor.devices.toml_lines import key_lines
from microplan.executor.devices.wiring import driver_of, source_of


def is_file(path: Path) -> bool:
    """Return whether a path leads to a file."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_folder(path: Path) -> bool:
    """Return whether a path leads to a folder."""
    try:
        return path.is_dir()
    except OSError:
        return False


def exists(path: Path) -> bool:
    """Return whether a path leads to anything."""
    return is_file(path) or is_folder(path)


def stays_in(path: Path, folder: Path) -> bool:
    """Return whether a path leads into a folder, links followed."""
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):  # NUL in a name; a loop of links
        return False


FORMAT = 1
LENGTHS = ("x_um", "y_um", "z_um")
LONGEST_S = 3600.0  # nothing that a station waits for takes longer
BLIND_S = 1.0  # longest time between two readings of a moving axis
NEEDED = ("stage", "lens", "light", "camera")  # robot and jaws may be missing


@dataclass(frozen=True, slots=True, kw_only=True)
class Loaded:
    """A station as its file describes it; `hubs` are what serves several devices."""

    name: str
    source: bytes  # the file as it was read
    station: Station
    hubs: Mapping[str, Any]


def read_station(path: Path, plan_folder: Path) -> Loaded:
    """Return the station of a file, its drivers loaded and built.

    In a driver's options "{plan}" means the plan folder and "{station}" the
    folder of the station file.

    Raises
    ------
    ExecutorError
        MP812 with file, line, key, what was found and what is allowed, about every
        mistake of the file; MP813 if a driver cannot be loaded.
    """
    source, data = _parsed(path)
    mistakes = Mistakes(file=str(path), lines=key_lines(_text(source)))
    top = Table(str(path), "", data, mistakes)
    version = top.whole("microplan_station")
    if version != FORMAT:
        top.refuse("microplan_station", f"found {version}", f"allowed: {FORMAT}")
    name = top.text("name")
    folders = {"{plan}": str(plan_folder), "{station}": str(path.parent)}
    # what the file says is checked before any driver is touched
    wanted = top.table("devices")
    roles = _roles(wanted)
    offer, rules = _offer(top, roles), _rules(top, roles)
    hub_tables = top.table("hubs")
    hubs_wanted = {
        hub: driver_of(hub_tables.table(hub), folders) for hub in hub_tables.names()
    }
    devices_wanted = {
        role: source_of(wanted.table(role), role, tuple(hubs_wanted), folders)
        for role in roles
    }
    top.finish()
    mistakes.check()
    hubs = {hub: asked.made() for hub, asked in hubs_wanted.items()}
    devices = {role: asked.device(role, hubs) for role, asked in devices_wanted.items()}
    clock = devices.get("clock")
    station = Station(
        stage=devices["stage"],
        robot=devices.get("robot"),
        gripper=devices.get("jaws"),
        lens=devices["lens"],
        light=devices["light"],
        camera=devices["camera"],
        clock=WallClock() if clock is None else CheckedClock(clock),
        offer=offer,
        rules=rules,
    )
    return Loaded(name=name, source=source, station=station, hubs=hubs)


def _parsed(path: Path) -> tuple[bytes, dict[str, Any]]:
    """Return the file's bytes and its data."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # a pipe is read once, and not locked
            raise ExecutorError("MP812", f"{path}: it is no file", place=path)
        source = path.read_bytes()
        return source, tomllib.loads(_text(source))
    except (OSError, ValueError) as error:  # so are faults of UTF-8, TOML, digits
        raise ExecutorError("MP812", f"{path}: {why(error)}", place=path) from error
    except RecursionError as error:
        raise ExecutorError("MP812", f"{path}: nested too deep", place=path) from error


def _text(source: bytes) -> str:
    """Return the text of a file."""
    return source.decode("utf-8").replace("\r\n", "\n")


def _roles(wanted: Table) -> tuple[str, ...]:
    """Return the roles of the devices; others, and needed ones missing, are refused."""
    names = tuple(wanted.names())
    absent = set(ROLES) - set(names)
    for name in names:
        if name not in ROLES:
            known = "allowed: " + ", ".join(ROLES)
            wanted.refuse(name, f"no such device{meant(name, absent)}", known)
            absent = {role for role in absent if not meant(name, (role,))}
    for role in NEEDED:
        if role in absent:
            wanted.lacks(role, "a table is needed")
    return tuple(name for name in names if name in ROLES)


def _offer(top: Table, roles: tuple[str, ...]) -> Offer:
    """Return what the devices can do."""
    camera, lens = top.table("camera"), top.table("lens")
    jaws = top.table("jaws") if "jaws" in roles else None
    groups = [g for g in ("stage", "robot") if g in roles]
    travel = {k: v for g in groups for k, v in _travel(top.table(g), g).items()}
    offer = Offer(
        width_px=camera.whole("width_px"),
        height_px=camera.whole("height_px"),
        pitch_um=camera.number("pitch_um", above=0),
        bits=camera.whole("bits"),
        latency_frames=camera.whole("latency_frames", 0, least=0),
        magnification=lens.interval("magnification"),
        focus_um=lens.interval("focus_um"),
        opening_um=None if jaws is None else jaws.interval("opening_um"),
        travel=travel,
        theta_axis_um=top.table("stage").pair("theta_axis_um"),
        calibration=_calibration(top.table("calibration")),
    )
    camera.finish()
    return offer


def _travel(group: Table, name: str) -> dict[str, tuple[float, float]]:
    """Return the limits of one axis group, angles in rad."""
    limits = group.table("limits")
    found = {f"{name}.{a}": limits.interval(a) for a in LENGTHS if limits.has(a)}
    if limits.has("theta_deg"):
        low, high = limits.interval("theta_deg")
        found[f"{name}.theta_rad"] = (math.radians(low), math.radians(high))
    limits.finish()
    return found


def _calibration(table: Table) -> Calibration:
    """Return scale, shift and handedness."""
    points = []
    for row in table.tables("zooms"):
        points.append(
            ZoomPoint(
                magnification=row.number("magnification", above=0),
                um_per_px=row.number("um_per_px", above=0),
                shift_um=row.pair("shift_um", (0.0, 0.0)),
            )
        )
        row.finish()
    rising = [point.magnification for point in points]
    if any(b <= a for a, b in itertools.pairwise(rising)):
        table.refuse("zooms", f"found {rising}", "magnifications must rise")
    matrix = table.matrix("camera_from_stage")
    (a, b), (c, d) = matrix
    if a * d == b * c:
        table.refuse("camera_from_stage", f"found {matrix}", "it must be invertible")
    table.finish()
    return Calibration(zooms=tuple(points), camera_from_stage=matrix)


def _rules(top: Table, roles: tuple[str, ...]) -> Rules:
    """Return how the devices settle, their speeds and their limits by phase."""
    stage, lens = top.table("stage"), top.table("lens")
    robot, jaws = top.table("robot"), top.table("jaws")
    rules = Rules(
        stage=_settle(stage.table("settle")),
        robot=_settle(robot.table("settle")),
        stage_speeds=_speeds(stage.table("speeds"), needed=True),
        robot_speeds=_speeds(robot.table("speeds"), needed="robot" in roles),
        stage_datum_z_um=stage.number("datum_z_um"),
        jaws_window_um=jaws.number("window_um", 0.5, above=0),
        focus_window_um=lens.number("focus_window_um", 0.1, above=0),
        zoom_window=lens.number("zoom_window", 1e-3, above=0),
        drive_timeout_s=lens.number("timeout_s", 20.0, above=0, most=LONGEST_S),
        safety=_safety(top.table("safety")),
    )
    for table, read in (
        (stage, ()),
        (robot, ("limits",)),  # there may be no robot that has them
        (lens, ()),
        (jaws, ("opening_um",)),
    ):
        for name in read:
            table.has(name)
        table.finish()
    return rules


def _settle(table: Table) -> Settle:
    """Return when an axis group has arrived."""
    usual = Settle()
    window_deg = table.number("window_deg", math.degrees(usual.window_rad), above=0)
    found = Settle(
        window_um=table.number("window_um", usual.window_um, above=0),
        window_rad=math.radians(window_deg),
        dwell_s=table.number("dwell_s", usual.dwell_s, least=0, most=LONGEST_S),
        timeout_s=table.number("timeout_s", usual.timeout_s, above=0, most=LONGEST_S),
        stall_s=table.number("stall_s", usual.stall_s, above=0, most=LONGEST_S),
    )
    table.finish()
    return found


def _speeds(table: Table, *, needed: bool) -> Speeds:
    """Return how fast an axis group goes by itself."""
    missing = None if needed else math.inf
    found = Speeds(
        xy_um_per_s=table.number("xy_um_per_s", missing, above=0),
        z_um_per_s=table.number("z_um_per_s", missing, above=0),
        theta_rad_per_s=math.radians(table.number("theta_deg_per_s", missing, above=0)),
    )
    table.finish()
    return found


def _safety(table: Table) -> Safety:
    """Return the limits by phase, the fingers' margin and the watchdog's times."""
    usual = Safety()
    close = table.texts("close_phases", PHASES)
    found = Safety(
        phases={phase: _phase(table.table(phase)) for phase in PHASES},
        fingers_above_stage_um=table.number("fingers_above_stage_um", least=0),
        close_phases=usual.close_phases
        if close is None
        else cast("tuple[Phase, ...]", close),
        call_s=table.number("call_s", usual.call_s, above=0, most=LONGEST_S),
        grab_s=table.number("grab_s", usual.grab_s, above=0, most=LONGEST_S),
        poll_s=table.number("poll_s", usual.poll_s, above=0, most=BLIND_S),
    )
    table.finish()
    return found


def _phase(table: Table) -> PhaseLimit:
    """Return the limits of one phase; what is left out has none."""
    step_rad = math.radians(table.number("step_deg", math.inf, above=0))
    found = PhaseLimit(
        step_um=table.number("step_um", math.inf, above=0),
        step_rad=step_rad,
        speed_um_per_s=table.number("speed_um_per_s", math.inf, above=0),
    )
    table.finish()
    return found
