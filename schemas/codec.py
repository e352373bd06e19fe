"""JSON for frozen dataclasses: field order is key order, unions carry a `kind`.

Understands what the plan's types use: float, int, str, bool, None, tuples, mappings
with string keys, dataclasses, optionals, literals, and unions of dataclasses
distinguished by a `kind` field with a literal type.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar, Union, get_args, get_origin

T = TypeVar("T")

DIGITS = 6  # significant digits on emission: see docs/conventions.md
MOST = 1 << 63  # whole numbers are below, as in every other language's readers


class CodecError(ValueError):
    """The data do not fit the type; the message starts with the path."""


def to_data(value: Any, digits: int = DIGITS) -> Any:
    """Return plain JSON data for `value`; numbers are rounded to `digits` digits."""
    if isinstance(value, float):
        return quantise(value, digits)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            f.name: to_data(getattr(value, f.name), digits)
            for f in dataclasses.fields(value)
        }
    if isinstance(value, Mapping):
        return {str(k): to_data(value[k], digits) for k in sorted(value)}
    if isinstance(value, (tuple, list)):
        return [to_data(v, digits) for v in value]
    if value is None or isinstance(value, (bool, int, str)):
        return value
    raise TypeError(f"no JSON form for {type(value).__name__}")


def quantise(value: float, digits: int = DIGITS) -> float:
    """Return `value` rounded to `digits` significant digits; refuse nan, infinity."""
    if not math.isfinite(value):
        raise ValueError(f"a plan holds finite numbers only, got {value}")
    rounded = float(f"{value:.{digits}g}")
    return rounded if rounded else 0.0  # never -0.0


def as_real(value: object) -> float:
    """Return a value as a float, nan if it is no number or too large for one."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:  # a whole number of more than 308 digits
        return math.nan


def from_data(cls: type[T], data: Any, path: str = "") -> T:
    """Return the value of type `cls` that `data` describe.

    Unknown keys are ignored, so that a newer minor version can be read.

    Raises
    ------
    CodecError
        If a key is missing or a value has the wrong type; the message names the path.
    """
    result: T = _decode(cls, data, path or cls.__name__)
    return result


def _decode(kind: Any, data: Any, path: str) -> Any:
    """Return `data` as the type `kind`."""
    origin = get_origin(kind)
    if origin in (Union, types.UnionType):
        return _decode_union(get_args(kind), data, path)
    if origin is typing.Literal:
        return _checked(data in get_args(kind), data, path, f"one of {get_args(kind)}")
    if origin is tuple:
        return _decode_tuple(get_args(kind), data, path)
    if origin is not None and issubclass(origin, Mapping):
        _checked(isinstance(data, dict), data, path, "an object")
        item = get_args(kind)[1]
        for key in data:
            _checked(_is_text(key), key, path, "keys of Unicode characters")
        return {k: _decode(item, v, f"{path}.{k}") for k, v in data.items()}
    if dataclasses.is_dataclass(kind):
        return _decode_dataclass(kind, data, path)
    return _decode_scalar(kind, data, path)


def _decode_scalar(kind: Any, data: Any, path: str) -> Any:
    """Return a float, int, str, bool or None; an int may replace a float."""
    if kind is float:
        return float(_checked(math.isfinite(as_real(data)), data, path, "a number"))
    if kind is int:
        ok = isinstance(data, int) and not isinstance(data, bool)
        return _checked(ok and abs(data) < MOST, data, path, "a whole number")
    if kind is type(None):
        return _checked(data is None, data, path, "null")
    if kind is str:
        return _checked(_is_text(data), data, path, "text of Unicode characters")
    return _checked(isinstance(data, kind), data, path, kind.__name__)


def _is_text(data: Any) -> bool:
    """Return whether data are text that can be written: no half of a character."""
    if not isinstance(data, str):
        return False
    return data.isascii() or not any("\ud800" <= char <= "\udfff" for char in data)


def _decode_tuple(args: tuple[Any, ...], data: Any, path: str) -> Any:
    """Return a tuple, homogeneous (`...`) or of fixed length."""
    _checked(isinstance(data, list), data, path, "a list")
    if len(args) == 2 and args[1] is Ellipsis:
        return tuple(_decode(args[0], v, f"{path}[{i}]") for i, v in enumerate(data))
    _checked(len(data) == len(args), data, path, f"{len(args)} items")
    return tuple(
        _decode(a, v, f"{path}[{i}]")
        for i, (a, v) in enumerate(zip(args, data, strict=True))
    )


def _decode_union(args: tuple[Any, ...], data: Any, path: str) -> Any:
    """Return an optional's value, or the dataclass whose `kind` the data name."""
    if data is None and type(None) in args:
        return None
    rest = [a for a in args if a is not type(None)]
    if len(rest) == 1:
        return _decode(rest[0], data, path)
    _checked(isinstance(data, dict) and "kind" in data, data, path, "an object + kind")
    for candidate in rest:
        if data["kind"] in get_args(_hints(candidate)["kind"]):
            return _decode(candidate, data, path)
    raise CodecError(f"{path}.kind: unknown kind {data['kind']!r}")


def _decode_dataclass(kind: Any, data: Any, path: str) -> Any:
    """Return a dataclass from an object; defaults fill what is missing."""
    _checked(isinstance(data, dict), data, path, "an object")
    hints, values = _hints(kind), {}
    for field in dataclasses.fields(kind):
        if field.name in data:
            values[field.name] = _decode(
                hints[field.name], data[field.name], f"{path}.{field.name}"
            )
        elif field.default is dataclasses.MISSING:
            raise CodecError(f"{path}: key {field.name!r} is missing")
    try:
        return kind(**values)
    except ValueError as error:
        raise CodecError(f"{path}: {error}") from error


@functools.cache
def _hints(kind: Any) -> dict[str, Any]:
    """Return the resolved annotations of a dataclass."""
    return typing.get_type_hints(kind)


def _checked(ok: bool, data: Any, path: str, wanted: str) -> Any:  # noqa: FBT001 - a predicate
    """Return `data` if `ok`; say what was wanted and found if not."""
    if not ok:
        raise CodecError(f"{path}: {wanted} is needed, got {str(data)[:60]!r}")
    return data
