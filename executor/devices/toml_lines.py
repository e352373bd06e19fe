"""Lines of the keys of a TOML file, which tomllib does not say."""

from __future__ import annotations

import re
import tomllib

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_BLANK = re.compile(r"[ \t]*")
_BETWEEN = re.compile(r"(?:[ \t\n]|#[^\n]*)*")  # what may stand between entries
_PLAIN = re.compile(r"[^,\]}#\n]*")  # a number, a date, true or false
_STRINGS = (  # the long ones first: """ begins with ""
    re.compile(r'"""(?:\\.|[^\\])*?"{3,5}(?!")', re.DOTALL),
    re.compile(r"'''.*?'{3,5}(?!')", re.DOTALL),
    re.compile(r'"(?:\\.|[^"\\\n])*"'),
    re.compile(r"'[^'\n]*'"),
)


def key_lines(text: str) -> dict[str, int]:
    """Return the line of every key of a valid TOML text, from 1.

    A key is its path: "stage.limits.x_um", "calibration.zooms[0].um_per_px".
    """
    scan = _Scan(text)
    scan.document()
    return scan.lines


def line_of(lines: dict[str, int], key: str) -> int:
    """Return the line of a key, of what holds it where it is missing; 0: the file."""
    while key:
        if key in lines:
            return lines[key]
        key = re.sub(r"(\[\d+\]|\.?[^.\[\]]*)$", "", key, count=1)
    return 0


class _Scan:
    """A way through a valid text; `lines` grows by every key that it passes."""

    def __init__(self, text: str) -> None:
        self.text, self.at = text, 0
        self.lines: dict[str, int] = {}
        self._counts: dict[str, int] = {}  # of the arrays of tables, by their path

    def document(self) -> None:
        """Pass the whole text."""
        prefix = ""
        self._pass(_BETWEEN)
        while self.at < len(self.text):
            if self.text[self.at] == "[":
                prefix = self._header()
            else:
                self._pair(prefix)
            self._pass(_BETWEEN)

    def _header(self) -> str:
        """Pass `[table]` or `[[table]]`; return its path."""
        double = self.text.startswith("[[", self.at)
        line = self._line()
        self.at += 2 if double else 1
        *above, last = self._key()
        self.at += 2 if double else 1
        path = ""
        for part in above:
            path = self._entry(f"{path}.{part}".strip("."), line)
        path = f"{path}.{last}".strip(".")
        if double:
            self._counts[path] = self._counts.get(path, 0) + 1
        return self._entry(path, line)

    def _entry(self, path: str, line: int) -> str:
        """Return a table's path, of an array of tables that of its last entry."""
        self.lines.setdefault(path, line)
        if path in self._counts:
            path = f"{path}[{self._counts[path] - 1}]"
            self.lines.setdefault(path, line)
        return path

    def _pair(self, prefix: str) -> None:
        """Pass `key = value`."""
        line, path = self._line(), prefix
        for part in self._key():
            path = f"{path}.{part}".strip(".")
            self.lines.setdefault(path, line)
        self.at += 1  # the =
        self._pass(_BLANK)
        self._value(path)

    def _key(self) -> list[str]:
        """Pass a key; return its parts."""
        parts = []
        while True:
            self._pass(_BLANK)
            quoted = self.text[self.at] in "\"'"
            found = self._string() if quoted else self._pass(_BARE)
            parts.append(tomllib.loads(f"k = {found}")["k"] if quoted else found)
            self._pass(_BLANK)
            if self.text[self.at] != ".":
                return parts
            self.at += 1

    def _value(self, path: str) -> None:
        """Pass a value and note the keys in it."""
        first = self.text[self.at]
        if first in "\"'":
            self._string()
        elif first in "[{":
            self._entries(path, "]" if first == "[" else "}")
        else:
            self._pass(_PLAIN)

    def _entries(self, path: str, end: str) -> None:
        """Pass an array or an inline table."""
        self.at += 1
        self._pass(_BETWEEN)
        number = 0
        while self.text[self.at] != end:
            if end == "]":
                entry = f"{path}[{number}]"
                self.lines.setdefault(entry, self._line())
                self._value(entry)
            else:
                self._pair(path)
            number += 1
            self._pass(_BETWEEN)
            if self.text[self.at] == ",":
                self.at += 1
            self._pass(_BETWEEN)
        self.at += 1

    def _string(self) -> str:
        """Pass a text in quotes."""
        for kind in _STRINGS:
            found = kind.match(self.text, self.at)
            if found:
                self.at = found.end()
                return found[0]
        raise ValueError(f"no text at {self.at}: the file is not valid TOML")

    def _pass(self, what: re.Pattern[str]) -> str:
        """Pass what matches, and return it."""
        found = what.match(self.text, self.at)
        if found is None:
            raise ValueError(f"no key at {self.at}: the file is not valid TOML")
        self.at = found.end()
        return found[0]

    def _line(self) -> int:
        """Return the present line."""
        return self.text.count("\n", 0, self.at) + 1
