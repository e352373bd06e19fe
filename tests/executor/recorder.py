"""A station whose devices note every call that changes something."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from microplan.executor.devices.station import Station
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.record.frames import Frames
from microplan.executor.record.outcome import RunResult
from microplan.executor.record.write_ahead_log import Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.run import run_plan
from microplan.executor.run.run_context import Rig
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.schemas.files.world import World
from microplan.schemas.plan import Plan

SILENT = ("reading", "moving", "model", "serial", "now_s", "wait")  # change nothing


@dataclass(frozen=True, slots=True)
class Call:
    """One call: the step it fell in, device, method and what it was given."""

    step: str
    device: str
    method: str
    values: dict[str, Any]

    def __str__(self) -> str:
        """Return the call as a line of a trace."""
        words = (f"{k}={v:.3f}" for k, v in self.values.items() if _told(k, v))
        return " ".join((self.step, f"{self.device}.{self.method}", *words))


def _told(name: str, value: object) -> bool:
    """Return whether a trace shows an argument: what was ordered, not when."""
    return isinstance(value, int | float) and name != "after_s"


@dataclass(slots=True)
class Recorder:
    """Wraps devices; `calls` holds their calls in order."""

    step: str = ""
    calls: list[Call] = field(default_factory=list)

    def station(self, found: Station) -> Station:
        """Return a station whose devices are noted."""
        names = {"stage": "stage", "robot": "robot", "gripper": "jaws", "lens": "lens",
                 "light": "light", "camera": "camera"}  # fmt: skip
        devices = {k: _Noted(getattr(found, k), v, self) for k, v in names.items()}
        return replace(found, **devices)  # type: ignore[arg-type]  # devices by name

    def trace(self) -> list[str]:
        """Return the calls, a line each; stops come from threads of their own."""
        moved = [str(c) for c in self.calls if c.method != "stop"]
        return moved + sorted(str(c) for c in self.calls if c.method == "stop")


class _Noted:
    """A device that notes calls, and passes them on."""

    def __init__(self, device: Any, name: str, recorder: Recorder) -> None:
        self._device, self._name, self._recorder = device, name, recorder

    def __getattr__(self, method: str) -> Any:
        found = getattr(self._device, method)
        if method in SILENT or not callable(found):
            return found
        return self._noting(method, found)

    def _noting(self, method: str, found: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **named: Any) -> Any:
            values = {**{str(i): a for i, a in enumerate(args)}, **named}
            step, calls = self._recorder.step, self._recorder.calls
            calls.append(Call(step, self._name, method, values))
            return found(*args, **named)

        return call


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """How a run went, and all that is known of it."""

    result: RunResult
    cell: Cell
    recorder: Recorder
    events: list[dict[str, Any]]
    beliefs: Beliefs


def run(
    plan: Plan,
    artifacts: Artifacts,
    world: World,
    faults: Sequence[str] = (),
    *,
    change: Callable[[Station], Station] = lambda station: station,
    seed: int = 0,
) -> Run:
    """Run a plan on a simulated cell with faults."""
    cell, recorder, log = build_cell(world, seed, faults), Recorder(), io.StringIO()
    station = change(recorder.station(cell.station))

    def enter(step: str) -> None:
        recorder.step = step
        cell.faults.enter(step)

    rig = Rig(
        plan=plan,
        station=station,
        beliefs=Beliefs(plan.beliefs, plan.features),
        artifacts=artifacts,
        journal=Journal(log, station.clock),
        frames=Frames(None),
        on_step=enter,
    )
    result = run_plan(rig)
    events = [json.loads(line) for line in log.getvalue().splitlines()]
    return Run(
        result=result,
        cell=cell,
        recorder=recorder,
        events=events,
        beliefs=rig.beliefs,
    )
