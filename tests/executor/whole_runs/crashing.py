"""Executors that die, one after the other, at one simulated cell that lives on."""

from __future__ import annotations

import errno
import io
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeVar
from unittest.mock import patch

import numpy as np

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.station import Station
from microplan.executor.devices.timeouts import Caller
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.motion.motion import Motion
from microplan.executor.record.frames import Frames
from microplan.executor.record.recovery import Header, ReadJournal, journal_in
from microplan.executor.record.write_ahead_log import Journal, WriteAheadLog
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.resume import begin, take_up
from microplan.executor.run.run import run_plan
from microplan.executor.run.run_context import Rig
from microplan.executor.simulated import axes, contact
from microplan.executor.simulated.cameras.quick_pictures import QuickPictures
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.schemas.files.world import World
from microplan.schemas.plan import InsertAction, Plan
from microplan.schemas.plan.views import CoarseFirst
from tests.executor.bench import Folder, assembly, quiet, world
from tests.executor.pictures import remembered
from tests.executor.recorder import SILENT

T = TypeVar("T")

How = Literal[
    "before", "after", "half", "unwritten", "torn", "written", "full", "unsynced"
]
ORDER_HOWS: tuple[How, ...] = ("before", "after", "half")
LINE_HOWS: tuple[How, ...] = ("unwritten", "torn", "written", "full", "unsynced")
HEADER = Header(plan_sha256="", station="sim", seed=0, faults=(), devices={})
POLL_S = 0.2  # of the cell's own time: fewer readings a run


class Killed(BaseException):
    """The executor is gone from one moment to the next."""


@dataclass(frozen=True, slots=True)
class Fate:
    """How an executor ends: at its n-th order, or at its n-th line of the journal."""

    number: int
    how: How


@dataclass(slots=True)
class Ledger:
    """All that reached the cell, whoever ordered it, and the journal on the disk."""

    cell: Cell
    disk: bytearray = field(default_factory=bytearray)
    orders: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)


class Direct(Caller):
    """Makes calls in the caller's own thread, where they can kill it."""

    def call(
        self,
        name: str,
        call: Callable[[], T],
        limit_s: float,
        late: Callable[[], None] | None = None,
    ) -> T:
        """Return what `call` returns, with the codes of `Caller`."""
        try:
            return call()
        except ExecutorError:
            raise
        except Exception as error:
            raise ExecutorError("MP841", f"{name}: {error}") from error


class Life:
    """One executor: counts its orders and lines, and dies as its fate says.

    Once it is dead, nothing of it reaches cell or disk any more.
    """

    def __init__(self, ledger: Ledger, plan: Plan, fate: Fate | None) -> None:
        self.ledger, self.fate = ledger, fate
        self.orders, self.lines = 0, 0
        self.dead = False
        self.failed = False  # nothing may move any more
        self.allowed = False  # the operator let a half-done insertion go on
        self._depths = {
            move.z_um: step
            for number, step in enumerate(plan.steps)
            if isinstance(step.action, InsertAction)
            for move in step.action.moves
        }

    def station(self) -> Station:
        """Return the cell's station, ordered through this life."""
        found = self.ledger.cell.station
        names = ("stage", "robot", "gripper", "lens", "light", "camera")
        wired = {name: _Wired(getattr(found, name), name, self) for name in names}
        safety = replace(found.rules.safety, poll_s=POLL_S)
        rules = replace(found.rules, safety=safety)
        return replace(found, rules=rules, **wired)  # type: ignore[arg-type]  # by name

    def order(
        self, device: str, method: str, call: Callable[..., T], *args: Any, **named: Any
    ) -> T | None:
        """Pass an order on, or die of it."""
        if self.dead:
            return None
        if method == "stop":
            return call()
        fate, self.orders = self._fate(ORDER_HOWS, self.orders), self.orders + 1
        if fate == "before":
            self._die()
        self._judge(device, method, args, named)
        found = call(*args, **named)
        if fate == "half":
            self._half(device)
        if fate in ("after", "half"):
            self._die()
        return found

    def append(self, line: bytes) -> None:
        """Write a line of the journal, or die of it, or fail."""
        if self.dead:
            return
        fate, self.lines = self._fate(LINE_HOWS, self.lines), self.lines + 1
        disk = self.ledger.disk
        if fate == "unwritten":
            self._die()
        disk += line[: len(line) // 2] if fate in ("torn", "full") else line
        if fate in ("torn", "written"):
            self._die()
        if fate == "full":
            self.failed = True
            raise OSError(errno.ENOSPC, "No space left on device")
        if fate == "unsynced":
            self.failed = True
            raise OSError(errno.EIO, "Input/output error")

    def _fate(self, hows: tuple[How, ...], number: int) -> How | None:
        """Return what is to happen now."""
        fate = self.fate
        if fate is None or fate.how not in hows or fate.number != number:
            return None
        return fate.how

    def _die(self) -> None:
        self.dead = True
        raise Killed

    def _half(self, device: str) -> None:
        """Let half of the motion's time pass; then the drive stands still."""
        cell = self.ledger.cell
        mover = {"stage": cell.stage, "robot": cell.robot}.get(device)
        if mover is not None and mover._motion is not None:
            cell.timeline.advance(mover._motion.seconds / 2)
            mover.stop()
        for delayed, named in ((cell.jaws, "gripper"), (cell.lens, "lens")):
            left_s = delayed.motion.left_s()
            if named == device and left_s is not None:
                cell.timeline.advance(left_s / 2)
                delayed.stop()

    def _judge(
        self, device: str, method: str, args: tuple[Any, ...], named: dict[str, Any]
    ) -> None:
        """Note an order, and what is wrong with it by the cell's truth."""
        ledger, cell = self.ledger, self.ledger.cell
        told = f"{device}.{method}{args}{named}"
        ledger.orders.append(told)
        if self.failed:
            ledger.wrong.append(f"{told} after a fault")
        if device in ("stage", "robot", "gripper") and not self._announced(args, named):
            ledger.wrong.append(f"{told} without an intent on the disk")
        if device == "gripper" and cell.jaws.reading() == args[0]:
            ledger.wrong.append(f"{told} although the jaws did that")
        if device == "stage" and named.get("z_um") in self._depths:
            now_um = cell.truth.stage.commanded["z_um"]
            if now_um not in STARTS_UM and not self.allowed:
                ledger.wrong.append(f"{told} begun at {now_um:.6g}")

    def _announced(self, args: tuple[Any, ...], named: dict[str, Any]) -> bool:
        """Return whether the journal's last line says what is now ordered."""
        disk = bytes(self.ledger.disk)
        last = json.loads(disk[disk.rfind(b"\n", 0, -1) + 1 :])
        target = dict(zip(("opening_um",), args, strict=False))
        target |= {k: v for k, v in named.items() if k != "speed_um_per_s"}
        return bool(last["kind"] == "intent" and last["intent"]["target"] == target)


STARTS_UM = (-260.0,)  # where the insertion of `tests.executor.bench.assembly` begins


class _Wired:
    """A device whose orders go through a life."""

    def __init__(self, device: Any, name: str, life: Life) -> None:
        self._device, self._name, self._life = device, name, life

    def __getattr__(self, method: str) -> Any:
        found = getattr(self._device, method)
        if method in SILENT or not callable(found):
            return found
        life, name = self._life, self._name
        return lambda *args, **named: life.order(name, method, found, *args, **named)


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """What all executors are asked to do."""

    plan: Plan
    artifacts: Artifacts
    world: World


def small_job(folder: Path) -> Job:
    """Return the hand-built assembly in a world without spreads.

    Its first look is made in two: after a coarse one the gear is brought elsewhere, and
    back after the fine one.
    """
    maker = Folder(folder)
    plan = assembly(maker)
    find, *others = plan.steps
    way = CoarseFirst(look="wide", axes="stage", at_um=(5.0, 3.0), most_um=40.0)
    fine = replace(find.looks[0], coarse=way)
    looks = (replace(find.looks[0], id="wide"), fine)
    plan = replace(plan, steps=(replace(find, looks=looks), *others))
    artifacts = Artifacts.from_folder(plan, maker.folder)
    return Job(plan=plan, artifacts=artifacts, world=quiet(world()))


@contextmanager
def hurried() -> Iterator[None]:
    """Make a run of the cell take a third of its time while inside.

    Pictures of one true state are rendered once, and contact is tested after 12 um of
    way in x and y and 2 um in z: a z step must stay below what counts as a blow from
    the side.
    """
    coarse = {"x_um": 12.0, "y_um": 12.0, "z_um": 2.0}
    assert coarse["z_um"] < contact.FROM_ABOVE_UM
    with (
        patch.object(QuickPictures, "image", remembered),
        patch.dict(axes.STEP_UM, coarse),
    ):
        yield


def all_fates(job: Job) -> list[Fate]:
    """Return every way in which one executor can die at this job, in order of time."""
    ledger = Ledger(build_cell(job.world, 0))
    whole = live(job, ledger)
    assert whole.code is None, whole
    assert not ledger.wrong
    return [
        *(Fate(n, how) for n in range(whole.orders) for how in ORDER_HOWS),
        *(Fate(n, how) for n in range(whole.lines) for how in LINE_HOWS),
    ]


def pairs(fates: Sequence[Fate], count: int, seed: int = 0) -> list[tuple[Fate, Fate]]:
    """Return deaths with another one soon after the next executor has begun."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        first, second = (fates[i] for i in rng.integers(len(fates), size=2))
        soon = Fate(int(rng.integers(12)), second.how)
        found.append((first, soon))
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class End:
    """How one executor ended; `code` is None if it says done, "" if it was killed."""

    code: str | None
    message: str
    orders: int
    lines: int


def live(
    job: Job,
    ledger: Ledger,
    fate: Fate | None = None,
    ask: Callable[[str], bool] | None = None,
) -> End:
    """Let one executor begin the job, or go on with it."""
    life = Life(ledger, job.plan, fate)
    life.allowed = ask is not None
    code: str | None = ""
    message = ""
    try:
        code, message = _work(job, ledger, life, ask)
    except Killed:
        pass
    except ExecutorError as error:
        code, message = error.code, error.message
    return End(code=code, message=message, orders=life.orders, lines=life.lines)


def _work(
    job: Job, ledger: Ledger, life: Life, ask: Callable[[str], bool] | None
) -> tuple[str | None, str]:
    """Do what the command does, without its files."""
    found = _found(ledger)
    seq, chain = (0, 0) if found is None else (found.seq, found.chain)
    del ledger.disk[0 if found is None else found.size :]
    station = life.station()
    rig = Rig(
        plan=job.plan,
        station=station,
        beliefs=Beliefs(job.plan.beliefs, job.plan.features),
        artifacts=job.artifacts,
        journal=Journal(io.StringIO(), station.clock),
        frames=Frames(None),
        motion=Motion(caller=Direct()),
        write_ahead=WriteAheadLog(life, seq=seq, chain=chain),
    )
    if found is None:
        begin(rig, HEADER)
    else:
        take_up(rig, found.state, ask)
    result = run_plan(rig)
    return result.code, result.message


def _found(ledger: Ledger) -> ReadJournal | None:
    """Return what the journal tells, None if nothing had begun."""
    try:
        return journal_in(bytes(ledger.disk))
    except ExecutorError as error:
        if error.code != "MP868":
            raise
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of one job and its executors; `wrong` is empty if all was well."""

    fates: tuple[Fate, ...]
    ends: tuple[End, ...]
    orders: tuple[str, ...]  # all that reached the cell
    asked: bool
    wrong: tuple[str, ...]

    @property
    def met(self) -> bool:
        """Return whether every executor met its fate before its work was done."""
        return all(end.code in ("", "MP863") for end in self.ends[: len(self.fates)])


def outcome(job: Job, fates: tuple[Fate, ...]) -> Outcome:
    """Let executors die by their fates, one after the other, until one ends the job.

    Where one asks about a half-done insertion, the operator lets it go on.
    """
    cell = build_cell(job.world, 0)
    ledger, asked = Ledger(cell), False
    ends: list[End] = []
    for fate in fates:
        ends.append(live(job, ledger, fate))
        cell.timeline.advance(20.0)  # what was under way goes on by itself
        ledger.wrong += _after(ends[-1], fate, cell)
        if ends[-1].code in (None, "MP864"):
            break
    if ends[-1].code is not None:
        ends.append(live(job, ledger))
    if ends[-1].code == "MP864":
        asked = True
        z_um = cell.truth.stage.commanded["z_um"]
        if not -260.0 < z_um < 0.0:
            ledger.wrong.append(f"asked although the stage is at {z_um:.6g}")
        ends.append(live(job, ledger, ask=lambda _: True))
    ledger.wrong += _final(ends[-1], cell)
    return Outcome(
        fates=fates,
        ends=tuple(ends),
        orders=tuple(ledger.orders),
        asked=asked,
        wrong=tuple(ledger.wrong),
    )


def _after(end: End, fate: Fate, cell: Cell) -> Iterator[str]:
    """Yield what is wrong with an executor's end."""
    if fate.how in ("full", "unsynced") and end.lines > fate.number:
        if end.code != "MP863":
            yield f"a write failed, and it said {end.code}: {end.message}"
    elif end.code not in ("", None, "MP864"):
        yield f"it said {end.code}: {end.message}"


def _final(end: End, cell: Cell) -> Iterator[str]:
    """Yield what is wrong with the last executor, which nothing killed."""
    if end.code is not None:
        yield f"it ended with {end.code}: {end.message}"
    verdict = cell.judge("gear", "shaft_plate.post")
    if not verdict.success:
        yield f"it is not seated: {verdict}"
