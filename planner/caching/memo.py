"""Calls of pure functions that are not made twice."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from planner.caching.canonical import PACKAGES, CanonicalError, decode, encode
from planner.caching.store import Store

P = ParamSpec("P")
R = TypeVar("R")

# what numbers come from besides our own sources
_LIBRARIES = (
    "numpy", "scipy", "opencv-contrib-python-headless", "shapely", "ezdxf",
)  # fmt: skip
_NOT_MEANT = frozenset({"map"})  # arguments that change no result


@dataclass(frozen=True, slots=True)
class Memo:
    """Results of calls, by function, arguments and the sources of this project.

    Without a store every call is made.
    """

    store: Store | None = None

    def call(self, function: Callable[P, R], /, *args: P.args, **kwargs: P.kwargs) -> R:
        """Return what `function` returns for these arguments.

        It must be pure: its result may depend on its arguments alone, those called
        `map` left out, and must have bytes (`canonical.encode`).
        """
        if self.store is None:
            return function(*args, **kwargs)
        meant = {k: v for k, v in kwargs.items() if k not in _NOT_MEANT}
        key = digest(f"{function.__module__}:{function.__qualname__}", args, meant)
        kept = self.store.get(key)
        if kept is not None:
            try:
                found: R = decode(kept)
            except CanonicalError:
                pass  # of another version's types: as if it were not there
            else:
                return found
        result = function(*args, **kwargs)
        self.store.put(key, encode(result))
        return result


EVERY_TIME = Memo()  # keeps nothing, makes every call


def digest(*values: Any) -> str:
    """Return a key for values: another one for other values, sources or libraries."""
    return hashlib.sha256(sources().encode() + encode(values)).hexdigest()


@cache
def sources() -> str:
    """Return the digest of all that computes: our sources and the libraries below."""
    found = hashlib.sha256(sys.version.encode())
    for name in _LIBRARIES:
        found.update(f"{name} {version(name)}".encode())
    for package in PACKAGES:
        module = sys.modules.get(package) or __import__(package)
        root = Path(str(module.__file__)).parent
        for file in sorted(root.rglob("*.py")):
            found.update(file.relative_to(root).as_posix().encode() + b"\0")
            found.update(hashlib.sha256(file.read_bytes()).digest())
    return found.hexdigest()
