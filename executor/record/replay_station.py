"""A station whose devices answer from the record of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from microplan.executor.devices.drivers import AxisReading, Frame
from microplan.executor.devices.errors import ExecutorError, failing
from microplan.executor.devices.safety import AXES, Rules
from microplan.executor.devices.station import Offer, Station
from microplan.executor.devices.station_file import stays_in
from microplan.executor.record.frames import read_png, region_data
from microplan.executor.record.recorded_calls import CallReplay, numbers
from microplan.executor.record.recording import pixels_sha256
from microplan.schemas.codec import CodecError, from_data
from microplan.schemas.plan import Region


def replay_station(calls: CallReplay, *, anyway: bool = False) -> Station:
    """Return a station whose devices answer from a recording.

    Raises
    ------
    ExecutorError
        MP877 if the record does not hold what the station offered.
    """
    head = calls.recorded.head
    devices = head.get("devices")
    if not isinstance(devices, dict):
        raise ExecutorError("MP877", "the record names no devices")
    try:
        offer = from_data(Offer, head.get("offer"))
        rules = from_data(Rules, head.get("rules"))
    except CodecError as error:
        raise ExecutorError("MP877", f"the record's station: {error}") from error
    return Station(
        stage=ReplayAxes(calls, "stage"),
        robot=ReplayAxes(calls, "robot") if "robot" in devices else None,
        gripper=ReplayJaws(calls, "jaws") if "jaws" in devices else None,
        lens=ReplayLens(calls, "lens"),
        light=ReplayLight(calls, "light"),
        camera=ReplayCamera(calls, "camera", anyway=anyway),
        clock=ReplayClock(calls),
        offer=offer,
        rules=rules,
    )


class _ReplayDevice:
    """A device that answers from a recording."""

    def __init__(self, calls: CallReplay, name: str) -> None:
        self._calls, self._name = calls, name
        self.model, self.serial = f"recorded {name}", str(calls.recorded.folder)

    def moving(self) -> bool:
        """Return whether the device reported motion."""
        return bool(self._calls.query(f"{self._name}.moving"))

    def stop(self) -> None:
        """Do nothing: nothing moves."""

    def _order(self, method: str, **given: Any) -> Mapping[str, Any]:
        """Compare a command with the record; return its row."""
        return self._calls.command(f"{self._name}.{method}", given)


class ReplayAxes(_ReplayDevice):
    """A stage or robot; see `microplan.executor.devices.drivers.Axes`."""

    def start(self, **targets: float | None) -> None:
        """Compare a motion with the recorded one."""
        self._order("start", **targets)

    def reading(self) -> AxisReading:
        """Return the recorded reading."""
        name = f"{self._name}.reading"
        values = numbers(self._calls.query(name), len(AXES), name)
        return AxisReading(**dict(zip(AXES, values, strict=True)))


class ReplayJaws(_ReplayDevice):
    """Jaws; see `microplan.executor.devices.drivers.Gripper`."""

    def start(self, opening_um: float) -> None:
        """Compare an opening with the recorded one."""
        self._order("start", value=opening_um)

    def reading(self) -> float:
        """Return the recorded opening, um."""
        name = f"{self._name}.reading"
        return numbers([self._calls.query(name)], 1, name)[0]


class ReplayLens(_ReplayDevice):
    """Zoom and focus; see `microplan.executor.devices.drivers.Lens`."""

    def start_magnification(self, magnification: float) -> None:
        """Compare a zoom with the recorded one."""
        self._order("start_magnification", value=magnification)

    def start_focus_um(self, focus_um: float) -> None:
        """Compare a focus with the recorded one."""
        self._order("start_focus_um", value=focus_um)

    def reading(self) -> tuple[float, float]:
        """Return recorded magnification and focus (um)."""
        name = f"{self._name}.reading"
        zoom, focus_um = numbers(self._calls.query(name), 2, name)
        return (zoom, focus_um)


class ReplayLight(_ReplayDevice):
    """The light; see `microplan.executor.devices.drivers.Light`."""

    def set_level(self, level: float) -> None:
        """Compare a brightness with the recorded one."""
        self._order("set_level", value=level)


class ReplayCamera(_ReplayDevice):
    """The camera; see `microplan.executor.devices.drivers.Camera`."""

    def __init__(self, calls: CallReplay, name: str, *, anyway: bool) -> None:
        super().__init__(calls, name)
        self._anyway = anyway

    def grab(self, region: Region | None = None, *, after_s: float) -> Frame:
        """Return the recorded frame; MP877 if it is missing or was changed."""
        row = self._order("grab", region=region_data(region), after_s=after_s)
        gave = row.get("gave")
        if not isinstance(gave, dict) or not isinstance(gave.get("frame"), str):
            raise ExecutorError("MP877", f"call {row['n']} of the record has no frame")
        folder = self._calls.recorded.folder
        path = folder / gave["frame"]
        if not stays_in(path, folder):
            raise ExecutorError("MP877", f"{gave['frame']} leaves the run folder")
        with failing("MP877", path):
            counts = read_png(path)
        if pixels_sha256(counts) != gave.get("sha256") and not self._anyway:
            raise ExecutorError("MP877", f"{path} is not the frame that was recorded")
        exposed_s = numbers([gave.get("exposed_s")], 1, "camera.grab")[0]
        return Frame(counts=counts, exposed_s=exposed_s)


class ReplayClock:
    """The recorded time; see `microplan.executor.devices.drivers.Clock`."""

    def __init__(self, calls: CallReplay) -> None:
        self._calls = calls

    def now_s(self) -> float:
        """Return seconds as they were recorded."""
        return self._calls.now_s()

    def wait(self, seconds: float) -> None:
        """Return at once."""
        self._calls.wait(seconds)
