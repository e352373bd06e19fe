"""Values of a source replaced, as if they were written in its file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from microplan.planner.source.diagnostics import Report
from microplan.planner.source.schema import did_you_mean
from microplan.planner.source.source import Key, Source, Where

NO_SWEEP = "MP730"


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangedValue:
    """Another value of a key; the key may be new.

    Its words are keys of mappings, and of lists the `id` or the number of an entry.
    """

    key: tuple[str, ...]
    value: Any  # as YAML gives it


def changed(source: Source, changes: Sequence[ChangedValue], report: Report) -> Source:
    """Return a source with other values; positions stay those of the file.

    Keys that lack on the way are added: the file's schema decides what may be there.
    An entry that a list lacks is MP104, two keys for the same value are MP730.
    """
    data = source.data
    put: list[tuple[Where, ChangedValue]] = []
    for change in changes:
        where = _position(source, data, change, report)
        if where is not None and _is_apart(source, where, change, put, report):
            data = _put(data, where, change.value)
            put.append((where, change))
    return replace(source, data=data)


def _position(
    source: Source, data: Any, change: ChangedValue, report: Report
) -> Where | None:
    """Return the position of a key in data, None after reporting that it has none."""
    where: Where = ()
    for word in change.key:
        key: Key | None = word
        if isinstance(data, list):
            key = _entry(data, word)
        if key is None:
            known = [str(each) for each in _ids(data) if each is not None]
            allowed = ", ".join(known) or f"0 to {len(data) - 1}"
            said = f"{'.'.join(change.key)}: no entry '{word}'; allowed: {allowed}"
            at = source.value(*where)
            report.error("MP104", at, said, did_you_mean(word, known))
            return None
        where = (*where, key)
        data = _inner(data, key)
    return where


def _is_apart(
    source: Source,
    where: Where,
    change: ChangedValue,
    put: Sequence[tuple[Where, ChangedValue]],
    report: Report,
) -> bool:
    """Return whether a position is none of the others, nor in one or around one."""
    for there, other in put:
        shared = min(len(there), len(where))
        if there[:shared] == where[:shared]:
            keys = f"{'.'.join(other.key)} and {'.'.join(change.key)}"
            said = f"{keys} set the same value, or one a part of the other's"
            report.error(NO_SWEEP, source.value(*where), said, "keep one of them")
            return False
    return True


def _ids(entries: Sequence[Any]) -> list[Any]:
    return [each.get("id") if isinstance(each, dict) else None for each in entries]


def _entry(entries: Sequence[Any], word: str) -> int | None:
    """Return the index of the entry that a word means, None if there is none."""
    ids = _ids(entries)
    if word in ids:
        return ids.index(word)
    number = int(word) if word.isascii() and word.isdigit() and len(word) < 9 else -1
    return number if 0 <= number < len(entries) else None


def _inner(data: Any, key: Key) -> Any:
    """Return what a mapping or list holds, None if it lacks it or is neither."""
    try:
        return data[key]
    except (KeyError, IndexError, TypeError):
        return None


def _put(node: Any, where: Where, value: Any) -> Any:
    """Return a node with a value at a position below it; nothing is changed."""
    if not where:
        return value
    key, rest = where[0], where[1:]
    if isinstance(node, list) and isinstance(key, int):
        return [*node[:key], _put(node[key], rest, value), *node[key + 1 :]]
    inner = node if isinstance(node, dict) else {}
    return {**inner, key: _put(inner.get(key), rest, value)}
