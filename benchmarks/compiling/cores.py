"""What more cores would make of a compile: its chunks, replayed on so many.

One process compiles the gear-on-shaft example and notes how long each chunk of the
queue takes, and each stretch of the looks' own control flows, which run one at a time.
The replay keeps who waits for whom and the chunks' priorities.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from typing import Any, TypeVar
from unittest.mock import patch

from benchmarks.example import TASK
from benchmarks.figures import Benchmark, Figure, Options
from microplan.planner.plan import compiler
from microplan.planner.plan.options import Options as Asked
from microplan.planner.queue.turns import ChunkMap, Elsewhere, Turns
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task

A = TypeVar("A")
B = TypeVar("B")
R = TypeVar("R")

CORES = 16
NAMES = (
    "compile.cores16_s",
    "compile.cores16_speedup",
    "compile.longest_chain_s",
    "compile.own_flow_share",
)


@dataclass(frozen=True, slots=True)
class Chunks:
    """Chunks that a control flow hands over at once, and waits for."""

    took_s: tuple[float, ...]
    priority: float


# what a control flow does: works so long itself, waits for chunks, or for another flow
Act = float | Chunks | int
Flow = list[Act]


@dataclass(slots=True)
class NotedTurns(Turns):
    """Turns of one process that does everything at once, and notes what it took."""

    flows: list[Flow] = field(default_factory=lambda: [[]])
    at: int = 0  # the flow that runs
    owners: dict[Future[Any], int] = field(default_factory=dict)  # flows of results
    since_s: float = field(default_factory=time.process_time)

    def start(self, work: Callable[[], R]) -> Future[R]:
        """Do all of a control flow now."""
        self.note()
        before, self.at = self.at, len(self.flows)
        self.flows.append([])
        found: Future[R] = Future()
        self.owners[found] = self.at
        found.set_result(work())
        self.note()
        self.at = before
        return found

    def of(self, found: Future[R]) -> R:
        """Return a result; who asks waits for its flow."""
        self.note()
        self.flows[self.at].append(self.owners[found])
        return found.result()

    def map(self, priority: float, _elsewhere: Elsewhere) -> ChunkMap:
        """Return a `map` that does all chunks now."""

        def mapped(function: Callable[[A], B], items: Iterable[A], /) -> Iterator[B]:
            asked = list(items)
            self.note()
            found, took_s = [], []
            for item in asked:
                started = time.process_time()
                found.append(function(item))
                took_s.append(time.process_time() - started)
            self.flows[self.at].append(Chunks(tuple(took_s), priority))
            self.since_s = time.process_time()
            return iter(found)

        return mapped

    def note(self) -> None:
        """Note what the flow that runs worked itself since the last note."""
        now_s = time.process_time()
        self.flows[self.at].append(now_s - self.since_s)
        self.since_s = now_s


def noted(preset: str) -> list[Flow]:
    """Compile the example in this process; return its control flows, the main first.

    Raises
    ------
    RuntimeError
        If it cannot be compiled.
    """
    report, turns = Report(), NotedTurns()

    @contextmanager
    def turns_of(*_: object) -> Iterator[NotedTurns]:
        yield turns

    task = load_task(str(TASK), report)
    with patch.object(compiler, "turns_of", turns_of):
        made = task and compiler.compile_task(
            task,
            report,
            Asked(preset=preset),  # type: ignore[arg-type]
        )
    if made is None:
        raise RuntimeError(f"{TASK}: {report.found}")
    turns.note()
    return turns.flows


@dataclass(slots=True)
class _Machine:
    """Cores at a moment of the replay: one for control flows, the others for chunks."""

    flows: list[Flow]
    free: int
    now_s: float = 0.0
    place: list[int] = field(init=False)  # the next act of each flow
    left: dict[int, int] = field(default_factory=dict)  # chunks that a flow waits for
    waiting: dict[int, list[int]] = field(default_factory=dict)  # flows for a flow
    ended: set[int] = field(default_factory=set)  # flows
    ready: list[int] = field(default_factory=list)  # flows that want their turn
    turn: int | None = None
    queue: list[tuple[float, int, float, int]] = field(default_factory=list)
    events: list[tuple[float, int, str, int]] = field(default_factory=list)
    numbers: Iterator[int] = field(default_factory=count)

    def __post_init__(self) -> None:
        self.place = [0] * len(self.flows)

    def run(self) -> float:
        """Return when the main flow, and with it the compile, ends, s."""
        self.ready = list(range(len(self.flows)))
        self._begin()
        while 0 not in self.ended:
            self.now_s, _, what, flow = heapq.heappop(self.events)
            if what == "chunk":
                self.free += 1
                self.left[flow] -= 1
                if not self.left[flow]:
                    self.ready.append(flow)
            else:
                self._go_on(flow)
            self._begin()
        return self.now_s

    def _begin(self) -> None:
        """Give the turn and the free cores to who waits for them."""
        if self.turn is None and self.ready:
            self.turn = self.ready.pop(0)
            self._go_on(self.turn)
        while self.free and self.queue:
            *_, took_s, flow = heapq.heappop(self.queue)
            self.free -= 1
            self._at(self.now_s + took_s, "chunk", flow)

    def _go_on(self, flow: int) -> None:
        """Do the next act of the flow that has its turn."""
        if self.place[flow] == len(self.flows[flow]):
            self.ended.add(flow)
            self.ready += self.waiting.pop(flow, [])
            self._yield()
            return
        act = self.flows[flow][self.place[flow]]
        self.place[flow] += 1
        if isinstance(act, float):
            self._at(self.now_s + act, "work", flow)
        elif isinstance(act, Chunks):
            self._hand_over(act, flow)
        elif act in self.ended:
            self._at(self.now_s, "work", flow)
        else:
            self.waiting.setdefault(act, []).append(flow)
            self._yield()

    def _hand_over(self, act: Chunks, flow: int) -> None:
        if not act.took_s:
            self._at(self.now_s, "work", flow)
            return
        self.left[flow] = len(act.took_s)
        for took_s in act.took_s:
            turn = (-act.priority, next(self.numbers))
            heapq.heappush(self.queue, (*turn, took_s, flow))
        self._yield()

    def _yield(self) -> None:
        self.turn = None
        if self.ready:
            self.turn = self.ready.pop(0)
            self._go_on(self.turn)

    def _at(self, when_s: float, what: str, flow: int) -> None:
        heapq.heappush(self.events, (when_s, next(self.numbers), what, flow))


def replayed_s(flows: list[Flow], cores: int) -> float:
    """Return how long control flows take on so many cores, two at least, s."""
    return _Machine(flows, cores - 1).run()


def longest_chain_s(flows: list[Flow]) -> float:
    """Return the longest chain of dependent work: no number of cores takes less, s."""
    ends: dict[int, float] = {}

    def end_s(flow: int) -> float:
        if flow not in ends:
            at_s = 0.0
            for act in flows[flow]:
                if isinstance(act, Chunks):
                    at_s += max(act.took_s, default=0.0)
                else:
                    at_s = (
                        at_s + act if isinstance(act, float) else max(at_s, end_s(act))
                    )
            ends[flow] = at_s
        return ends[flow]

    return end_s(0)


def _measure(_options: Options) -> Iterator[Figure]:
    flows = noted("balanced")
    own_s = sum(act for flow in flows for act in flow if isinstance(act, float))
    chunks_s = sum(
        sum(act.took_s) for flow in flows for act in flow if isinstance(act, Chunks)
    )
    ends_s = replayed_s(flows, CORES)
    values = (
        (ends_s, "s"),
        ((own_s + chunks_s) / ends_s, "1"),
        (longest_chain_s(flows), "s"),
        (own_s / (own_s + chunks_s), "1"),
    )
    for name, (value, unit) in zip(NAMES, values, strict=True):
        yield Figure(name=name, value=value, unit=unit)


BENCHMARK = Benchmark(names=NAMES, measure=_measure)
