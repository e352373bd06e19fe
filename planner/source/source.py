"""YAML read into plain data, with the position of every key and value.

Plain scalars follow YAML 1.2 core: `1e-6` is a number, `no` and `12:30` are text, there
are no dates. What could be read in two ways is refused: duplicate keys, anchors,
aliases, tags, several documents, numbers that are not finite.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml
from yaml import events

from microplan.planner.source.diagnostics import Diagnostic, Report, Span
from microplan.planner.source.files import read_bytes
from microplan.planner.source.yaml_faults import fault_of

Key = str | int
Where = tuple[Key, ...]  # keys and indices from the root to a node

MAX_BYTES = 1 << 20  # a task of a thousand steps is a tenth of this
MAX_DEPTH = 32  # the formats nest 7 deep
MAX_NODES = 20_000  # a thousand steps have 12 000

BREAK = re.compile(r"\r\n|[\n\r\x85\u2028\u2029]")  # as the YAML scanner counts lines
_INT = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_RADIX = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_ODD = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_WORDS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """One YAML file: its data and the position of each piece."""

    file: str  # as the user named it
    path: Path
    data: Any
    values: dict[Where, Span]
    keys: dict[Where, Span]
    faults: frozenset[Where] = frozenset()  # nodes already reported; data are made up

    def value(self, *where: Key) -> Span:
        """Return the position of the value at `where`, or of what encloses it."""
        for end in range(len(where), -1, -1):
            if where[:end] in self.values:
                return self.values[where[:end]]
        return Span(file=self.file)

    def get(self, *where: Key) -> Any:
        """Return the data at `where`, None if there is nothing."""
        node = self.data
        for key in where:
            try:
                node = node[key]
            except (KeyError, IndexError, TypeError):
                return None
        return node

    def mapping(self, *where: Key) -> dict[str, Any]:
        """Return the mapping at `where`, empty if there is none."""
        node = self.get(*where)
        return node if isinstance(node, dict) else {}

    def items(self, *where: Key) -> list[Any]:
        """Return the list at `where`, empty if there is none."""
        node = self.get(*where)
        return node if isinstance(node, list) else []

    def key(self, *where: Key) -> Span:
        """Return the position of the key at `where`; of the value for a list item."""
        return self.keys.get(where) or self.value(*where)


class _RefusedError(Exception):
    """A finding that ends the reading of this file."""

    def __init__(self, code: str, where: Span, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.finding = (code, where, message, hint)


def read_source(path: Path, file: str, report: Report, at: Span) -> Source | None:
    """Return the YAML file at `path`, or None after reporting why not.

    Parameters
    ----------
    path : Path
        The file to read.
    file : str
        Its name as the user knows it, for findings.
    report : Report
        Receives the findings.
    at : Span
        Where the file is asked for; findings about the file as a whole go there.
    """
    text = read_text(path, file, report, at)
    if text is None:
        return None
    source, found = _parsed(text, path, file)
    report.found += found
    return source


@lru_cache(maxsize=4)  # a sweep reads the same task and workcell for each row
def _parsed(
    text: str, path: Path, file: str
) -> tuple[Source | None, tuple[Diagnostic, ...]]:
    """Return what `parse` does of a file's text, which nobody changes, and finds."""
    report = Report()
    return parse(text, path, file, report), tuple(report.found)


def parse(text: str, path: Path, file: str, report: Report) -> Source | None:
    """Return `text` as a Source, or None if it cannot be taken for one document.

    What is wrong with a single value is reported, and the rest still read, so that all
    mistakes of a file come out at once.
    """
    builder = _Builder(file, BREAK.split(text), report)
    try:
        data = builder.document(yaml.parse(text, Loader=yaml.SafeLoader))
    except _RefusedError as refused:
        report.error(*refused.finding)
        return None
    except yaml.MarkedYAMLError as error:
        fault = fault_of(error, builder.lines)
        mark = fault.mark
        where = builder.at(mark, mark) if mark else Span(file=file)
        report.error("MP003", where, f"not valid YAML: {fault.message}", fault.hint)
        return None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        report.error(
            "MP003",
            Span(file=file, line=line, column=1),
            f"not valid YAML: the character {error.character!r} is not allowed",
        )
        return None
    return Source(
        file=file,
        path=path,
        data=data,
        values=builder.values,
        keys=builder.keys,
        faults=frozenset(builder.faults),
    )


def read_text(path: Path, file: str, report: Report, at: Span) -> str | None:
    """Return the file's text without a byte order mark."""
    raw = read_bytes(path, file, at, report, most=MAX_BYTES)
    if raw is None:
        return None
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        column = error.start - (raw.rfind(b"\n", 0, error.start) + 1) + 1
        report.error(
            "MP002",
            Span(file=file, line=line, column=column),
            f"not UTF-8 text: byte 0x{raw[error.start]:02x}",
            "save the file as UTF-8",
        )
        return None


class _Builder:
    """Turns parser events into data; every level of nesting is one call."""

    def __init__(self, file: str, lines: list[str], report: Report) -> None:
        self.file = file
        self.lines = lines
        self.report = report
        self.values: dict[Where, Span] = {}
        self.keys: dict[Where, Span] = {}
        self.faults: set[Where] = set()
        self.nodes = 0

    def document(self, stream: Iterator[Any]) -> Any:
        """Return the data of the only document in `stream`."""
        data, seen = None, 0
        for event in stream:
            if isinstance(event, events.DocumentStartEvent):
                seen += 1
                if seen > 1:
                    where = self.at(event.start_mark, event.end_mark)
                    message = "a second document starts here"
                    raise _RefusedError(
                        "MP007", where, message, "one file, one document"
                    )
                data = self.node(next(stream), stream, ())
        if not seen or (data is None and () not in self.values):
            raise _RefusedError("MP011", Span(file=self.file), f"{self.file} is empty")
        return data

    def at(self, start: Any, end: Any) -> Span:
        """Return the span from `start` to `end`, at most to the end of its line."""
        text = self.lines[start.line] if start.line < len(self.lines) else ""
        last = end.column if end.line == start.line else len(text.rstrip())
        return Span(
            file=self.file,
            line=start.line + 1,
            column=start.column + 1,
            length=max(last - start.column, 1),
            text=text,
        )

    def node(self, event: Any, stream: Iterator[Any], where: Where) -> Any:
        """Return the data of the node that `event` begins."""
        span = self.at(event.start_mark, event.end_mark)
        self._refuse_odd(event, span, where)
        self.values[where] = span
        if isinstance(event, events.MappingStartEvent):
            data, end = self._mapping(stream, where)
            self._widen(where, event, end)
            return data
        if isinstance(event, events.SequenceStartEvent):
            items, end = self._sequence(stream, where)
            self._widen(where, event, end)
            return items
        return self._scalar(event, span, where)

    def _widen(self, where: Where, start: Any, end: Any) -> None:
        """Let the span of a list or mapping in brackets reach the closing one."""
        if start.flow_style:
            self.values[where] = self.at(start.start_mark, end.end_mark)

    def _refuse_odd(self, event: Any, span: Span, where: Where) -> None:
        """Refuse anchors, aliases, tags, and files that are too deep or too long."""
        self.nodes += 1
        if self.nodes > MAX_NODES:
            raise _RefusedError("MP009", span, f"more than {MAX_NODES} values")
        if len(where) > MAX_DEPTH:
            raise _RefusedError("MP009", span, f"nested more than {MAX_DEPTH} deep")
        if isinstance(event, events.AliasEvent):
            message = f"alias '*{event.anchor}' is not allowed"
            raise _RefusedError("MP005", span, message, "write the value out")
        if event.anchor:
            message = f"anchor '&{event.anchor}' is not allowed"
            self._fault("MP005", where, span, message, "remove it")
        if event.tag and event.tag != "!":
            message = f"tag '{event.tag}' is not allowed"
            self._fault("MP006", where, span, message, "remove it")

    def _mapping(
        self, stream: Iterator[Any], where: Where
    ) -> tuple[dict[str, Any], Any]:
        """Return the data up to the end of the mapping, and the event of that end."""
        data: dict[str, Any] = {}
        for event in stream:
            if isinstance(event, events.MappingEndEvent):
                break
            span = self.at(event.start_mark, event.end_mark)
            self._refuse_odd(event, span, where)
            if not isinstance(event, events.ScalarEvent):
                raise _RefusedError(
                    "MP012", span, "a key must be text", "quote the key"
                )
            key = event.value
            inner = (*where, key)
            if key in data:
                first = self.keys[inner].line
                message = f"key '{key}' is already given in line {first}"
                self._fault("MP004", inner, span, message, "remove one of them")
                self.node(next(stream), stream, (*where, f"{key}#{self.nodes}"))
                continue
            self.keys[inner] = span
            data[key] = self.node(next(stream), stream, inner)
        return data, event

    def _sequence(self, stream: Iterator[Any], where: Where) -> tuple[list[Any], Any]:
        """Return the data up to the end of the list, and the event of that end."""
        data: list[Any] = []
        for event in stream:
            if isinstance(event, events.SequenceEndEvent):
                break
            data.append(self.node(event, stream, (*where, len(data))))
        return data, event

    def _fault(self, code: str, where: Where, span: Span, *words: str) -> None:
        """Report a node and remember it."""
        self.report.error(code, span, *words)
        self.faults.add(where)

    def _scalar(
        self, event: Any, span: Span, where: Where
    ) -> str | float | bool | None:
        """Return a scalar by YAML 1.2 core; report numbers that are not finite."""
        text: str = event.value
        if event.style or event.tag == "!":
            return text
        if text in _WORDS:
            return _WORDS[text]
        if _ODD.fullmatch(text):
            self._fault(
                "MP008", where, span, f"{text} is not a finite number", "write a number"
            )
            return 0
        radix = _RADIX.fullmatch(text)
        if not radix and not _FLOAT.fullmatch(text):
            return text
        number = _of_radix(text) if radix else float(text)
        if not math.isfinite(number):
            self._fault("MP008", where, span, f"{text} is too large for a number")
            return 0
        whole = radix or _INT.fullmatch(text)
        return int(number) if whole and abs(number) < 1e15 else number


def _of_radix(text: str) -> float:
    """Return a hexadecimal or octal number, infinity if no float is as large."""
    try:
        return float(int(text, 0))
    except OverflowError:
        return math.inf
