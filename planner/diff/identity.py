"""Identity of the entries of a plan's lists: matched by name, not by index."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

Entry = Mapping[str, Any]


def _key(*names: str) -> Callable[[Entry], str]:
    """Return the identity by these values of an entry."""

    def identity(entry: Entry) -> str:
        return " ".join(_word(entry[name]) for name in names)

    return identity


def _word(value: Any) -> str:
    """Return a value as a part of a path."""
    if isinstance(value, list):
        return " > ".join(map(_word, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


# by the key that holds the list
_IDENTITY: Mapping[str, Callable[[Entry], str]] = {
    "steps": _key("id"),
    "looks": _key("id"),
    "sketched": _key("id"),
    "others": lambda entry: _word(entry["feature"] if "feature" in entry
                                  else entry["chain"]),
    "chain": _key("id"),
    "fallback": _key("id"),
    "features": _key("name"),
    "beliefs": _key("name"),
    "effects": _key("effect"),
    "layers": _key("name"),
    "shades": _key("target", "by"),
    "rows": _key("term"),
    "offenders": _key("term"),
    "allowed": _key("error", "look"),
    "yields": _key("over"),
    "options": _key("method"),
    "on_failure": _key("code"),
    "reasons": _key("code", "step"),
    "bounds": _key("end", "by"),
    "refused": _key("magnification"),
    "apertures": _key("magnification"),
    "accepted": _key("feature"),
    "times": _key("what"),
    "parts": _key("name"),
}  # fmt: skip
ORDERED = frozenset({"steps"})  # lists whose order is part of their meaning
WHOLE = frozenset({"chain", "fallback"})  # and those that are one choice


def named(key: str, entries: Sequence[Any]) -> dict[str, Entry] | None:
    """Return a list's entries by identity, None if they go by position.

    Entries of the same identity are distinguished by the order in which they come.
    """
    identity = _IDENTITY.get(key)
    if identity is None or not all(isinstance(entry, Mapping) for entry in entries):
        return None
    found: dict[str, Entry] = {}
    counts: dict[str, int] = {}
    for entry in entries:
        try:
            name = identity(entry)
        except KeyError:  # another list of the same name
            return None
        full = name
        while full in found:
            counts[name] = counts.get(name, 1) + 1
            full = f"{name} #{counts[name]}"
        found[full] = entry
    return found
