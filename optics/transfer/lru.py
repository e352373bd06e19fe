"""Cache of a pure function's latest results, within some bytes."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Recent(Generic[T]):
    """Values by their inputs; those asked for longest ago are forgotten.

    They are given again, not copied: arrays in them must not be writable. Changes no
    result.
    """

    most_bytes: int  # of all values together
    size: Callable[[T], int]  # bytes of one
    _held: dict[Hashable, T] = field(default_factory=dict)
    _bytes: dict[Hashable, int] = field(default_factory=dict)

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return the value of a key, computed unless it is held."""
        if key in self._held:
            found = self._held.pop(key)
            self._held[key] = found  # the last one asked for
            return found
        found = make()
        held = self.size(found)
        if held > self.most_bytes:
            return found
        self._held[key], self._bytes[key] = found, held
        while sum(self._bytes.values()) > self.most_bytes:
            oldest = next(iter(self._held))
            del self._held[oldest], self._bytes[oldest]
        return found
