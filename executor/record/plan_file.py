"""Plan files: the plan, with the bytes it was read from."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from microplan.executor.devices.errors import ExecutorError
from microplan.schemas.codec import CodecError, from_data
from microplan.schemas.files.world import World
from microplan.schemas.folders import contents
from microplan.schemas.plan import Plan, parse_plan

_NO_FILE = frozenset('/\\:*?"<>|')  # of Windows' names, which take in all others
_MOST_WORLD = 1 << 26  # bytes
_MOST = 200  # bytes; a file's name has 255, its additions included


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanFile:
    """A plan and the bytes it was read from."""

    plan: Plan
    source: bytes

    @property
    def sha256(self) -> str:
        """Return the hash of the bytes."""
        return hashlib.sha256(self.source).hexdigest()


def read_plan(path: Path) -> PlanFile:
    """Return the plan of a file, or raise MP802."""
    try:
        source = path.read_bytes()
    except OSError as error:
        words = f"cannot read {path}: {error.strerror}"
        if isinstance(error, FileNotFoundError):
            words += "; microplan compile makes a plan folder"
        raise ExecutorError("MP802", words) from error
    try:
        plan = parse_plan(source.decode("utf-8"))
        _check_names(plan)
        return PlanFile(plan=plan, source=source)
    except (UnicodeDecodeError, CodecError) as error:
        words = str(error)
        if path.suffix in (".yaml", ".yml"):
            words = f"{path} is a task, no plan: compile it first (microplan compile)"
        raise ExecutorError("MP802", words) from error


def world_beside(folder: Path) -> World | None:
    """Return the world of a plan folder, None where it is missing or damaged.

    Nothing in a run depends on it but the simulated cell, which reads it by itself.
    """
    source = contents(folder / "world.json", _MOST_WORLD)
    try:
        return from_data(World, json.loads(source))
    except (ValueError, RecursionError, CodecError):
        return None


def _check_names(plan: Plan) -> None:
    """Refuse names that can be no part of a file's name, and two steps of one name."""
    ids = [step.id for step in plan.steps]
    for what, name in [("name", plan.name), *(("step", found) for found in ids)]:
        if not _fits(name):
            raise CodecError(f"{what} {name[:40]!r} can be no part of a file's name")
    twice = next((name for k, name in enumerate(ids) if name in ids[:k]), None)
    if twice is not None:  # the journal distinguishes steps by their names
        raise CodecError(f"two steps are called {twice!r}")


def _fits(name: str) -> bool:
    """Return whether a name can be part of a file's."""
    plain = name.isprintable() and not set(name) & _NO_FILE
    return plain and 0 < len(name.encode()) <= _MOST
