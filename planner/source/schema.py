"""Validation of a source by its JSON Schema: one finding per mistake."""

from __future__ import annotations

import difflib
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import jsonschema
from jsonschema.exceptions import ValidationError

from microplan.planner.source.diagnostics import Report
from microplan.planner.source.respelling import as_kind, u_for_mu
from microplan.planner.source.source import Source, Where
from microplan.schemas.files import json_schema

# newest version of the task and workcell formats; older ones are read, too
NEWEST = {"microplan": 1, "microplan_workcell": 2}

_TYPES = {
    "number": "a number",
    "integer": "a whole number",
    "string": "text",
    "boolean": "true or false",
    "array": "a list",
    "object": "keys with values",
}


@dataclass(frozen=True, slots=True)
class Checked:
    """A source, and which of its nodes are at fault."""

    source: Source
    faults: frozenset[Where]
    above: frozenset[Where]  # the faults, and all that encloses them

    @classmethod
    def of(cls, source: Source, faults: Iterable[Where]) -> Checked:
        """Return a source with nodes at fault."""
        found = frozenset(faults)
        above = (fault[:end] for fault in found for end in range(len(fault) + 1))
        return cls(source, found, frozenset(above))

    def good(self, *where: str | int) -> bool:
        """Return whether `where` exists and nothing in or above it is at fault."""
        if where in self.above or self.source.get(*where) is None:
            return False
        return not any(where[:end] in self.faults for end in range(len(where)))


@dataclass(frozen=True, slots=True)
class _Finding:
    """What is wrong at a node; `on_key` puts the caret under the key."""

    code: str
    where: Where
    message: str
    hint: str
    on_key: bool
    missing: Where = ()  # the key that is not there, below `where`

    @property
    def fault(self) -> Where:
        """Return the node at fault; the neighbours of a missing key are not."""
        return (*self.where, *self.missing)


COMMA = "a comma ends an entry: decimals take a point, as in 0.5"


def check(source: Source, name: str, version_key: str, report: Report) -> Checked:
    """Return `source` with the nodes at fault; every mistake is reported once.

    Parameters
    ----------
    source : Source
        The file.
    name : str
        "task" or "workcell".
    version_key : str
        The key that holds the format's version; another one is the only finding.
    report : Report
        Receives the findings.
    """
    if _is_other(source, version_key, report):
        return Checked.of(source, [()])
    # a Draft202012Validator of our own schema; nothing is fetched
    errors = _validator(name).iter_errors(source.data)
    found: dict[tuple[Where, str], _Finding] = {}
    for finding in _findings(errors):
        found.setdefault((finding.where, finding.message), finding)
    strange = [f for f in found.values() if f.code == "MP104"]
    unknown = {f.where for f in strange}
    hints = {(f.where[:-1], f.hint) for f in strange}
    for f in found.values():
        if _follows(f, unknown, hints) or f.where in source.faults:
            continue
        span = source.key(*f.where) if f.on_key else source.value(*f.where)
        report.error(f.code, span, f.message, f.hint)
    return Checked.of(source, source.faults | {f.fault for f in found.values()})


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return "did you mean 'x'?" for the known word nearest to `word`, or "".

    A letter mu, of either kind, is meant as a u: units have it.
    """
    near = difflib.get_close_matches(u_for_mu(word), sorted(known), n=1, cutoff=0.6)
    return f"did you mean '{near[0]}'?" if near else ""


def with_defaults(data: Any, name: str, definition: str = "") -> Any:
    """Return a copy of valid `data`, defaults filled in and keys sorted.

    The rule is that of the whole file, or one of the schema's definitions.
    """
    schema = json_schema.load(name)
    rule = schema["$defs"][definition] if definition else schema
    return _filled(data, rule, schema)


def show(value: object) -> str:
    """Return a value as a finding quotes it, cut to 40 characters."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, Mapping):
        return "keys with values"
    text = f"'{value}'" if isinstance(value, str) else f"{value}"
    return text if len(text) <= 40 else text[:36] + "...'"


def _follows(
    finding: _Finding, unknown: Container[Where], hints: Container[tuple[Where, str]]
) -> bool:
    """Return whether a finding only repeats that a key is unknown."""
    if finding.code == "MP109":
        return finding.where in unknown  # no verb knows it either
    if finding.code == "MP102":  # it is there, misspelt
        return (finding.where, f"did you mean '{finding.missing[0]}'?") in hints
    return False


@cache
def _validator(name: str) -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(json_schema.load(name))


def _is_other(source: Source, version_key: str, report: Report) -> bool:
    """Report another version than ours: what else the file says may mean anything.

    Versions are whole numbers from 1 on; what is none breaks the schema.
    """
    version = source.data.get(version_key) if isinstance(source.data, dict) else None
    newest = NEWEST[version_key]
    if not isinstance(version, int | float) or version <= newest:
        return False
    report.error(
        "MP013",
        source.value(version_key),
        f"{version_key} is {version}, this microplan reads {_versions(newest)}",
        "update microplan",  # version 1 is the first
    )
    return True


def _versions(newest: int) -> str:
    """Return the versions that are read, in words."""
    return "version 1" if newest == 1 else f"versions 1 to {newest}"


def _findings(errors: Iterable[ValidationError]) -> Iterator[_Finding]:
    """Yield findings in the schema's order; the report is sorted when shown."""
    for error in errors:
        where = tuple(error.absolute_path)
        at = _name_of(where)
        if error.validator == "additionalProperties":
            known = _rule(error)["properties"]
            for key in sorted(set(_value(error)) - set(known)):
                hint = did_you_mean(key, known) or _allowed(known)
                if key.isdigit() and _value(error)[key] is None:
                    hint = COMMA  # {opening_um: 96,5} has a key 5
                message = f"unknown key '{key}' in {at}"
                yield _Finding("MP104", (*where, key), message, hint, on_key=True)
        elif error.validator == "required":
            yield from _missing(error, where, at)
        elif "propertyNames" in error.absolute_schema_path:
            yield _wrong_key(error, where, at)
        else:
            code, message, hint = _fault(error, at)
            yield _Finding(code, where, message, hint, on_key=False)


def _missing(error: ValidationError, where: Where, at: str) -> Iterator[_Finding]:
    """Yield a finding for every required key that is not there."""
    value = _value(error)
    wanted: Any = error.validator_value
    for key in wanted:
        if key not in value:
            verb = value.get("do")
            reader = f" ({verb})" if isinstance(verb, str) else ""
            message = f"key '{key}' is missing in {at}{reader}"
            hint = f"add '{key}'"
            yield _Finding("MP102", where, message, hint, on_key=True, missing=(key,))


def _wrong_key(error: ValidationError, where: Where, at: str) -> _Finding:
    """Return the finding for a key that is not allowed there."""
    key = str(error.instance)
    if error.validator == "enum":
        message = f"key '{key}' means nothing here in {at}"
        allowed: Any = error.validator_value
        hint = _allowed(allowed)
        return _Finding("MP109", (*where, key), message, hint, on_key=True)
    message = f"'{key}' in {at} is not a name"
    hint = "a name is a letter, then up to 63 letters, digits, _ and -"
    return _Finding("MP107", (*where, key), message, hint, on_key=True)


def _fault(error: ValidationError, at: str) -> tuple[str, str, str]:
    """Return code, message and hint for a value that breaks its rule."""
    rule, value = error.validator, _value(error)
    limit: Any = error.validator_value
    if rule == "type":
        kinds = [limit] if isinstance(limit, str) else limit
        wanted = " or ".join(_TYPES[kind] for kind in kinds)
        hint = as_kind(kinds, value, at)
        examples = _rule(error).get("examples", ())
        if examples and (not hint or kinds == ["array"]):
            hint = f"as {_written(examples[0])}"
        return "MP101", f"{at} must be {wanted}, got {show(value)}", hint
    if rule in ("enum", "const"):
        choices = [str(item) for item in ([limit] if rule == "const" else limit)]
        near = did_you_mean(value, choices) if isinstance(value, str) else ""
        message = f"{at} must be {' or '.join(choices)}, got {show(value)}"
        return "MP105", message, near
    bounds = {
        "minimum": "at least", "exclusiveMinimum": "above", "maximum": "at most",
    }  # fmt: skip
    if rule in bounds:
        hint = _rule(error).get("description", "")
        return "MP103", f"{at} must be {bounds[rule]} {limit}, got {value}", hint
    counts = {
        "minItems": "at least", "maxItems": "at most",
        "minProperties": "at least", "maxProperties": "at most",
    }  # fmt: skip
    if rule in counts:
        message = f"{at} must have {counts[rule]} {limit} entries, got {len(value)}"
        return "MP106", message, COMMA if rule == "maxItems" else ""
    if rule == "uniqueItems":
        return "MP106", f"{at} lists the same thing twice", "remove one of them"
    says = _rule(error).get("description", f"{rule} {limit}")
    return "MP107", f"{at} cannot be {show(value)}", f"allowed: {says}"


def _rule(error: ValidationError) -> Any:
    """Return the schema that was broken."""
    return error.schema


def _value(error: ValidationError) -> Any:
    """Return the value that broke it."""
    return error.instance


def _written(example: object) -> str:
    """Return an example as it stands in a file."""
    if isinstance(example, dict):
        return (
            "{" + ", ".join(f"{key}: {value}" for key, value in example.items()) + "}"
        )
    return str(example)


def _allowed(keys: Iterable[str]) -> str:
    """Return the hint that lists what is allowed here."""
    return "allowed: " + ", ".join(keys)


def _name_of(where: Where) -> str:
    """Return a node's name as a finding says it, `steps[2].move`."""
    name = ""
    for key in where:
        name += f"[{key + 1}]" if isinstance(key, int) else f".{key}"
    return name.lstrip(".") or "the file"


def _filled(data: Any, schema: Mapping[str, Any], root: Mapping[str, Any]) -> Any:
    """Fill in defaults below `data`."""
    if "$ref" in schema:
        schema = root["$defs"][schema["$ref"].removeprefix("#/$defs/")]
    if isinstance(data, dict):
        inner = schema.get("properties", {})
        filled = {
            key: _filled(
                value, inner.get(key, schema.get("additionalProperties")), root
            )
            for key, value in data.items()
        }
        for key, rule in inner.items():
            if key not in filled and "default" in rule:
                filled[key] = _filled(rule["default"], rule, root)
        return {key: filled[key] for key in sorted(filled)}
    if isinstance(data, list):
        return [_filled(item, schema["items"], root) for item in data]
    return data
