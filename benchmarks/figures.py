"""One measured figure: a name that stays, a value, and what it is compared with."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from microplan.executor.simulated.cameras.kinds import CameraKind

Form = dict[str, str | float]

TIMES = ("s", "ms", "us")


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One number, with the floor and the rival measured in the same run.

    The floor is the least work that could do the job, the rival the way it would be
    done without this package; both have the value's unit. A time below its floor was
    not spent on the job: something kept its result.
    """

    name: str
    value: float
    unit: str  # "1" for numbers without one
    floor: float | None = None
    rival: float | None = None

    def __post_init__(self) -> None:
        for value in (self.value, self.floor, self.rival):
            if value is not None and not math.isfinite(value):
                raise ValueError(f"{self.name} must be finite, got {value}")
        for value in (self.floor, self.rival):
            if value is not None and value <= 0:
                raise ValueError(f"{self.name} is divided by {value}, need > 0")
        if self.unit in TIMES and self.floor is not None and self.value < self.floor:
            raise ValueError(
                f"{self.name} took {self.value:.3g} {self.unit}, "
                f"less than its floor of {self.floor:.3g}"
            )

    def form(self) -> Form:
        """Return the figure as it is printed and kept; ratios are value / other."""
        found: Form = {"name": self.name, "value": self.value, "unit": self.unit}
        if self.floor is not None:
            found |= {"floor": self.floor, "ratio_floor": self.value / self.floor}
        if self.rival is not None:
            found |= {"rival": self.rival, "ratio_rival": self.value / self.rival}
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What the command line says about the runs of the compiled example."""

    seeds: range = range(100, 200)
    jobs: int = 2
    plan: Path | None = None  # a compiled plan.json; None: compile it first
    camera: CameraKind = "solid"  # of the simulated cell in whole runs


@dataclass(frozen=True, slots=True, kw_only=True)
class Benchmark:
    """A function that measures the figures called `names`."""

    names: tuple[str, ...]
    measure: Callable[[Options], Iterable[Figure]]
    may_lack: frozenset[str] = frozenset()  # names of what is not always there


def select(known: Sequence[Benchmark], wanted: Sequence[str]) -> list[Benchmark]:
    """Return the benchmarks that make a figure whose name starts as wanted.

    Parameters
    ----------
    known : sequence of Benchmark
        In the order in which they run.
    wanted : sequence of str
        Names of figures, or their first words; none means all.

    Raises
    ------
    ValueError
        If a name selects nothing; the message lists the known ones.
    """
    names = [name for benchmark in known for name in benchmark.names]
    for want in wanted:
        if not any(_starts(name, want) for name in names):
            raise ValueError(f"no figure {want!r}, known: {', '.join(names)}")
    return [
        benchmark
        for benchmark in known
        if not wanted or any(_starts(n, w) for n in benchmark.names for w in wanted)
    ]


def run(chosen: Sequence[Benchmark], options: Options) -> Iterator[Figure]:
    """Measure one benchmark after the other.

    Raises
    ------
    ValueError
        If one makes other figures than it says.
    """
    for benchmark in chosen:
        made = []
        for figure in benchmark.measure(options):
            made.append(figure.name)
            yield figure
        lack = benchmark.may_lack - set(made)
        if made != [name for name in benchmark.names if name not in lack]:
            raise ValueError(f"made {made}, not {list(benchmark.names)}")


def write(figures: Sequence[Figure], path: Path) -> None:
    """Write the figures of one run as a JSON list."""
    text = json.dumps([figure.form() for figure in figures], indent=2)
    path.write_text(text + "\n", encoding="utf-8")


def _starts(name: str, want: str) -> bool:
    """Return whether `want` is `name` or its first words."""
    return name == want or name.startswith(want + ".")
