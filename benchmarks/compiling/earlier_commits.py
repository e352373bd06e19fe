"""CPU time of a cold compile over that of earlier commits, in the same run.

The commits' trees are taken from this repository and run by the same interpreter. Each
compile is a process of its own with one job, one thread and an empty cache.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.example import ROOT, TASK
from benchmarks.figures import Benchmark, Figure, Options

_ENTRY = "from microplan.planner.cli.main import main"
_THREADS = ("OMP", "OPENBLAS", "MKL", "OPENCV_FOR", "NUMEXPR")


@dataclass(frozen=True, slots=True, kw_only=True)
class Commit:
    """A state of this repository that compiles the gear-on-shaft example."""

    name: str  # as git knows it; "": the files as they are
    entry: str = _ENTRY  # how the command line is imported


NOW = Commit(name="")
# the first version, and one whose trials' images read no distances from edges
OLD = Commit(name="ab34087", entry="from planner.cli import main")
BEFORE = Commit(name="8c0ed426")
# preset, and the commit that its CPU time is divided by
RATIOS: Mapping[str, tuple[str, Commit]] = {
    "compile.cpu_ratio_old": ("balanced", OLD),
    "compile.fast_ratio_old": ("fast", OLD),
    "compile.cpu_ratio_before": ("balanced", BEFORE),
}


def cpu_s(tree: Path, commit: Commit, preset: str, folder: Path) -> float:
    """Return the CPU time of one cold compile with a tree's own code and example.

    Raises
    ------
    RuntimeError
        If the compiler does not end with status 0.
    """
    code = (
        f"import sys; sys.path.insert(0, {str(tree)!r}); {commit.entry}; "
        "sys.exit(main(sys.argv[1:]))"
    )
    task, out = tree / TASK.relative_to(ROOT), folder / "plan"
    call = [sys.executable, "-c", code, "compile", str(task), "-o", str(out)]
    call += ["--preset", preset, "--jobs", "1", "--cache", str(folder / "cache")]
    alone = {f"{name}_NUM_THREADS": "1" for name in _THREADS}
    log = folder / "log"
    with log.open("w") as said:
        process = subprocess.Popen(
            call, stdout=said, stderr=said, cwd=tree, env={**os.environ, **alone}
        )
        _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{call} ended with {process.returncode}: {log.read_text()}")
    return usage.ru_utime + usage.ru_stime


def unpack(commit: Commit, folder: Path) -> Path:
    """Return a folder with a commit's files; the repository itself for none."""
    if not commit.name:
        return ROOT
    tree = folder / commit.name
    packed = subprocess.run(
        ["git", "archive", commit.name], cwd=ROOT, capture_output=True, check=True
    ).stdout
    with tarfile.open(fileobj=BytesIO(packed)) as archive:
        archive.extractall(tree, filter="data")
    return tree


def spent_s(commits: Sequence[Commit], preset: str) -> list[float]:
    """Return the CPU times of compiles, one after the other."""
    found = []
    with TemporaryDirectory() as name:
        for number, commit in enumerate(commits):
            folder = Path(name) / f"{number}"
            folder.mkdir()
            tree = unpack(commit, Path(name))
            found.append(cpu_s(tree, commit, preset, folder))
    return found


def _measure(_options: Options) -> Iterator[Figure]:
    for preset in ("balanced", "fast"):
        rivals = {name: by for name, (own, by) in RATIOS.items() if own == preset}
        now, *others = spent_s([NOW, *rivals.values()], preset)
        for name, other in zip(rivals, others, strict=True):
            yield Figure(name=name, value=now / other, unit="1")


BENCHMARK = Benchmark(names=tuple(RATIOS), measure=_measure)
