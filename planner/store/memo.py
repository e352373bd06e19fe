"""Memoised results of pure functions, kept in a store."""

from __future__ import annotations

import hashlib
import importlib
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from types import FunctionType, MethodType
from typing import Any, ParamSpec, TypeVar

from microplan.planner.store.canonical import PACKAGES, CanonicalError, decode, encode
from microplan.planner.store.store import Store

P = ParamSpec("P")
R = TypeVar("R")
A = TypeVar("A")
B = TypeVar("B")

# what numbers come from besides our own sources
_LIBRARIES = (
    "numpy", "scipy", "opencv-contrib-python-headless", "shapely", "ezdxf", "numba",
    "llvmlite",
)  # fmt: skip
_FUNCTIONS = (FunctionType, MethodType, type)  # `map` itself is a type


@dataclass(frozen=True, slots=True)
class Memo:
    """Results of calls, by function, arguments and the sources of this project.

    Without a store every call is made.
    """

    store: Store | None = None

    def call(self, function: Callable[P, R], /, *args: P.args, **kwargs: P.kwargs) -> R:
        """Return what `function` returns for these arguments.

        It must be pure: its result may depend on its arguments alone, and must have
        bytes (`canonical.encode`). Keywords that say how to run are no part of the key:
        functions, as a pool's map, and what is not frozen, as a cache.
        """
        if self.store is None:
            return function(*args, **kwargs)
        meant = {k: v for k, v in kwargs.items() if not _is_means(v)}
        key = digest(_name(function), args, meant)
        for found in self._kept(key):
            kept: R = found
            return kept
        return self._put(key, function(*args, **kwargs))

    def each(
        self,
        function: Callable[[A, B], R],
        first: A,
        items: Sequence[B],
        spread: Callable[[Callable[[B], R], Sequence[B]], Iterable[R]],
    ) -> list[R]:
        """Return what `function` returns for `first` and each item, in order.

        Calls that have to be made are handed to `spread`, a `map`.
        """
        if self.store is None:
            return list(spread(partial(function, first), items))
        shared = encode(first)
        keys = [digest(_name(function), shared, item) for item in items]
        kept = [list(self._kept(key)) for key in keys]
        lacking = [item for item, each in zip(items, kept, strict=True) if not each]
        fresh = iter(spread(partial(function, first), lacking))
        return [
            found[0] if found else self._put(key, next(fresh))
            for key, found in zip(keys, kept, strict=True)
        ]

    def _kept(self, key: str) -> Iterator[Any]:
        """Yield the result under a key, if there is one."""
        kept = None if self.store is None else self.store.get(key)
        if kept is None:
            return
        try:
            found = decode(kept)
        except CanonicalError:
            return  # of another version's types: as if it were not there
        yield found

    def _put(self, key: str, result: R) -> R:
        """Keep a result, and return it."""
        if self.store is not None:
            self.store.put(key, encode(result))
        return result


EVERY_TIME = Memo()  # keeps nothing, makes every call


def digest(*values: Any) -> str:
    """Return a key for values: another one for other values, sources or libraries."""
    return hashlib.sha256(sources().encode() + encode(values)).hexdigest()


def _is_means(argument: object) -> bool:
    """Return whether an argument is no value: a function, or what may change."""
    made = getattr(argument, "__dataclass_params__", None)
    return isinstance(argument, _FUNCTIONS) or (made is not None and not made.frozen)


def _name(function: Callable[..., Any]) -> str:
    return f"{function.__module__}:{function.__qualname__}"


@cache
def sources() -> str:
    """Return the digest of all that computes: our sources and the libraries below."""
    found = hashlib.sha256(sys.version.encode())
    for name in _LIBRARIES:
        found.update(f"{name} {version(name)}".encode())
    for root, file in source_files():
        found.update(file.relative_to(root).as_posix().encode() + b"\0")
        found.update(hashlib.sha256(file.read_bytes()).digest())
    return found.hexdigest()


def source_files() -> Iterator[tuple[Path, Path]]:
    """Yield each package's folder with each of its files that results come from."""
    packages = {"microplan": "*"} | {f"microplan.{p}": "**/*" for p in PACKAGES}
    for package, pattern in packages.items():
        root = Path(str(importlib.import_module(package).__file__)).parent
        for file in sorted(root.glob(pattern)):
            if file.suffix in (".py", ".json"):  # code, and the schemas beside it
                yield root, file
