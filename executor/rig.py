"""Plan, devices, beliefs and log, held together while a plan runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from executor.artifacts import Artifacts
from executor.beliefs import Beliefs, Readings
from executor.calibration import LookFrame, look_frame
from executor.drivers import Counts
from executor.errors import ExecutorError
from executor.frames import Frames
from executor.journal import Journal
from executor.motion import Motion
from executor.safety import Phase, check_finite, targets
from executor.station import Station
from schemas.plan import AxisMove, Look, Plan, Region, View


@dataclass(slots=True, kw_only=True)
class Rig:
    """What every phase of a run works on; `view` is what the lens is set to.

    `watch` is told of every accepted sighting: a simulated cell compares it with the
    truth. `on_step` is told of every step: a simulated cell begins and ends its faults.
    Nothing in a run depends on either.
    """

    plan: Plan
    station: Station
    beliefs: Beliefs
    artifacts: Artifacts
    journal: Journal
    frames: Frames
    view: View | None = None
    watch: Callable[[str, float, float], None] | None = None  # target, x um, y um
    on_step: Callable[[str], None] | None = None  # told of every step that begins
    motion: Motion = field(default_factory=Motion)
    phase: Phase = "approach"  # what moves are for now: it sets their limits

    def readings(self) -> Readings:
        """Return where the axes are now."""
        station = self.station
        return Readings(
            stage=self.motion.reading(station, "stage"),
            robot=self.motion.reading(station, "robot") if station.robot else None,
            theta_axis_um=self.plan.requirements.theta_axis_um,
        )

    def move(self, move: AxisMove) -> None:
        """Move one axis group and note it; MP847 if a target is not finite."""
        with self.motion.guarded(self.station):  # the journal holds finite numbers only
            check_finite(move.axes, targets(move))
        self.journal.write("move", to=move)
        self.motion.travel(self.station, move, self.phase)
        self.journal.write("moved", axes=move.axes)

    def grip(self, opening_um: float) -> None:
        """Move the jaws and note it."""
        self.journal.write("jaws", opening_um=opening_um)
        reading_um = self.motion.grip(self.station, opening_um)
        self.journal.write("jaws_moved", reading_um=reading_um)

    def set_view(self, view: View, *, focus_um: float | None = None) -> None:
        """Set zoom, focus and light, each only if it changes."""
        focus = view.focus_um if focus_um is None else focus_um
        old = self.view
        if old is None or old.magnification != view.magnification:
            self.journal.write("zoom", magnification=view.magnification)
            self.motion.zoom(self.station, view.magnification)
        if old is None or old.focus_um != focus:
            self.journal.write("focus", focus_um=focus)
            self.motion.focus(self.station, focus)
        if old is None or old.light != view.light:
            self.motion.light(self.station, view.light)
        self.view = replace(view, focus_um=focus)

    def grab(self, region: Region | None, *, keep: bool = True) -> Counts:
        """Return a frame of `region`.

        Where frames are kept for the record, the whole frame is taken, kept, and the
        region cut out of it.

        Raises
        ------
        ExecutorError
            MP841 if the camera returns another size.
        """
        if region is None or not (keep and self.frames.wanted):
            counts = self._checked(region)
            if keep:
                self.frames.keep(counts)
            return counts
        whole = self._checked(None)
        self.frames.keep(whole)
        rows = slice(region.row, region.row + region.rows)
        columns = slice(region.column, region.column + region.columns)
        return whole[rows, columns]

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
