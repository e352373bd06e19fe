"""Calls of a station's devices, each within a time limit, each answer checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from microplan.executor.devices.device_values import (
    as_frame,
    as_number,
    as_pair,
    as_reading,
    as_truth,
)
from microplan.executor.devices.drivers import AxisReading, Frame, Mover
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import AXES, check_finite
from microplan.executor.devices.station import Station
from microplan.executor.devices.timeouts import Caller, call_all
from microplan.executor.motion.arrival import SHORTEST_S
from microplan.schemas.plan import AxesName, Region

T = TypeVar("T")

FRAMES = 3  # a frame that was dropped or is old is asked for again so often, in all


@dataclass(frozen=True, slots=True)
class DeviceCalls:
    """Calls of one station's devices; MP841, MP844, MP847 where an answer is no use."""

    station: Station
    caller: Caller

    def call(
        self,
        name: str,
        call: Callable[[], T],
        late: Callable[[], None] | None = None,
    ) -> T:
        """Make a device call within the station's limit, as `Caller.call` does."""
        return self.caller.call(name, call, self.station.rules.safety.call_s, late)

    def reading(self, group: AxesName) -> tuple[AxisReading, bool]:
        """Return an axis group's reading, and whether it reports motion."""
        axes = self.station.axes(group)
        name = f"{group}.reading"

        def ask() -> tuple[AxisReading, bool]:
            reading, moving = axes.reading(), axes.moving()
            return (
                as_reading(name, reading),
                as_truth(f"{group}.moving", moving),
            )

        found = self.call(name, ask)
        check_finite(group, {axis: getattr(found[0], axis) for axis in AXES})
        return found

    def opening_um(self) -> float:
        """Return the jaws' reading."""
        name = "jaws.reading"
        found = as_number(name, self.call(name, self.station.jaws().reading))
        check_finite("jaws", {"opening_um": found})
        return found

    def lens(self) -> tuple[float, float]:
        """Return magnification and focus (um) as the lens reads them."""
        name = "lens.reading"
        zoom, focus_um = as_pair(name, self.call(name, self.station.lens.reading))
        check_finite("lens", {"magnification": zoom, "focus_um": focus_um})
        return zoom, focus_um

    def wait_until_still(
        self, name: str, moving: Callable[[], bool], read: Callable[[], object]
    ) -> None:
        """Wait until a drive reports no motion; its reading is checked meanwhile."""
        clock, rules = self.station.clock, self.station.rules
        limit_s, began_s = rules.drive_timeout_s, clock.now_s()
        asked = f"{name}.moving"
        while as_truth(asked, self.call(asked, moving)):
            read()
            if clock.now_s() - began_s > limit_s:
                raise ExecutorError(
                    "MP845", f"{name} moves for more than {limit_s:g} s"
                )
            clock.wait(max(rules.safety.poll_s, SHORTEST_S))

    def frame(self, region: Region | None) -> Frame:
        """Return a frame exposed from now on; MP848 if none comes."""
        after_s, why = self.station.clock.now_s(), ""
        for _ in range(FRAMES):
            try:
                frame = self._frame(region, after_s)
            except ExecutorError as error:
                if not isinstance(error.__cause__, TimeoutError):
                    raise
                why = error.message
                continue
            if after_s <= frame.exposed_s <= self.station.clock.now_s():
                return frame
            why = (
                f"a frame was exposed at {frame.exposed_s:.6g} s, asked for after "
                f"{after_s:.6g} s"
            )
        raise ExecutorError("MP848", f"{FRAMES} frames were no use: {why}")

    def _frame(self, region: Region | None, after_s: float) -> Frame:
        """Return what the camera gives."""
        camera, limit_s = self.station.camera, self.station.rules.safety.grab_s
        frame = self.caller.call(
            "camera.grab",
            lambda: as_frame("camera.grab", camera.grab(region, after_s=after_s)),
            limit_s,
        )
        check_finite("camera", {"exposed_s": frame.exposed_s})
        return frame

    def stop(self) -> list[str]:
        """Stop all devices at the same time; return what could not be stopped.

        A motion whose order was given up may begin after that: its own stop is waited
        for.
        """
        calls = ((f"{n}.stop", d.stop) for n, d in self.movers().items())
        limit_s = self.station.rules.safety.call_s
        return [*call_all(calls, limit_s), *self.caller.settle(limit_s)]

    def movers(self) -> dict[str, Mover]:
        """Return the moving devices by name."""
        station = self.station
        named = {
            "stage": station.stage,
            "robot": station.robot,
            "jaws": station.gripper,
            "lens": station.lens,
        }
        return {name: device for name, device in named.items() if device is not None}
