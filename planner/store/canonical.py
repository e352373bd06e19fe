"""Canonical serialisation: equal values give equal bytes, none runs code when read.

Written are None, bool, int, float, str, bytes, tuples, lists, frozensets, mappings,
numpy arrays of numbers, and frozen dataclasses of this project. A number of numpy comes
back as Python's. What is read may build such dataclasses and nothing else.
"""

from __future__ import annotations

import dataclasses
import importlib
import struct
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np

from microplan.optics.transfer.lru import Recent

PACKAGES = ("optics", "featuresel", "schemas", "planner")
_NUMBERS = "biufc"  # kinds of numpy's types that hold no objects
_DEEPEST = 200
# frozen to its numbers, large, and held by many
_SHARED = "microplan.optics.outline.outline:Outline"
# a value takes some seven times its bytes
_made: Recent[tuple[Any, bytes]] = Recent(1 << 24, lambda made: 8 * len(made[1]))


class CanonicalError(ValueError):
    """A value that has no such bytes, or bytes that are no value."""


# what reading other bytes may raise; SyntaxError: numpy's, of names of types
_UNREADABLE = (
    ValueError, TypeError, AttributeError, ImportError, SyntaxError, struct.error,
)  # fmt: skip


def encode(value: Any) -> bytes:
    """Return the bytes of a value.

    Raises
    ------
    CanonicalError
        If it holds something that is not listed above.
    """
    return b"".join(_parts(value, 0))


def decode(data: bytes) -> Any:
    """Return the value that `encode` wrote.

    Raises
    ------
    CanonicalError
        If the bytes are cut short, longer than the value, or of another kind.
    """
    reader = _ByteReader(data)
    try:
        value = reader.value(0)
    except CanonicalError:
        raise
    except _UNREADABLE as error:
        raise CanonicalError(f"not a value: {error}") from error
    if reader.at != len(data):
        raise CanonicalError(f"{len(data) - reader.at} bytes after the value")
    return value


def _parts(value: Any, depth: int) -> Iterator[bytes]:
    """Yield the bytes of a value in pieces."""
    if depth > _DEEPEST:
        raise CanonicalError(f"deeper than {_DEEPEST}")
    simple = _simple(value)
    if simple is not None:
        yield simple
    elif isinstance(value, np.ndarray):
        yield from _array(value)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        if _name(value) == _SHARED:
            yield _shared(value, depth)
        else:
            yield from _record(value, depth)
    elif isinstance(value, Mapping):
        yield _head(b"M", len(value))
        for key, each in value.items():
            yield from _parts(key, depth + 1)
            yield from _parts(each, depth + 1)
    elif isinstance(value, (tuple, list)):
        yield _head(b"T" if isinstance(value, tuple) else b"L", len(value))
        for each in value:
            yield from _parts(each, depth + 1)
    elif isinstance(value, frozenset):
        yield _head(b"F", len(value))
        yield from sorted(b"".join(_parts(each, depth + 1)) for each in value)
    else:
        raise CanonicalError(f"no bytes for {type(value).__name__}")


def _simple(value: Any) -> bytes | None:
    """Return the bytes of a value without parts, None if it has some."""
    if value is None:
        return b"N"
    if isinstance(value, (bool, np.bool_)):
        return b"1" if value else b"0"
    if isinstance(value, (int, np.integer)):
        return _text(b"i", str(int(value)))
    if isinstance(value, (float, np.floating)):
        return b"d" + struct.pack("<d", float(value))
    if isinstance(value, str):
        return _text(b"s", value)
    if isinstance(value, bytes):
        return _head(b"b", len(value)) + value
    return None


def _text(tag: bytes, text: str) -> bytes:
    data = text.encode("utf-8", "surrogatepass")
    return _head(tag, len(data)) + data


def _head(tag: bytes, count: int) -> bytes:
    return tag + struct.pack("<Q", count)


def _array(value: np.ndarray[Any, Any]) -> Iterator[bytes]:
    """Yield an array's type, shape and numbers, row by row."""
    if value.dtype.kind not in _NUMBERS:
        raise CanonicalError(f"no bytes for arrays of {value.dtype}")
    yield _text(b"A", value.dtype.str)
    yield b"".join(_parts(tuple(value.shape), 0))
    yield np.ascontiguousarray(value).tobytes()


def _shared(value: Any, depth: int) -> bytes:
    """Return the bytes of a value that many others hold, made once."""

    def made() -> tuple[Any, bytes]:
        return value, b"".join(_record(value, depth))

    _, data = _made.get(id(value), made)  # held, so that no other gets its id
    return data


def _record(value: Any, depth: int) -> Iterator[bytes]:
    """Yield a dataclass by its name and fields."""
    cls, name = type(value), _name(value)
    if cls is not _class(name):
        raise CanonicalError(f"{name} cannot be found again")
    yield _text(b"D", name)
    fields = [f.name for f in dataclasses.fields(value) if f.init]
    yield _head(b"", len(fields))
    for field in fields:
        yield _text(b"", field)
        yield from _parts(getattr(value, field), depth + 1)


def _name(value: Any) -> str:
    """Return the name of a value's type, as `_class` takes it."""
    return f"{type(value).__module__}:{type(value).__qualname__}"


@cache
def _class(name: str) -> type:
    """Return a frozen dataclass of this project by its name."""
    module, _, path = name.partition(":")
    root, _, inner = module.partition(".")
    if root != "microplan" or inner.partition(".")[0] not in PACKAGES:
        raise CanonicalError(f"{name} is not of this project")
    found: Any = importlib.import_module(module)
    for part in path.split("."):
        found = getattr(found, part)
    parameters = getattr(found, "__dataclass_params__", None)
    if not isinstance(found, type) or parameters is None or not parameters.frozen:
        raise CanonicalError(f"{name} is no frozen dataclass")
    return found


class _ByteReader:
    """Reads values from bytes, one after the other."""

    def __init__(self, data: bytes) -> None:
        self._data = memoryview(data)
        self.at = 0
        self._readers: Mapping[bytes, Callable[[int], Any]] = {
            b"N": lambda _: None, b"1": lambda _: True, b"0": lambda _: False,
            b"i": lambda _: int(self._string()), b"s": lambda _: self._string(),
            b"d": lambda _: struct.unpack("<d", self._take(8))[0],
            b"b": lambda _: bytes(self._take(self._count())),
            b"T": lambda depth: tuple(self._values(depth)), b"L": self._values,
            b"F": lambda depth: frozenset(self._values(depth)),
            b"M": self._mapping, b"A": self._array, b"D": self._record,
        }  # fmt: skip

    def value(self, depth: int) -> Any:
        """Return the next value."""
        if depth > _DEEPEST:
            raise CanonicalError(f"deeper than {_DEEPEST}")
        tag = bytes(self._take(1))
        if tag not in self._readers:
            raise CanonicalError(f"no value begins with {tag!r}")
        return self._readers[tag](depth)

    def _take(self, count: int) -> memoryview:
        if count > len(self._data) - self.at:
            raise CanonicalError(f"ends {count} bytes too early")
        self.at += count
        return self._data[self.at - count : self.at]

    def _count(self) -> int:
        (count,) = struct.unpack("<Q", self._take(8))
        if count > len(self._data) - self.at:  # every part takes a byte at least
            raise CanonicalError(f"{count} parts in {len(self._data)} bytes")
        return int(count)

    def _string(self) -> str:
        return bytes(self._take(self._count())).decode("utf-8", "surrogatepass")

    def _values(self, depth: int) -> list[Any]:
        return [self.value(depth + 1) for _ in range(self._count())]

    def _mapping(self, depth: int) -> dict[Any, Any]:
        pairs = range(self._count())
        return {self.value(depth + 1): self.value(depth + 1) for _ in pairs}

    def _array(self, _depth: int) -> np.ndarray[Any, Any]:
        dtype = np.dtype(self._string())
        if dtype.kind not in _NUMBERS:
            raise CanonicalError(f"no arrays of {dtype}")
        shape = self.value(0)
        count = 1
        for side in shape:
            count *= side
        data = bytes(self._take(count * dtype.itemsize))
        return np.frombuffer(data, dtype).reshape(shape)

    def _record(self, depth: int) -> Any:
        cls = _class(self._string())
        count = self._count()
        fields = [(self._string(), self.value(depth + 1)) for _ in range(count)]
        return cls(**dict(fields))
