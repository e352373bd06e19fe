"""What hostile files cost: `microplan check` on each of them, as a user calls it.

`python -m benchmarks.robustness.hostile [WORD...]` prints a row for each file whose
name holds one of the words: its status, what is said first, wall time and largest
memory.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.example import TASK
from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.robustness import hostile_dxf, hostile_gds, hostile_paths, hostile_yaml
from benchmarks.robustness.hostile_task import Case, lay_out

GIVE_UP_S = 300.0  # of waiting, as for a pipe
MOST_CPU_S = 20
KIB_PER_MB = 1024.0
MOST_BYTES = 4 << 30  # of memory
MOST_SAID = 1 << 20  # bytes of output: more is no message
FLOORS = 5  # runs of the gear example, of which the fastest counts
NAMES = (
    "hostile.worst_s",
    "hostile.worst_cpu_s",
    "hostile.worst_mb",
    "hostile.failures",
    "hostile.files",
)
GROUPS = {
    "paths": hostile_paths, "yaml": hostile_yaml, "dxf": hostile_dxf,
    "gds": hostile_gds,
}  # fmt: skip
_HEADLINE = re.compile(r"^(error|infeasible)\[(MP\d{3})\]: (.*)$", re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Spent:
    """What one call of the command took and said."""

    status: int  # negative: the signal that ended it
    wall_s: float
    cpu_s: float
    peak_mb: float
    said: str
    said_bytes: int

    @property
    def pointed(self) -> bool:
        """Return whether the status and what is said belong together."""
        if self.status == 0:
            return "Traceback" not in self.said
        found = _HEADLINE.search(self.said)
        return bool(found) and "Traceback" not in self.said and self.status in (1, 2)

    @property
    def first(self) -> str:
        """Return the first reason that is said."""
        found = _HEADLINE.search(self.said)
        return f"{found[2]} {found[3]}" if found else self.said[:200]


def cases() -> Iterator[Case]:
    """Yield everything hostile that is tried."""
    for group in GROUPS.values():
        yield from group.cases()


def failed(case: Case, spent: Spent) -> bool:
    """Return whether a file was met as it should not be."""
    return (
        spent.status not in case.statuses
        or not spent.pointed
        or spent.said_bytes > MOST_SAID
    )


def check(case: Case) -> Spent:
    """Return what `microplan check` says of a case, and what it takes."""
    with TemporaryDirectory() as name:
        folder = Path(name) / "job"
        lay_out(folder)
        case.put(folder)
        return spent(
            [sys.executable, "-m", "microplan.planner.cli.main", "check", "task.yaml"],
            folder,
        )


def spent(call: Sequence[str], folder: Path) -> Spent:
    """Run a command in a folder; the kernel says what it took."""
    root = str(Path(__file__).parents[2])
    env = {**os.environ, "PYTHONPATH": root, "OPENBLAS_NUM_THREADS": "1"}
    started = time.perf_counter()
    with subprocess.Popen(
        call, cwd=folder, env=env, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        preexec_fn=_limited,  # noqa: PLW1509 - no other thread is at work
    ) as process:  # fmt: skip
        stop = threading.Timer(GIVE_UP_S, process.kill)
        stop.start()
        if process.stdout is None:
            raise RuntimeError("its output is not ours to read")
        said = process.stdout.read(2 * MOST_SAID)
        if len(said) == 2 * MOST_SAID:
            process.kill()  # it may go on for gigabytes
        _, status, usage = os.wait4(process.pid, 0)
        wall_s = time.perf_counter() - started
        stop.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
    return Spent(
        status=process.returncode,
        wall_s=wall_s,
        cpu_s=usage.ru_utime + usage.ru_stime,
        peak_mb=usage.ru_maxrss / KIB_PER_MB,
        said=said.decode("utf-8", "replace"),
        said_bytes=len(said),
    )


def _limited() -> None:
    """Let the command have no more memory and time than a machine can spare."""
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_S, MOST_CPU_S))
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))


def main(argv: Sequence[str] | None = None) -> int:
    """Print what each file gives; return 1 if one was met as it should not be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--slower", type=float, default=0.0, metavar="S")
    parser.add_argument("--group", choices=sorted(GROUPS))
    call = parser.parse_args(argv)
    wrong = 0
    print("| file | says | s | CPU s | MB |")
    print("|---|---|---|---|---|")
    for case in GROUPS[call.group].cases() if call.group else cases():
        if call.words and not any(word in case.name for word in call.words):
            continue
        found = check(case)
        bad = failed(case, found)
        wrong += bad
        if bad or found.cpu_s >= call.slower:
            print(row(case, found, bad=bad), flush=True)
    print(f"\n{wrong} wrong")
    return int(wrong > 0)


def row(case: Case, found: Spent, *, bad: bool) -> str:
    """Return a row of the table."""
    said = found.first if len(found.first) <= 120 else found.first[:117] + "..."
    said = f"{found.status} {said}" if found.status else "0"
    mark = "**wrong** " if bad else ""
    text = said.replace("|", "\\|").replace("\n", " ")
    costs = f"{found.wall_s:.2f} | {found.cpu_s:.2f} | {found.peak_mb:.0f}"
    return f"| {case.name} | {mark}{text} | {costs} |"


def _measure(_options: Options) -> Iterator[Figure]:
    call = [sys.executable, "-m", "microplan.planner.cli.main", "check", str(TASK)]
    floors = [spent(call, TASK.parent) for _ in range(FLOORS)]
    found = [(case, check(case)) for case in cases()]
    yield from figures(found, floors)


def figures(
    found: Sequence[tuple[Case, Spent]], floors: Sequence[Spent]
) -> Iterator[Figure]:
    """Return the worst of all files; the floor is the gear example's check."""
    for name, unit, worst, floor in (
        (NAMES[0], "s", _most(s.wall_s for _, s in found), [f.wall_s for f in floors]),
        (NAMES[1], "s", _most(s.cpu_s for _, s in found), [f.cpu_s for f in floors]),
        (NAMES[2], "MB", _most(s.peak_mb for _, s in found),
         [f.peak_mb for f in floors]),
    ):  # fmt: skip
        yield Figure(name=name, value=worst, unit=unit, floor=min(floor))
    wrong = sum(failed(case, spent) for case, spent in found)
    yield Figure(name=NAMES[3], value=wrong, unit="files")
    yield Figure(name=NAMES[4], value=len(found), unit="files")


def _most(values: Iterable[float]) -> float:
    return max(values)


BENCHMARK = Benchmark(names=NAMES, measure=_measure)

if __name__ == "__main__":
    sys.exit(main())
