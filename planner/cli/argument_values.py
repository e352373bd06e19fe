"""Values of arguments from their text; what is none says what is allowed."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TypeVar

from microplan.planner.diff.changes import KINDS

T = TypeVar("T")


def asked(convert: Callable[[str], T], allowed: str) -> Callable[[str], T]:
    """Return a converter of an argument whose errors state what is allowed."""

    def converted(text: str) -> T:
        try:
            return convert(text)
        except ValueError as error:
            said = f"{text[:80]!r}; allowed: {allowed}"
            raise argparse.ArgumentTypeError(said) from error

    return converted


def count(text: str) -> int:
    """Return a whole number from 1 on."""
    value = int(text)
    if not 1 <= value <= 256:
        raise ValueError(text)
    return value


def confidence(text: str) -> float:
    """Return a confidence that trials can show."""
    value = float(text)
    if not 0.5 <= value <= 0.9999:
        raise ValueError(text)
    return value


def share(text: str) -> float:
    """Return a number above 0 and at most 1."""
    value = float(text)
    if not 0 < value <= 1:
        raise ValueError(text)
    return value


def depth(text: str) -> int:
    """Return the number of bits of a picture's counts."""
    value = int(text)
    if not 1 <= value <= 16:
        raise ValueError(text)
    return value


def names(text: str) -> tuple[str, ...]:
    """Return names between commas, none of them empty."""
    found = tuple(name.strip() for name in text.split(","))
    if not all(found):
        raise ValueError(text)
    return found


def faces(text: str) -> tuple[tuple[str, float], ...]:
    """Return layers with a number each: LAYER:NUMBER between commas."""
    found = [name.rpartition(":") for name in names(text)]
    if not all(layer for layer, _, _ in found):
        raise ValueError(text)
    return tuple((layer, float(number)) for layer, _, number in found)


def kinds(text: str) -> tuple[str, ...]:
    """Return kinds of changes, and "worse"."""
    found = tuple(text.split(","))
    if not set(found) <= {"worse", *KINDS}:
        raise ValueError(text)
    return found


def setting(text: str) -> tuple[str, str]:
    """Return a key, words between points, and its values as they are written."""
    key, equals, values = text.partition("=")
    if not (equals and values and all(key.split("."))):
        raise ValueError(text)
    return key, values
