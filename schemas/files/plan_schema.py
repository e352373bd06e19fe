"""JSON Schemas of written files, made from the types of plan or outlines.

A key's description is the comment of its field in the source.
`python -m microplan.schemas.files.plan_schema` writes them to `plan.schema.json` and
`outlines.schema.json`, which is what `json_schema.load("plan")` and `load("outlines")`
return.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import io
import json
import re
import tokenize
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

from microplan.schemas.codec import to_data
from microplan.schemas.files.outlines import VERSION, Outlines
from microplan.schemas.plan import FORMAT_VERSION, Plan

Rule = dict[str, Any]

_SCALARS: Mapping[Any, str] = {
    float: "number",
    int: "integer",
    str: "string",
    bool: "boolean",
    type(None): "null",
}


def plan_schema() -> Rule:
    """Return the JSON Schema (draft 2020-12) of `plan.json` as it is written now.

    Every key that the types have without a default is required and no other key is
    allowed; a reader is more patient (`microplan.schemas.codec`). Variants are
    distinguished by `kind` with `if`/`then`, so that a validator's errors name the
    exact key.
    """
    return _versioned(Plan, "microplan plan", "format_version", FORMAT_VERSION)


def outlines_schema() -> Rule:
    """Return the JSON Schema of what `microplan export --to json` writes."""
    return _versioned(Outlines, "microplan outlines", "version", VERSION)


def _versioned(kind: type, title: str, key: str, version: str) -> Rule:
    """Return the schema of a type whose `key` names a version "major.minor"."""
    schema = schema_of(kind, title)
    major = version.partition(".")[0]
    schema["properties"][key]["pattern"] = rf"^{major}\.(0|[1-9][0-9]{{0,5}})$"
    return schema


def schema_of(kind: type, title: str) -> Rule:
    """Return the JSON Schema of the data that a frozen dataclass is written as."""
    defs: dict[str, Rule] = {}
    _dataclass(kind, defs)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title,
        **defs.pop(kind.__name__),
        "$defs": {name: defs[name] for name in sorted(defs)},
    }


def schema_text(schema: Rule) -> str:
    """Return a schema as its file holds it."""
    return json.dumps(schema, indent=2) + "\n"


def _rule(kind: Any, defs: dict[str, Rule]) -> Rule:
    """Return the rule of a type; dataclasses go to `defs`, each once."""
    origin = get_origin(kind)
    if origin in (Union, types.UnionType):
        return _union(get_args(kind), defs)
    if origin is Literal:
        return {"enum": list(get_args(kind))}
    if origin is tuple:
        return _tuple(get_args(kind), defs)
    if origin is not None and issubclass(origin, Mapping):
        values = _rule(get_args(kind)[1], defs)
        return {"type": "object", "additionalProperties": values}
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        return _dataclass(kind, defs)
    return {"type": _SCALARS[kind]}


def _union(args: tuple[Any, ...], defs: dict[str, Rule]) -> Rule:
    """Return the rule of an optional, or of dataclasses distinguished by `kind`."""
    rest = [a for a in args if a is not type(None)]
    if len(rest) > 1:
        return _variants(rest, defs)
    rule = _rule(rest[0], defs)
    if "type" in rule and rule.keys() == {"type"}:
        return {"type": [rule["type"], "null"]}
    return {"if": {"not": {"type": "null"}}, "then": rule}


def _variants(kinds: list[Any], defs: dict[str, Rule]) -> Rule:
    """Return the rule of a union of dataclasses with a literal `kind` each."""
    names = {kind: get_args(typing.get_type_hints(kind)["kind"]) for kind in kinds}
    return {
        "type": "object",
        "required": ["kind"],
        "properties": {
            "kind": {
                "enum": [n for kind in kinds for n in names[kind]],
                "description": "which of them; says what other keys there are",
            }
        },
        "allOf": [
            {
                "if": {"properties": {"kind": {"enum": list(names[kind])}}},
                "then": _rule(kind, defs),
            }
            for kind in kinds
        ],
    }


def _tuple(args: tuple[Any, ...], defs: dict[str, Rule]) -> Rule:
    """Return the rule of a tuple, homogeneous (`...`) or of fixed length."""
    if len(args) == 2 and args[1] is Ellipsis:
        return {"type": "array", "items": _rule(args[0], defs)}
    return {
        "type": "array",
        "prefixItems": [_rule(a, defs) for a in args],
        "minItems": len(args),
        "maxItems": len(args),
    }


def _dataclass(kind: type, defs: dict[str, Rule]) -> Rule:
    """Return a reference to a dataclass' rule; every field must have a comment."""
    if kind.__name__ not in defs:
        defs[kind.__name__] = {}  # a type may hold itself
        hints, fields = typing.get_type_hints(kind), dataclasses.fields(kind)
        notes = field_notes(kind)
        defs[kind.__name__] = {
            "description": (inspect.getdoc(kind) or "").partition("\n")[0],
            "type": "object",
            "properties": {
                f.name: {
                    **_rule(hints[f.name], defs),
                    "description": in_json(notes[f.name]),
                    **_default(f),
                }
                for f in fields
            },
            "required": [f.name for f in fields if f.default is dataclasses.MISSING],
            "additionalProperties": False,
        }
    return {"$ref": f"#/$defs/{kind.__name__}"}


def _default(field: dataclasses.Field[Any]) -> Rule:
    """Return what a key means that is left out, {} if it must be there."""
    if field.default is dataclasses.MISSING:
        return {}
    return {"default": to_data(field.default)}


def in_json(note: str) -> str:
    """Return what a comment says, in the words of JSON."""
    return re.sub(r"\bNone\b", "null", note).replace("()", "[]")


def field_notes(kind: type) -> Mapping[str, str]:
    """Return name -> comment of the fields that have one, from the class' source.

    A field's comment ends its line; else it is the block of comment lines right above.

    Raises
    ------
    OSError
        If the source is not at hand.
    """
    source = inspect.getsource(kind)
    comments = _comments(source)
    lines = source.splitlines()
    (body,) = ast.parse(source).body
    found = {}
    for field in ast.walk(body):
        if not isinstance(field, ast.AnnAssign):
            continue
        if not isinstance(field.target, ast.Name):
            continue
        last = field.end_lineno or field.lineno
        beside = [comments[n] for n in range(field.lineno, last + 1) if n in comments]
        text = " ".join(beside or _above(field.lineno, lines, comments))
        if text:
            found[field.target.id] = text
    return found


def _comments(source: str) -> dict[int, str]:
    """Return line number -> comment."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {
        token.start[0]: token.string.lstrip("# ")
        for token in tokens
        if token.type == tokenize.COMMENT
    }


def _above(number: int, lines: list[str], comments: Mapping[int, str]) -> list[str]:
    """Return the lines of the block of comments that ends above line `number`."""
    block: list[str] = []
    number -= 1
    while number in comments and lines[number - 1].lstrip().startswith("#"):
        block.insert(0, comments[number])
        number -= 1
    return block


if __name__ == "__main__":
    for name, schema in (("plan", plan_schema()), ("outlines", outlines_schema())):
        (Path(__file__).parents[1] / f"{name}.schema.json").write_text(
            schema_text(schema), encoding="utf-8", newline="\n"
        )
