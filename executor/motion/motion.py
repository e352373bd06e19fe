"""Motion of all devices: checked before, watched meanwhile, stopped at a fault."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from microplan.executor.devices.drivers import AxisReading, Frame
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import (
    Phase,
    check_fingers,
    check_finite,
    check_opening,
    check_step,
    check_travel,
    targets,
)
from microplan.executor.devices.station import Station
from microplan.executor.devices.timeouts import Caller
from microplan.executor.motion.arrival import arrive
from microplan.executor.motion.device_calls import DeviceCalls
from microplan.schemas.plan import AxesName, AxisMove, Region


class Motion:
    """Moves a station's devices, one at a time, until the first fault.

    After a fault everything is stopped, and whatever is asked for later is refused with
    that same fault. Stopping neither opens nor closes the jaws and homes nothing.

    Parameters
    ----------
    pause : callable
        Called before and after every motion; it may wait, or raise MP860.
    caller : Caller or None
        Makes the calls of devices; None: each kind of trouble with its code.
    """

    def __init__(
        self,
        pause: Callable[[], None] = lambda: None,
        *,
        caller: Caller | None = None,
    ) -> None:
        self._caller = caller or Caller()
        self._pause = pause
        self._fault: ExecutorError | None = None

    def reading(self, station: Station, group: AxesName) -> AxisReading:
        """Return an axis group's reading; MP847 if a number is not finite."""
        with self._using(station) as devices:
            return devices.reading(group)[0]

    def opening(self, station: Station) -> float:
        """Return the jaws' reading, um; MP847 if it is not finite."""
        with self._using(station) as devices:
            return devices.opening_um()

    def magnification(self, station: Station) -> float:
        """Return the zoom's reading; MP847 if it is not finite."""
        with self._using(station) as devices:
            return devices.lens()[0]

    def rest(self, station: Station) -> None:
        """Stop everything and wait for rest; MP841, MP844, MP845 if it does not come.

        A drive that is stopped still has to brake.
        """
        with self._using(station) as devices:
            left = devices.stop()
            if left:
                raise ExecutorError("MP841", "not stopped: " + "; ".join(left))
            for name, device in devices.movers().items():
                devices.wait_until_still(name, device.moving, lambda: None)
            rules = station.rules
            station.clock.wait(max(rules.stage.dwell_s, rules.robot.dwell_s))

    def travel(self, station: Station, move: AxisMove, phase: Phase) -> None:
        """Move one axis group and wait until it has settled.

        Raises
        ------
        ExecutorError
            MP840, MP842, MP843, MP847 before anything moves; MP840, MP844..MP847 while
            it does; MP860 if the operator stops the run.
        """
        group, rules = move.axes, station.rules
        with self._moving(station) as devices:
            now, _ = devices.reading(group)
            target = targets(move)
            _check_move(devices, move, now, phase)
            axes = station.axes(group)
            speed = rules.speed(group, phase, move.speed_um_per_s)
            devices.call(
                f"{group}.start",
                lambda: axes.start(**target, speed_um_per_s=speed),
                late=axes.stop,
            )
            away = {a: abs(v - getattr(now, a)) for a, v in target.items()}
            seconds = rules.speeds(group).seconds(away, speed)
            arrive(station, group, lambda: devices.reading(group), now, target, seconds)

    def grip(self, station: Station, opening_um: float) -> float:
        """Move the jaws and return their reading; closing, they may rest on a part.

        Raises
        ------
        ExecutorError
            MP840, MP844, MP845, MP847; MP849 if they do not go where they were sent.
        """
        with self._moving(station) as devices:
            jaws, window_um = station.jaws(), station.rules.jaws_window_um
            check_opening(opening_um, station.offer.opening_um)
            before_um = devices.opening_um()
            devices.call("jaws.start", lambda: jaws.start(opening_um), late=jaws.stop)
            devices.wait_until_still("jaws", jaws.moving, devices.opening_um)
            after_um = devices.opening_um()
            _check_jaws(before_um, after_um, opening_um, window_um)
        return after_um

    def zoom(self, station: Station, magnification: float) -> None:
        """Set the magnification; MP844, MP845, MP847 if that does not work."""
        window = station.rules.zoom_window * abs(magnification)
        self._drive(station, "magnification", magnification, window)

    def focus(self, station: Station, focus_um: float) -> None:
        """Set the focus; MP844, MP845, MP847 if that does not work."""
        self._drive(station, "focus_um", focus_um, station.rules.focus_window_um)

    def _drive(self, station: Station, name: str, value: float, window: float) -> None:
        """Move zoom or focus and compare what it reads."""
        lens = station.lens
        which, start = {
            "magnification": (0, lens.start_magnification),
            "focus_um": (1, lens.start_focus_um),
        }[name]
        with self._moving(station) as devices:
            check_finite("lens", {name: value})
            within = getattr(station.offer, name)
            check_travel("lens", {name: value}, {f"lens.{name}": within})
            devices.call(f"lens.{name}", lambda: start(value), late=lens.stop)
            devices.wait_until_still(f"lens.{name}", lens.moving, devices.lens)
            found = devices.lens()[which]
            if not abs(found - value) <= window:
                raise ExecutorError(
                    "MP845", f"lens.{name} reads {found:.6g}, was sent to {value:.6g}"
                )

    def light(self, station: Station, level: float) -> None:
        """Set the light."""
        with self._using(station) as devices:
            check_finite("light", {"level": level})
            light = station.light
            devices.call("light.set_level", lambda: light.set_level(level))

    def grab(self, station: Station, region: Region | None) -> Frame:
        """Return a frame exposed from now on; MP848 if none comes."""
        with self._using(station) as devices:
            return devices.frame(region)

    def halt(self, station: Station, fault: ExecutorError) -> None:
        """Stop everything and refuse all that comes later, because of `fault`.

        What cannot be stopped is named in the fault's message.
        """
        if self._fault is None:
            self._fault = fault
            left = self.stop(station)
            if left:
                fault.append("NOT STOPPED: " + "; ".join(left))

    def stop(self, station: Station) -> list[str]:
        """Stop all devices at the same time; return what could not be stopped."""
        return DeviceCalls(station, self._caller).stop()

    @contextmanager
    def guarded(self, station: Station) -> Iterator[None]:
        """Refuse to begin after a fault; stop everything if one happens inside."""
        if self._fault is not None:
            raise self._fault
        try:
            yield
        except ExecutorError as fault:
            self.halt(station, fault)
            raise
        except BaseException:  # an interrupt falls anywhere
            self.stop(station)
            raise

    @contextmanager
    def _using(self, station: Station) -> Iterator[DeviceCalls]:
        """Give a station's devices, guarded."""
        with self.guarded(station):
            yield DeviceCalls(station, self._caller)

    @contextmanager
    def _moving(self, station: Station) -> Iterator[DeviceCalls]:
        """Give a station's devices for one motion; the operator may pause around it."""
        with self._using(station) as devices:
            self._pause()
            yield devices
            self._pause()


def _check_move(
    devices: DeviceCalls, move: AxisMove, now: AxisReading, phase: Phase
) -> None:
    """Refuse a move that its phase, the limits or the fingers' height forbid."""
    station, target = devices.station, targets(move)
    safety = station.rules.safety
    speed = {"speed_um_per_s": move.speed_um_per_s or 1.0}
    check_finite(move.axes, {**target, **speed})
    check_travel(move.axes, target, station.offer.travel)
    check_step(move, now, phase, safety.phase(phase))
    if move.z_um is None or station.gripper is None:
        return
    groups: tuple[AxesName, AxesName] = ("stage", "robot")
    stage, robot = (
        move.z_um if move.axes == group else devices.reading(group)[0].z_um
        for group in groups
    )
    surface_um = station.rules.stage_datum_z_um + stage
    check_fingers(robot, surface_um, phase, safety)


def _check_jaws(
    before_um: float, after_um: float, target_um: float, window_um: float
) -> None:
    """Raise MP849 unless the jaws went where they were sent, or onto a part."""
    if abs(after_um - target_um) <= window_um:
        return
    closing = target_um < before_um
    on_a_part = closing and target_um < after_um < before_um - window_um
    if not on_a_part:
        raise ExecutorError(
            "MP849",
            f"the jaws read {after_um:.6g} um, were told {target_um:.6g} um and were "
            f"at {before_um:.6g} um",
        )
