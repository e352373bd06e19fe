"""Corrected spelling of a value that has the wrong type."""

from __future__ import annotations

import re
from collections.abc import Sequence

_MOST = 40  # characters of what may be meant as a number
_MEASURE = re.compile(
    r"([+-]?(?:[0-9]+(?:[.,][0-9]*)*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*"
    r"([^\W\d_]+|%|\N{DEGREE SIGN})?"
)
_WHOLE = re.compile(r"[+-]?[0-9]+")


def as_kind(kinds: Sequence[str], value: object, at: str) -> str:
    """Return how a lone value is written as the kind wanted, "" if it cannot be.

    Parameters
    ----------
    kinds : sequence of str
        Types of JSON Schema, one of which is wanted.
    value : object
        What was found.
    at : str
        Name of the node, `steps[2].speed_um_per_s`.
    """
    if isinstance(value, str) and {"number", "integer"} & set(kinds):
        return _as_number(value, at, whole="number" not in kinds)
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    if plain and "string" in kinds:
        return f'write it in quotes: "{value}"'
    if "array" in kinds and (plain or isinstance(value, str)):
        return f"write [{value}]"
    return ""


def u_for_mu(text: str) -> str:
    """Return text with a u for the letter mu, of either kind: units have it."""
    return text.replace("\u00b5", "u").replace("\u03bc", "u")


def _as_number(text: str, at: str, *, whole: bool) -> str:
    """Return how a number with something about it is written, "" if it is none."""
    found = _MEASURE.fullmatch(text.strip()) if len(text) <= _MOST else None
    if found is None:
        return ""
    digits, unit = found.groups()
    if "," in digits:
        return "write it without a comma: decimals take a point, thousands nothing"
    if digits.count(".") > 1 or (whole and not _WHOLE.fullmatch(digits)):
        return ""
    if not unit or _in_name(unit, at):
        return f"write {digits}"
    return "write a number alone: where there is a unit, the key's name ends in it"


def _in_name(unit: str, at: str) -> bool:
    """Return whether a unit is that which the key's name ends in."""
    key = at.rpartition(".")[2].partition("[")[0]
    return "_per_" not in key and key.endswith(f"_{u_for_mu(unit).casefold()}")
