"""Everything that moves, moves through here: checked, watched, stopped at a fault."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from executor.answers import as_frame, as_number, as_pair, as_reading, as_truth
from executor.arrival import SHORTEST_S, arrive
from executor.calls import Caller, call_all
from executor.drivers import AxisReading, Frame, Mover
from executor.errors import ExecutorError
from executor.safety import (
    AXES,
    Phase,
    check_fingers,
    check_finite,
    check_opening,
    check_step,
    check_travel,
    targets,
)
from executor.station import Station
from schemas.plan import AxesName, AxisMove, Region

T = TypeVar("T")

FRAMES = 3  # a frame that was dropped or is old is asked for again so often, in all


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
        """Return where an axis group is; MP847 if a number is not finite."""
        with self.guarded(station):
            return self._reading(station, group)[0]

    def opening(self, station: Station) -> float:
        """Return what the jaws read, um; MP847 if it is not finite."""
        with self.guarded(station):
            return self._opening(station)

    def magnification(self, station: Station) -> float:
        """Return what the zoom reads; MP847 if it is not finite."""
        with self.guarded(station):
            return self._lens(station, 0)

    def rest(self, station: Station) -> None:
        """Stop everything and wait until it stands; MP841, MP844, MP845 if it does not.

        A drive that is stopped still takes its way to a stand.
        """
        with self.guarded(station):
            left = self.stop(station)
            if left:
                raise ExecutorError("MP841", "not stopped: " + "; ".join(left))
            for name, device in _movers(station).items():
                self._wait_until_still(station, name, device.moving, lambda _: 0.0)
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
        with self.guarded(station):
            self._pause()
            now, _ = self._reading(station, move.axes)
            target = targets(move)
            self._check(station, move, now, phase)
            axes, rules = station.axes(move.axes), station.rules
            speed = rules.speed(move.axes, phase, move.speed_um_per_s)
            self._call(
                station,
                f"{move.axes}.start",
                lambda: axes.start(**target, speed_um_per_s=speed),
                late=axes.stop,
            )
            away = {a: abs(v - getattr(now, a)) for a, v in target.items()}
            seconds = rules.speeds(move.axes).seconds(away, speed)

            def read() -> tuple[AxisReading, bool]:
                return self._reading(station, move.axes)

            arrive(station, move.axes, read, now, target, seconds)
            self._pause()

    def grip(self, station: Station, opening_um: float) -> float:
        """Move the jaws and return their reading; closing, they may rest on a part.

        Raises
        ------
        ExecutorError
            MP840, MP844, MP845, MP847; MP849 if they do not go where they were told.
        """
        with self.guarded(station):
            self._pause()
            jaws, window_um = station.jaws(), station.rules.jaws_window_um
            check_opening(opening_um, station.offer.opening_um)
            before_um = self._opening(station)
            self._call(
                station, "jaws.start", lambda: jaws.start(opening_um), late=jaws.stop
            )
            self._wait_until_still(station, "jaws", jaws.moving, self._opening)
            after_um = self._opening(station)
            _check_jaws(before_um, after_um, opening_um, window_um)
            self._pause()
            return after_um

    def zoom(self, station: Station, magnification: float) -> None:
        """Set the magnification; MP844, MP845, MP847 if that does not work."""
        window = station.rules.zoom_window * abs(magnification)
        start = station.lens.start_magnification
        self._drive(station, 0, "magnification", start, magnification, window)

    def focus(self, station: Station, focus_um: float) -> None:
        """Set the focus; MP844, MP845, MP847 if that does not work."""
        window = station.rules.focus_window_um
        start = station.lens.start_focus_um
        self._drive(station, 1, "focus_um", start, focus_um, window)

    def light(self, station: Station, level: float) -> None:
        """Set the light."""
        with self.guarded(station):
            check_finite("light", {"level": level})
            light = station.light
            self._call(station, "light.set_level", lambda: light.set_level(level))

    def grab(self, station: Station, region: Region | None) -> Frame:
        """Return a frame exposed from now on; MP848 if none comes."""
        with self.guarded(station):
            after_s, why = station.clock.now_s(), ""
            for _ in range(FRAMES):
                try:
                    frame = self._frame(station, region, after_s)
                except ExecutorError as error:
                    if not isinstance(error.__cause__, TimeoutError):
                        raise
                    why = error.message
                    continue
                if after_s <= frame.exposed_s <= station.clock.now_s():
                    return frame
                why = (
                    f"a frame was exposed at {frame.exposed_s:.6g} s, asked for after "
                    f"{after_s:.6g} s"
                )
            raise ExecutorError("MP848", f"{FRAMES} frames were no use: {why}")

    def halt(self, station: Station, fault: ExecutorError) -> None:
        """Stop everything and refuse all that comes later, because of `fault`.

        What cannot be stopped is told in the fault's message.
        """
        if self._fault is None:
            self._fault = fault
            left = self.stop(station)
            if left:
                fault.append("NOT STOPPED: " + "; ".join(left))

    def stop(self, station: Station) -> list[str]:
        """Stop all devices at the same time; return what could not be stopped.

        A motion whose order was given up may begin after that: its own stop is waited
        for.
        """
        calls = ((f"{n}.stop", d.stop) for n, d in _movers(station).items())
        limit_s = station.rules.safety.call_s
        return [*call_all(calls, limit_s), *self._caller.settle(limit_s)]

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

    def _call(
        self,
        station: Station,
        name: str,
        call: Callable[[], T],
        late: Callable[[], None] | None = None,
    ) -> T:
        """Make a device call within the station's limit."""
        return self._caller.call(name, call, station.rules.safety.call_s, late)

    def _reading(self, station: Station, group: AxesName) -> tuple[AxisReading, bool]:
        """Return where an axis group is, and whether it says that it moves."""
        axes = station.axes(group)
        name = f"{group}.reading"

        def ask() -> tuple[AxisReading, bool]:
            reading, moving = axes.reading(), axes.moving()
            return (
                as_reading(name, reading),
                as_truth(f"{group}.moving", moving),
            )

        found = self._call(station, name, ask)
        check_finite(group, {axis: getattr(found[0], axis) for axis in AXES})
        return found

    def _check(
        self, station: Station, move: AxisMove, now: AxisReading, phase: Phase
    ) -> None:
        """Refuse a move that its phase, the limits or the fingers' height forbid."""
        target, rules = targets(move), station.rules
        speed = {"speed_um_per_s": move.speed_um_per_s or 1.0}
        check_finite(move.axes, {**target, **speed})
        check_travel(move.axes, target, station.offer.travel)
        check_step(move, now, phase, rules.safety.phase(phase))
        if move.z_um is None or station.gripper is None:
            return
        stage, robot = (
            move.z_um if move.axes == group else self._reading(station, group)[0].z_um
            for group in ("stage", "robot")
        )
        surface_um = rules.stage_datum_z_um + stage
        check_fingers(robot, surface_um, phase, rules.safety)

    def _drive(
        self,
        station: Station,
        which: int,
        name: str,
        start: Callable[[float], None],
        value: float,
        window: float,
    ) -> None:
        """Move zoom or focus and compare what it reads."""
        lens = station.lens
        with self.guarded(station):
            self._pause()
            check_finite("lens", {name: value})
            within = getattr(station.offer, name)
            check_travel("lens", {name: value}, {f"lens.{name}": within})
            self._call(station, f"lens.{name}", lambda: start(value), late=lens.stop)

            def read(station: Station) -> float:
                return self._lens(station, which)

            self._wait_until_still(station, f"lens.{name}", lens.moving, read)
            found = read(station)
            if not abs(found - value) <= window:
                raise ExecutorError(
                    "MP845", f"lens.{name} reads {found:.6g}, was sent to {value:.6g}"
                )
            self._pause()

    def _wait_until_still(
        self,
        station: Station,
        name: str,
        moving: Callable[[], bool],
        read: Callable[[Station], float],
    ) -> None:
        """Wait until a drive says that it stands; its reading is checked meanwhile."""
        clock, limit_s = station.clock, station.rules.drive_timeout_s
        began_s = clock.now_s()
        asked = f"{name}.moving"
        while as_truth(asked, self._call(station, asked, moving)):
            read(station)
            if clock.now_s() - began_s > limit_s:
                raise ExecutorError(
                    "MP845", f"{name} moves for more than {limit_s:g} s"
                )
            clock.wait(max(station.rules.safety.poll_s, SHORTEST_S))

    def _opening(self, station: Station) -> float:
        """Return the jaws' reading, um."""
        name = "jaws.reading"
        found = as_number(name, self._call(station, name, station.jaws().reading))
        check_finite("jaws", {"opening_um": found})
        return found

    def _lens(self, station: Station, which: int) -> float:
        """Return magnification (0) or focus (1) as the lens reads it."""
        name = "lens.reading"
        found = as_pair(name, self._call(station, name, station.lens.reading))
        zoom, focus_um = found
        check_finite("lens", {"magnification": zoom, "focus_um": focus_um})
        return (zoom, focus_um)[which]

    def _frame(self, station: Station, region: Region | None, after_s: float) -> Frame:
        """Return what the camera gives."""
        camera, limit_s = station.camera, station.rules.safety.grab_s
        frame = self._caller.call(
            "camera.grab",
            lambda: as_frame("camera.grab", camera.grab(region, after_s=after_s)),
            limit_s,
        )
        check_finite("camera", {"exposed_s": frame.exposed_s})
        return frame


def _movers(station: Station) -> dict[str, Mover]:
    """Return what can move, by name."""
    named = {
        "stage": station.stage,
        "robot": station.robot,
        "jaws": station.gripper,
        "lens": station.lens,
    }
    return {name: device for name, device in named.items() if device is not None}


def _check_jaws(
    before_um: float, after_um: float, target_um: float, window_um: float
) -> None:
    """Raise MP849 unless the jaws went where they were told, or onto a part."""
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
