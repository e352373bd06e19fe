"""Tables of a TOML file, read so that every mistake is reported with its key."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, NoReturn

from microplan.executor.devices.errors import ExecutorError, meant
from microplan.executor.devices.toml_lines import line_of
from microplan.schemas.codec import as_real

MISSING = "it is missing"


@dataclass(frozen=True, slots=True, kw_only=True)
class Mistake:
    """What is wrong with one key of a file."""

    key: str
    line: int  # 0: of the whole file
    words: str
    missing: bool = False  # it is not there: another may be it, misspelt


@dataclass(slots=True, kw_only=True)
class Mistakes:
    """The mistakes of a file, collected so that all of them are told at once."""

    file: str
    lines: dict[str, int]  # key -> its line
    found: list[Mistake] = field(default_factory=list)

    def place(self, key: str) -> str:
        """Return the file and line of a key, as messages point at them."""
        line = line_of(self.lines, key)
        return f"{self.file}:{line}" if line else self.file

    def add(self, key: str, words: str, *, missing: bool) -> None:
        """Note a mistake."""
        line = line_of(self.lines, key)
        self.found.append(Mistake(key=key, line=line, words=words, missing=missing))

    def missing(self, table: str) -> set[str]:
        """Return the names that a table lacks."""
        above = f"{table}." if table else ""
        names = {m.key.removeprefix(above) for m in self.found if m.missing
                 and m.key.startswith(above)}  # fmt: skip
        return {name for name in names if "." not in name}

    def explained(self, key: str) -> None:
        """Forget that a key is missing: it is there, misspelt."""
        self.found = [m for m in self.found if not (m.missing and m.key == key)]

    def check(self) -> None:
        """Raise MP812 if there is any, the first line first."""
        errors = [
            ExecutorError(
                "MP812",
                f"{self.file}: {mistake.key}: {mistake.words}",
                place=self.place(mistake.key),
            )
            for mistake in sorted(self.found, key=lambda m: (m.line, m.key))
        ]
        if errors:
            first, *others = errors
            raise ExecutorError(
                "MP812", first.message, place=first.place, others=others
            )


class _WrongError(Exception):
    """A key that is not what its reader allows."""

    def __init__(self, name: str, words: str, *, missing: bool) -> None:
        super().__init__(words)
        self.name, self.words, self.missing = name, words, missing


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
    mistakes : Mistakes, optional
        Takes what is wrong, and a reader gets a value that its rules allow instead.
        Without it the first mistake is raised.
    """

    def __init__(
        self,
        file: str,
        key: str,
        data: Mapping[str, Any],
        mistakes: Mistakes | None = None,
    ) -> None:
        self._file, self._key, self._data = file, key, data
        self._mistakes = mistakes
        self._read: set[str] = set()
        self._tables: dict[str, Table] = {}

    def refuse(self, name: str, found: str, allowed: str) -> None:
        """Note, or raise, MP812 about a key of this table."""
        with self._noting():
            _wrong(name, found, allowed)

    def lacks(self, name: str, allowed: str) -> None:
        """Note, or raise, that a key is missing."""
        with self._noting():
            _wrong(name, MISSING, allowed)

    def path(self, name: str) -> str:
        """Return the path of a key of this table."""
        return f"{self._key}.{name}".strip(".")

    def place(self, name: str) -> str:
        """Return the file and line of a key, as messages point at them."""
        mistakes = self._mistakes
        return self._file if mistakes is None else mistakes.place(self.path(name))

    def has(self, name: str) -> bool:
        """Return whether a key is there; it is then one that may be there."""
        self._read.add(name)
        return name in self._data

    def value(self, name: str) -> Any:
        """Return the value of a key, unchecked; None if it is missing."""
        return self._data.get(name) if self.has(name) else None

    def table(self, name: str) -> Table:
        """Return a table, the same one every time; one that is missing is empty."""
        if name not in self._tables:
            data = self._data.get(name, {}) if self.has(name) else {}
            if not isinstance(data, dict):
                self.refuse(name, f"found {data!r}", "a table is needed")
                data = {}
            self._tables[name] = self._inner(name, data)
        return self._tables[name]

    def tables(self, name: str) -> list[Table]:
        """Return the tables of an array of tables, at least one."""
        rows = self._data.get(name, []) if self.has(name) else []
        if not isinstance(rows, list) or not rows:
            found = f"found {rows!r}" if name in self._data else MISSING
            with self._noting():
                _wrong(name, found, "a list of tables is needed")
            return []
        found_tables = []
        for number, row in enumerate(rows):
            entry = f"{name}[{number}]"
            if isinstance(row, dict):
                found_tables.append(self._inner(entry, row))
            else:
                self.refuse(entry, f"found {row!r}", "a table is needed")
        return found_tables

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
        with self._noting():
            if not self.has(name):
                if default is None:
                    _wrong(name, MISSING, "a number is needed")
                return default
            number = _number(name, self._data[name], least, above)
            if number > most:
                _wrong(name, f"found {number:g}", f"it must be at most {most:g}")
            return number
        return min(max(least, above + 1, 1.0), most)

    def whole(self, name: str, default: int | None = None, *, least: int = 1) -> int:
        """Return a whole number."""
        value = self.number(name, default, least=least)
        if value != int(value):
            self.refuse(name, f"found {value!r}", "a whole number is needed")
        return int(value)

    def interval(self, name: str) -> tuple[float, float]:
        """Return a pair of numbers that rise."""
        low, high = self.pair(name, stand_in=(0.0, 1.0))
        if not low < high:
            self.refuse(name, f"found [{low:g}, {high:g}]", "the first must be less")
        return (low, high)

    def pair(
        self,
        name: str,
        default: tuple[float, float] | None = None,
        stand_in: tuple[float, float] = (0.0, 0.0),
    ) -> tuple[float, float]:
        """Return two finite numbers, `stand_in` where they are wrong."""
        if not self.has(name) and default is not None:
            return default
        with self._noting():
            return _pair(name, self._data.get(name))
        return stand_in

    def matrix(self, name: str) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return two rows of two finite numbers."""
        rows = self.value(name)
        with self._noting():
            if not isinstance(rows, list) or len(rows) != 2:
                found = MISSING if rows is None else f"found {rows!r}"
                _wrong(name, found, "two rows of two numbers are needed")
            return (_pair(f"{name}[0]", rows[0]), _pair(f"{name}[1]", rows[1]))
        return ((1.0, 0.0), (0.0, 1.0))

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text that is not empty."""
        if default is not None and not self.has(name):
            return default
        value = self.value(name)
        with self._noting():
            if not isinstance(value, str) or not value:
                found = MISSING if value is None else f"found {value!r}"
                _wrong(name, found, "a text is needed")
            return value
        return ""

    def texts(self, name: str, allowed: tuple[str, ...]) -> tuple[str, ...] | None:
        """Return texts out of `allowed`, None if the key is missing."""
        if not self.has(name):
            return None
        values = self._data[name]
        with self._noting():
            if not isinstance(values, list):
                _wrong(name, f"found {values!r}", "a list of texts is needed")
            for value in values:
                if value not in allowed:
                    known = "allowed: " + ", ".join(allowed)
                    _wrong(name, f"found {value!r}", known)
            return tuple(values)
        return None

    def rest(self) -> dict[str, Any]:
        """Return all keys that were not read yet: a driver's own options."""
        left = {k: v for k, v in self._data.items() if k not in self._read}
        self._read |= set(left)
        return left

    def finish(self) -> None:
        """Note, or raise, MP812 about every key that was not read."""
        mistakes = self._mistakes
        for name in [name for name in self._data if name not in self._read]:
            known = sorted(self._read)
            lacking = set() if mistakes is None else mistakes.missing(self._key)
            absent = sorted(self._read - set(self._data))
            hint = (
                meant(name, lacking) or meant(name, absent) or meant(name, self._read)
            )
            for other in lacking:
                if mistakes is not None and hint == meant(name, (other,)):
                    mistakes.explained(self.path(other))
            self.refuse(
                name, f"no such key{hint}", f"allowed: {', '.join(known) or 'none'}"
            )

    def _inner(self, name: str, data: Mapping[str, Any]) -> Table:
        """Return a table of this one."""
        return Table(self._file, self.path(name), data, self._mistakes)

    def _noting(self) -> _Noting:
        """Return what notes a mistake that is raised inside, or raises it as MP812."""
        return _Noting(self._file, self._key, self._mistakes)


class _Noting:
    """Around the reading of one key: what is wrong is noted, and the reader goes on."""

    def __init__(self, file: str, table: str, mistakes: Mistakes | None) -> None:
        self._file, self._table, self._mistakes = file, table, mistakes

    def __enter__(self) -> None:
        """Begin."""

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        wrong: BaseException | None,
        _trace: TracebackType | None,
    ) -> bool:
        """Return whether it was noted: then nothing is raised."""
        if not isinstance(wrong, _WrongError):
            return False
        key = f"{self._table}.{wrong.name}".strip(".")
        if self._mistakes is None:
            raise ExecutorError(
                "MP812", f"{self._file}: {key}: {wrong.words}", place=self._file
            ) from None
        self._mistakes.add(key, wrong.words, missing=wrong.missing)
        return True


def _wrong(name: str, found: str, allowed: str) -> NoReturn:
    """Raise what is wrong with a key."""
    raise _WrongError(name, f"{found}; {allowed}", missing=found == MISSING)


def _number(name: str, value: object, least: float, above: float) -> float:
    """Return a value if it is a number in its range."""
    number = as_real(value)
    if not math.isfinite(number):
        _wrong(name, f"found {value!r}", "a finite number is needed")
    if not (number >= least and number > above):
        bound = f"at least {least:g}" if number < least else f"more than {above:g}"
        _wrong(name, f"found {number:g}", f"it must be {bound}")
    return number


def _pair(name: str, value: object) -> tuple[float, float]:
    """Return two numbers of a list."""
    if not isinstance(value, list) or len(value) != 2:
        found = MISSING if value is None else f"found {value!r}"
        _wrong(name, found, "two numbers are needed")
    low, high = (_number(name, v, -math.inf, -math.inf) for v in value)
    return (low, high)
