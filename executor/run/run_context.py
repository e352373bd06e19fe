"""Context of a running plan: devices, beliefs, logs, progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Literal

from microplan.executor.devices.calibration import (
    LookFrame,
    look_frame,
    placed_look,
)
from microplan.executor.devices.drivers import Counts
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import (
    Phase,
    check_finite,
    check_opening,
    check_travel,
    targets,
)
from microplan.executor.devices.station import Station
from microplan.executor.motion.beliefs import Beliefs, Readings
from microplan.executor.motion.keep_out import KeepOut, Moment
from microplan.executor.motion.motion import Motion
from microplan.executor.record.frames import Frames
from microplan.executor.record.outcome import StepResult
from microplan.executor.record.recovery import ResumeState
from microplan.executor.record.write_ahead_log import (
    AWAY,
    DriveReadings,
    Intent,
    Journal,
    WriteAheadLog,
)
from microplan.executor.run.artifacts import Artifacts
from microplan.schemas.plan import AxisMove, Look, Plan, Region, View


@dataclass(slots=True, kw_only=True)
class Rig:
    """Context of every phase of a run; `view` is what the lens is set to.

    `watch` gets every accepted sighting: a simulated cell compares it with the
    truth. `on_step` gets every step: a simulated cell begins and ends its faults.
    Nothing in a run depends on either. `gate` is shown what comes next, before every
    step and before what cannot be undone; it may wait, or raise MP860.
    """

    plan: Plan
    station: Station
    beliefs: Beliefs
    artifacts: Artifacts
    journal: Journal
    frames: Frames
    view: View | None = None
    watch: Callable[[str, float, float], None] | None = None  # target, x um, y um
    on_step: Callable[[str], None] | None = None  # called with every step that begins
    gate: Callable[[str], None] | None = None
    waited_s: float = 0.0  # at the gate, no part of the work
    motion: Motion = field(default_factory=Motion)
    phase: Phase = "approach"  # what moves are for now: it sets their limits
    write_ahead: WriteAheadLog = field(default_factory=WriteAheadLog)
    # empty unless the run is resumed
    resume_state: ResumeState = field(default_factory=ResumeState)
    planned_s: Mapping[str, float] = field(default_factory=dict)  # step -> as planned

    def enter(self, step: str) -> None:
        """Begin a step; what an earlier executor did of another is no longer asked."""
        if self.resume_state.step != step:
            self.resume_state = ResumeState()
        self.write_ahead.write("begin", step=step)

    def finish(self, result: StepResult) -> None:
        """Have in the journal that a step is done, and all that the next one needs."""
        self.write_ahead.write(
            "step", result=result, known=self.beliefs.known(), phase=self.phase
        )

    def announce(self, what: str) -> None:
        """Show what comes next, and go on when the gate lets it."""
        if self.gate is None:
            return
        began_s = self.station.clock.now_s()
        self.journal.write("asked", what=what)
        self.gate(what)
        self.waited_s += self.station.clock.now_s() - began_s

    def worked_s(self) -> float:
        """Return the station's time without what was spent at the gate."""
        return self.station.clock.now_s() - self.waited_s

    probed: float | None = None  # magnification at which the axes were probed last
    _keep_out: KeepOut | None = None

    def readings(self) -> Readings:
        """Return the present readings of the axes."""
        station = self.station
        return Readings(
            stage=self.motion.reading(station, "stage"),
            robot=self.motion.reading(station, "robot") if station.robot else None,
            theta_axis_um=self.plan.requirements.theta_axis_um,
        )

    def standing(self) -> DriveReadings:
        """Return the present readings of axes and jaws."""
        readings = self.readings()
        jaws = self.station.gripper
        return DriveReadings(
            stage=readings.stage,
            robot=readings.robot,
            opening_um=None if jaws is None else self.motion.opening(self.station),
        )

    @property
    def keep_out(self) -> KeepOut:
        """Return the keep-out check of the plan."""
        if self._keep_out is None:
            surface_um = self.station.rules.stage_datum_z_um
            self._keep_out = KeepOut(self.plan, surface_um)
        return self._keep_out

    def moment(self, *openings_um: float) -> Moment:
        """Return beliefs and readings now; the jaws may go on to other openings."""
        has_jaws = self.station.gripper is not None
        first = (self.motion.opening(self.station),) if has_jaws else ()
        return Moment(
            beliefs=self.beliefs,
            readings=self.readings(),
            openings_um=(*first, *openings_um) or (0.0,),
        )

    def move(self, move: AxisMove, name: str = "") -> None:
        """Move one axis group and note it; what it would hit is refused before.

        A motion with a name is not made again if an earlier executor finished it; one
        that it left under way goes on to where it was meant to go.
        """
        if name in self.resume_state.finished:
            return
        again = self.resume_state.again
        if again is not None and name == again.name:
            move = AxisMove(
                axes=move.axes, speed_um_per_s=move.speed_um_per_s, **again.target
            )
        with self.motion.guarded(self.station):  # the journal holds finite numbers only
            check_finite(move.axes, targets(move))
            check_travel(move.axes, targets(move), self.station.offer.travel)
        self.journal.write("move", to=move)
        if self.keep_out.known:
            self.keep_out.check(move, self.moment(), self.journal.step)
        with self._intended(name, move.axes, targets(move)):
            self.motion.travel(self.station, move, self.phase)
        self.journal.write("moved", axes=move.axes)

    def grip(self, opening_um: float) -> None:
        """Move the jaws and note it, unless an earlier executor did."""
        if "jaws" in self.resume_state.finished:
            return
        with self.motion.guarded(self.station):
            check_opening(opening_um, self.station.offer.opening_um)
        self.journal.write("jaws", opening_um=opening_um)
        if self.keep_out.known:
            self.keep_out.check_jaws(self.moment(opening_um), self.journal.step)
        with self._intended("jaws", "jaws", {"opening_um": opening_um}):
            reading_um = self.motion.grip(self.station, opening_um)
        self.journal.write("jaws_moved", reading_um=reading_um)

    def go_back(self) -> None:
        """Take the axes back from where an earlier executor left them for a look."""
        away = self.resume_state.away
        if away is None or away.device == "jaws":
            return
        before = away.before.stage if away.device == "stage" else away.before.robot
        if before is not None:
            readings_before = {axis: getattr(before, axis) for axis in away.target}
            self.move(AxisMove(axes=away.device, **readings_before), AWAY[away.name])
        self.resume_state.away = None

    def keep_beliefs(self) -> None:
        """Have what is believed now in the journal."""
        self.write_ahead.write("known", known=self.beliefs.known())

    @contextmanager
    def _intended(
        self,
        name: str,
        device: Literal["stage", "robot", "jaws"],
        target: Mapping[str, float],
    ) -> Iterator[None]:
        """Have the intent on disk before the motion inside, and that it is done after.

        A motion that fails stays open: the next executor looks how far it went.
        """
        intent = Intent(
            step=self.journal.step,
            name=name,
            device=device,
            target=target,
            phase=self.phase,
            irreversible=device == "jaws" or self.phase == "insert",
            before=self.standing(),
        )
        self.write_ahead.write("intent", intent=intent)
        yield
        self.write_ahead.write("done", name=name, standing=self.standing())

    def set_view(self, view: View, *, focus_um: float | None = None) -> None:
        """Set zoom, focus and light, each only if it changes."""
        focus = view.focus_um if focus_um is None else focus_um
        old = self.view
        if old is None or old.magnification != view.magnification:
            self.journal.write("zoom", magnification=view.magnification)
            self.write_ahead.write("view", view=view)
            self.motion.zoom(self.station, view.magnification)
            self.probed = None
        if old is None or old.focus_um != focus:
            self.journal.write("focus", focus_um=focus)
            self.motion.focus(self.station, focus)
        if old is None or old.light != view.light:
            self.journal.write("light", level=view.light)
            self.motion.light(self.station, view.light)
        self.view = replace(view, focus_um=focus)

    def grab(
        self, region: Region | None, *, keep: bool = True, look: str = ""
    ) -> Counts:
        """Return a frame of `region`, and note it with the look it is for.

        Where frames are kept for the record the whole frame is taken and the region
        cut out of it, unless `keep` is False.

        Raises
        ------
        ExecutorError
            MP841 if the camera returns another size.
        """
        whole = region is None or (keep and self.frames.wanted)
        if self.frames.wanted:
            self.readings()  # the index holds the readings of the axes
        self.journal.write("grab", look=look, region=region)
        self.frames.expect(look, region)
        counts = self._checked(None if whole else region)
        self.journal.write("grabbed", frame=self.frames.last)
        if region is None or not whole:
            return counts
        rows = slice(region.row, region.row + region.rows)
        columns = slice(region.column, region.column + region.columns)
        return counts[rows, columns]

    def _checked(self, region: Region | None) -> Counts:
        """Return the camera's frame if it has the size that was asked for."""
        counts = self.motion.grab(self.station, region).counts
        need = self.plan.requirements
        size = (need.height_px, need.width_px)
        wanted = size if region is None else (region.rows, region.columns)
        if counts.shape != wanted:
            raise ExecutorError(
                "MP841", f"the camera gave {counts.shape} pixels, not {wanted}"
            )
        return counts

    def frame_of(self, look: Look) -> LookFrame:
        """Return the map between a look's region and the world."""
        calibration = self.station.offer.calibration
        return look_frame(look, self.plan.requirements, calibration)

    def placed(self, look: Look) -> Look:
        """Return a look with its region where its target is believed now."""
        if not look.view.follows:
            return look
        expected = self.beliefs.world(look.target, self.readings())
        return placed_look(look, self.plan.requirements, self.frame_of(look), expected)
