"""A cached compile: reused while no file that it read has changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from microplan.planner.source.diagnostics import Diagnostic
from microplan.planner.source.saved_files import file_sha256
from microplan.planner.store.canonical import CanonicalError, decode, encode
from microplan.planner.store.memo import digest
from microplan.planner.store.store import Store


@dataclass(frozen=True, slots=True, kw_only=True)
class Whole:
    """What a compile read, found and made."""

    files: Mapping[str, str]  # path -> sha256 of what it held
    findings: tuple[Diagnostic, ...]
    made: Any  # microplan.planner.store.folder.PlanBytes


def remembered(store: Store, task: str, options: tuple[Any, ...]) -> Whole | None:
    """Return the compile of a task, None if there was none or a file has changed.

    Parameters
    ----------
    store : Store
        Where compiles are kept.
    task : str
        The task file as the user names it: findings name it like that.
    options : tuple
        What of the command line changes the plan.
    """
    key = _key(task, options)
    kept = None if key is None else store.get(key)
    if kept is None:
        return None
    try:
        found = decode(kept)
    except CanonicalError:
        return None
    if not isinstance(found, Whole):
        return None
    same = all(file_sha256(path) == known for path, known in found.files.items())
    return found if same else None


def remember(store: Store, task: str, options: tuple[Any, ...], whole: Whole) -> None:
    """Keep a compile."""
    key = _key(task, options)
    if key is not None and whole.files.get(str(Path(task))) == file_sha256(task):
        store.put(key, encode(whole))


def _key(task: str, options: tuple[Any, ...]) -> str | None:
    """Return the key of a compile, None if the task cannot be read."""
    found = file_sha256(task)
    return None if found is None else digest("whole", task, found, options)
