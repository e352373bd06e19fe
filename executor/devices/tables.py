"""Tables of a TOML file, read so that every mistake is reported with its key."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NoReturn

from microplan.executor.devices.errors import ExecutorError
from microplan.schemas.codec import as_real


class Table:
    """One table of a file; every key must be read, and be what its reader allows.

    Parameters
    ----------
    file : str
        What messages call the file.
    key : str
        The table's path in it, "" for the whole file.
    data : mapping
        What it holds.
    """

    def __init__(self, file: str, key: str, data: Mapping[str, Any]) -> None:
        self._file, self._key, self._data = file, key, data
        self._read: set[str] = set()

    def refuse(self, name: str, found: str, allowed: str) -> NoReturn:
        """Raise MP812 about a key of this table."""
        key = f"{self._key}.{name}".strip(".")
        raise ExecutorError(
            "MP812", f"{self._file}: {key}: {found}; {allowed}", place=self._file
        )

    def has(self, name: str) -> bool:
        """Return whether a key is there; it is then one that may be there."""
        self._read.add(name)
        return name in self._data

    def value(self, name: str) -> Any:
        """Return the value of a key, unchecked; None if it is missing."""
        return self._data.get(name) if self.has(name) else None

    def table(self, name: str) -> Table:
        """Return a table; one that is missing is empty."""
        data = self._data.get(name, {}) if self.has(name) else {}
        if not isinstance(data, dict):
            self.refuse(name, f"found {data!r}", "a table is needed")
        return Table(self._file, f"{self._key}.{name}".strip("."), data)

    def tables(self, name: str) -> list[Table]:
        """Return the tables of an array of tables, at least one."""
        rows = self._data.get(name, []) if self.has(name) else []
        if not isinstance(rows, list) or not rows:
            self.refuse(name, f"found {rows!r}", "a list of tables is needed")
        found = []
        for number, row in enumerate(rows):
            if not isinstance(row, dict):
                self.refuse(f"{name}[{number}]", f"found {row!r}", "a table is needed")
            key = f"{self._key}.{name}[{number}]".strip(".")
            found.append(Table(self._file, key, row))
        return found

    def names(self) -> Iterator[str]:
        """Yield the keys in order; all of them may be there."""
        self._read |= set(self._data)
        yield from self._data

    def number(
        self,
        name: str,
        default: float | None = None,
        *,
        least: float = -math.inf,
        above: float = -math.inf,
        most: float = math.inf,
    ) -> float:
        """Return a finite number, `least` to `most` and more than `above`."""
        if not self.has(name):
            if default is None:
                self.refuse(name, "it is missing", "a number is needed")
            return default
        number = self._number(name, self._data[name], least, above)
        if number > most:
            self.refuse(name, f"found {number:g}", f"it must be at most {most:g}")
        return number

    def whole(self, name: str, default: int | None = None, *, least: int = 1) -> int:
        """Return a whole number."""
        value = self.number(name, default, least=least)
        if value != int(value):
            self.refuse(name, f"found {value!r}", "a whole number is needed")
        return int(value)

    def interval(self, name: str) -> tuple[float, float]:
        """Return a pair of numbers that rise."""
        low, high = self.pair(name)
        if not low < high:
            self.refuse(name, f"found [{low:g}, {high:g}]", "the first must be less")
        return (low, high)

    def pair(
        self, name: str, default: tuple[float, float] | None = None
    ) -> tuple[float, float]:
        """Return two finite numbers."""
        if not self.has(name) and default is not None:
            return default
        return self._pair(name, self._data.get(name))

    def matrix(self, name: str) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return two rows of two finite numbers."""
        rows = self.value(name)
        if not isinstance(rows, list) or len(rows) != 2:
            self.refuse(name, f"found {rows!r}", "two rows of two numbers are needed")
        return (self._pair(f"{name}[0]", rows[0]), self._pair(f"{name}[1]", rows[1]))

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text that is not empty."""
        if default is not None and not self.has(name):
            return default
        value = self.value(name)
        if not isinstance(value, str) or not value:
            found = "it is missing" if value is None else f"found {value!r}"
            self.refuse(name, found, "a text is needed")
        return value

    def texts(self, name: str, allowed: tuple[str, ...]) -> tuple[str, ...] | None:
        """Return texts out of `allowed`, None if the key is missing."""
        if not self.has(name):
            return None
        values = self._data[name]
        if not isinstance(values, list):
            self.refuse(name, f"found {values!r}", "a list of texts is needed")
        for value in values:
            if value not in allowed:
                self.refuse(name, f"found {value!r}", "allowed: " + ", ".join(allowed))
        return tuple(values)

    def rest(self) -> dict[str, Any]:
        """Return all keys that were not read yet: a driver's own options."""
        left = {k: v for k, v in self._data.items() if k not in self._read}
        self._read |= set(left)
        return left

    def finish(self) -> None:
        """Raise MP812 if the table has a key that was not read."""
        for name in self._data:
            if name not in self._read:
                known = ", ".join(sorted(self._read)) or "none"
                self.refuse(name, "no such key", f"allowed: {known}")

    def _number(self, name: str, value: object, least: float, above: float) -> float:
        """Return a value if it is a number in its range."""
        number = as_real(value)
        if not math.isfinite(number):
            self.refuse(name, f"found {value!r}", "a finite number is needed")
        if not (number >= least and number > above):
            bound = f"at least {least:g}" if number < least else f"more than {above:g}"
            self.refuse(name, f"found {number:g}", f"it must be {bound}")
        return number

    def _pair(self, name: str, value: object) -> tuple[float, float]:
        """Return two numbers of a list."""
        if not isinstance(value, list) or len(value) != 2:
            found = "it is missing" if value is None else f"found {value!r}"
            self.refuse(name, found, "two numbers are needed")
        low, high = (self._number(name, v, -math.inf, -math.inf) for v in value)
        return (low, high)
