"""A run again, on the record of its devices: does it give the same commands?"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from executor.artifacts import Artifacts
from executor.beliefs import Beliefs
from executor.drivers import AxisReading, Frame
from executor.errors import ExecutorError
from executor.frames import Frames, read_png, region_data
from executor.journal import Journal
from executor.plan_file import PlanFile
from executor.recording import pixels_sha256
from executor.rig import Rig
from executor.run import RunResult, run_plan
from executor.safety import AXES, Rules
from executor.station import Offer, Station
from executor.tape import Recorded, Tape, numbers
from schemas.codec import CodecError, from_data
from schemas.plan import Region


@dataclass(frozen=True, slots=True, kw_only=True)
class Replayed:
    """How a replay went; `difference` is "" if the commands are the same."""

    commands: int  # that were given in the record
    same: int  # of them, up to the first difference
    difference: str
    apart: float  # largest difference of two numbers that count as the same
    broken_off: bool  # the record ends before the plan does
    result: RunResult


def replay(
    file: PlanFile, artifacts: Artifacts, recorded: Recorded, *, anyway: bool = False
) -> Replayed:
    """Return whether a plan on a record gives the commands of the record.

    The core is that of any run; only the devices are others, which answer from the
    record.

    Parameters
    ----------
    file : PlanFile
        The plan.
    artifacts : Artifacts
        Its routines.
    recorded : Recorded
        The record.
    anyway : bool
        Whether to go on with another plan, or frames that were changed.

    Raises
    ------
    ExecutorError
        MP877 if the record is of another plan, or cannot be used.
    """
    head = recorded.head
    for key, now in (("plan_sha256", file.sha256), ("arrays_sha256", artifacts.sha256)):
        if head.get(key) != now and not anyway:
            raise ExecutorError(
                "MP877",
                f"the record is of another plan: its {key} is {head.get(key)}, this "
                f"one's {now}",
            )
    tape = Tape(recorded)
    station = tape_station(tape, anyway=anyway)
    rig = Rig(
        plan=file.plan,
        station=station,
        beliefs=Beliefs(file.plan.beliefs, file.plan.features),
        artifacts=artifacts,
        journal=Journal(io.StringIO(), _Silent()),
        frames=Frames(None, wanted=bool(head.get("whole_frames"))),
    )
    result = run_plan(rig)
    return _judged(tape, result)


def _judged(tape: Tape, result: RunResult) -> Replayed:
    """Return how far commands and outcome are the same; MP877 as it came."""
    recorded = tape.recorded
    if result.code == "MP877":
        raise ExecutorError("MP877", result.message)
    words, left = tape.difference, tape.left()
    if not words and left and not tape.broken_off:
        words = f"command {tape.used + 1}: none any more, recorded was {left}"
        words += _because(result)
    if not words and not tape.broken_off and result.code != recorded.ended:
        words = f"the run ends in {result.code or 'done'}, recorded was "
        words += recorded.ended or "done"
    return Replayed(
        commands=recorded.commands,
        same=tape.used,
        difference=words,
        apart=tape.apart,
        broken_off=tape.broken_off,
        result=result,
    )


def _because(result: RunResult) -> str:
    """Return why a replay ended early."""
    if result.code is None:
        return "; the run is done"
    return f"; step {result.step} ends in {result.code}: {result.message}"


def tape_station(tape: Tape, *, anyway: bool = False) -> Station:
    """Return a station whose devices answer from a tape.

    Raises
    ------
    ExecutorError
        MP877 if the record does not say what the station offered.
    """
    head = tape.recorded.head
    devices = head.get("devices")
    if not isinstance(devices, dict):
        raise ExecutorError("MP877", "the record names no devices")
    try:
        offer = from_data(Offer, head.get("offer"))
        rules = from_data(Rules, head.get("rules"))
    except CodecError as error:
        raise ExecutorError("MP877", f"the record's station: {error}") from error
    return Station(
        stage=TapeAxes(tape, "stage"),
        robot=TapeAxes(tape, "robot") if "robot" in devices else None,
        gripper=TapeJaws(tape, "jaws") if "jaws" in devices else None,
        lens=TapeLens(tape, "lens"),
        light=TapeLight(tape, "light"),
        camera=TapeCamera(tape, "camera", anyway=anyway),
        clock=TapeClock(tape),
        offer=offer,
        rules=rules,
    )


class _TapeDevice:
    """A device that answers from a tape."""

    def __init__(self, tape: Tape, name: str) -> None:
        self._tape, self._name = tape, name

    @property
    def model(self) -> str:
        """Return what the device is."""
        return f"recorded {self._name}"

    @property
    def serial(self) -> str:
        """Return which record it answers from."""
        return str(self._tape.recorded.folder)

    def moving(self) -> bool:
        """Return what the device said of itself."""
        return bool(self._tape.query(f"{self._name}.moving"))

    def stop(self) -> None:
        """Do nothing: nothing moves."""

    def _order(self, method: str, **given: Any) -> Mapping[str, Any]:
        """Compare a command with the record; return its row."""
        return self._tape.command(f"{self._name}.{method}", given)


class TapeAxes(_TapeDevice):
    """A stage or robot; see `executor.drivers.Axes`."""

    def start(self, **targets: float | None) -> None:
        """Compare a motion with the recorded one."""
        self._order("start", **targets)

    def reading(self) -> AxisReading:
        """Return the recorded reading."""
        name = f"{self._name}.reading"
        values = numbers(self._tape.query(name), len(AXES), name)
        return AxisReading(**dict(zip(AXES, values, strict=True)))


class TapeJaws(_TapeDevice):
    """Jaws; see `executor.drivers.Gripper`."""

    def start(self, opening_um: float) -> None:
        """Compare an opening with the recorded one."""
        self._order("start", value=opening_um)

    def reading(self) -> float:
        """Return the recorded opening, um."""
        name = f"{self._name}.reading"
        return numbers([self._tape.query(name)], 1, name)[0]


class TapeLens(_TapeDevice):
    """Zoom and focus; see `executor.drivers.Lens`."""

    def start_magnification(self, magnification: float) -> None:
        """Compare a zoom with the recorded one."""
        self._order("start_magnification", value=magnification)

    def start_focus_um(self, focus_um: float) -> None:
        """Compare a focus with the recorded one."""
        self._order("start_focus_um", value=focus_um)

    def reading(self) -> tuple[float, float]:
        """Return recorded magnification and focus (um)."""
        name = f"{self._name}.reading"
        zoom, focus_um = numbers(self._tape.query(name), 2, name)
        return (zoom, focus_um)


class TapeLight(_TapeDevice):
    """The light; see `executor.drivers.Light`."""

    def set_level(self, level: float) -> None:
        """Compare a brightness with the recorded one."""
        self._order("set_level", value=level)


class TapeCamera(_TapeDevice):
    """The camera; see `executor.drivers.Camera`."""

    def __init__(self, tape: Tape, name: str, *, anyway: bool) -> None:
        super().__init__(tape, name)
        self._anyway = anyway

    def grab(self, region: Region | None = None, *, after_s: float) -> Frame:
        """Return the recorded frame; MP877 if it is missing or was changed."""
        row = self._order("grab", region=region_data(region), after_s=after_s)
        gave = row.get("gave")
        if not isinstance(gave, dict) or not isinstance(gave.get("frame"), str):
            raise ExecutorError("MP877", f"call {row['n']} of the record has no frame")
        folder = self._tape.recorded.folder
        path = folder / gave["frame"]
        if not path.resolve().is_relative_to(folder.resolve()):
            raise ExecutorError("MP877", f"{gave['frame']} leaves the run folder")
        try:
            counts = read_png(path)
        except OSError as error:
            words = error.strerror or str(error)
            raise ExecutorError("MP877", f"{path}: {words}") from error
        if pixels_sha256(counts) != gave.get("sha256") and not self._anyway:
            raise ExecutorError("MP877", f"{path} is not the frame that was recorded")
        exposed_s = numbers([gave.get("exposed_s")], 1, "camera.grab")[0]
        return Frame(counts=counts, exposed_s=exposed_s)


class TapeClock:
    """The recorded time; see `executor.drivers.Clock`."""

    def __init__(self, tape: Tape) -> None:
        self._tape = tape

    def now_s(self) -> float:
        """Return seconds as they were recorded."""
        return self._tape.now_s()

    def wait(self, seconds: float) -> None:
        """Return at once."""
        self._tape.wait(seconds)


class _Silent:
    """The clock of a log that nobody reads: what it asks is not on the tape."""

    def now_s(self) -> float:
        """Return 0."""
        return 0.0

    def wait(self, seconds: float) -> None:
        """Return at once."""
