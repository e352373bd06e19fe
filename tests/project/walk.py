"""Walk through a page of docs/: write its files, run its commands, compare the output.

A block ```python FILE, ```yaml FILE or ```toml FILE is the whole text of a file, one
```diff FILE a change of it. A block ```console has commands behind `$ `, each followed
by what it prints: lines in order, in words exactly and in numbers nearly. Lines may be
left out, which `...` shows to the reader.
"""

from __future__ import annotations

import re
import runpy
import shlex
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import microplan.executor.cli.main
import microplan.planner.cli.main

BLOCK = re.compile(r"^```(\w+) ?(\S*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
NEARLY = 0.25  # of a number: trials on another machine may differ in a borderline one
LEAST = 0.02  # by which a number may differ anyway
PROGRAMS: dict[str, Callable[[list[str]], int]] = {
    "microplan": microplan.planner.cli.main.main,
    "microplan-run": microplan.executor.cli.main.main,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """What a page says a command prints, and what it printed."""

    command: str
    expected: tuple[str, ...]
    printed: tuple[str, ...]
    status: int

    def missing(self) -> list[str]:
        """Return the expected lines that were not printed, in order."""
        rest, lacking = iter(self.printed), []
        for line in self.expected:
            if line != "..." and not any(alike(line, other) for other in rest):
                lacking.append(line)
        return lacking


def walk(page: Path, folder: Path, read: Callable[[], str]) -> Iterator[Said]:
    """Do what a page says, in `folder`, which must be the present one.

    `read` returns what was printed since it was called last.
    """
    for kind, name, body in BLOCK.findall(page.read_text(encoding="utf-8")):
        if kind == "console":
            for command, expected in calls(body):
                status = run(command)
                printed = tuple(line.rstrip() for line in read().splitlines())
                yield Said(
                    command=command, expected=expected, printed=printed, status=status
                )
        elif name and kind == "diff":
            change(folder / name, body)
        elif name:
            (folder / name).write_text(body, encoding="utf-8")


def calls(body: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the commands of a block and the lines that follow each."""
    for part in re.split(r"^\$ ", body, flags=re.MULTILINE)[1:]:
        command, *lines = part.splitlines()
        yield command, tuple(line.rstrip() for line in lines if line.strip())


def run(command: str) -> int:
    """Return the exit status of a command, run in this process."""
    program, *words = shlex.split(command, comments=True)
    return _python(words) if program == "python" else PROGRAMS[program](words)


def _python(words: list[str]) -> int:
    """Return the exit status of a script, or of a module behind -m."""
    before, sys.argv = sys.argv, words[words[0] == "-m" :]
    try:
        if words[0] == "-m":
            sys.modules.pop(f"{words[1]}.__main__", None)  # imported by another test
            runpy.run_module(words[1], run_name="__main__", alter_sys=True)
        else:
            runpy.run_path(words[0], run_name="__main__")
    except SystemExit as leaving:
        return int(leaving.code or 0)
    finally:
        sys.argv = before
    return 0


def change(file: Path, body: str) -> None:
    """Replace what a diff takes away by what it adds, once."""
    lines = body.splitlines()
    old = "\n".join(line[1:] for line in lines if line[:1] in "- ")
    new = "\n".join(line[1:] for line in lines if line[:1] in "+ ")
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{file.name} holds {old!r} {text.count(old)} times"
    file.write_text(text.replace(old, new), encoding="utf-8")


def alike(line: str, other: str) -> bool:
    """Return whether two lines have the same words and nearly the same numbers.

    A line that ends in ` ...` need only begin alike.
    """
    words, others = line.split(), other.split()
    if words[1:] and words[-1] == "...":
        words.pop()
        others = others[: len(words)]
    line, other = " ".join(words), " ".join(others)
    if NUMBER.sub("#", line) != NUMBER.sub("#", other):
        return False
    pairs = zip(NUMBER.findall(line), NUMBER.findall(other), strict=True)
    return all(
        abs(float(a) - float(b)) <= max(LEAST, NEARLY * abs(float(b))) for a, b in pairs
    )
